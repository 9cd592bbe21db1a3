"""Sealed documents: JSON files of unfinished work that say whose they are, and whether they are whole."""

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.errors import DatasetError

Read = TypeVar("Read")


def write_sealed(path: Path, document: Mapping[str, Any], *, synced: bool) -> None:
    """Write plain data with a ``fingerprint`` of its plan, as `atomic.write` does, with a hash of itself."""
    text = json.dumps({**document, "seal": _seal(document)}, sort_keys=True)
    atomic.write(path, lambda file: file.write(text.encode()), synced=synced)


def read_sealed(path: Path, plan: Plan, read: Callable[[Mapping[str, Any]], Read]) -> tuple[Read | None, str]:
    """Return what `read` makes of a document; else None and, where there is a file, what is wrong with it.

    Raises
    ------
    DatasetError
        It belongs to another plan.
    """
    try:
        document = json.loads(path.read_bytes())
        if document.pop("seal") != _seal(document):
            return None, f"its {path.name} is damaged"
        found, fingerprint = read(document), document["fingerprint"]
    except FileNotFoundError:
        return None, ""
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return None, f"its {path.name} is damaged"
    if fingerprint != plan.fingerprint:
        raise DatasetError(f"{path} must belong to plan {plan.fingerprint}; it is of plan {fingerprint}.")
    return found, ""


def _seal(document: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()
