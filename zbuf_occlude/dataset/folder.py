"""A dataset's folder: what its files are called, and its plan and manifest read back."""

import hashlib
import json
from pathlib import Path
from typing import Any

from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.errors import DatasetError

PLAN, MANIFEST = "plan.json", "manifest.json"
CONTACT_SHEET, GALLERY = "contact_sheet.png", "gallery.html"
SHAPE_NAMES, MESH_KEYS = "shape_names.txt", "mesh_keys.txt"
ORIGINAL = "original"
"""Folder, in a dataset's own, of the dataset of complete clouds that some presets want beside it."""


def datasets_in(out: Path) -> list[Path]:
    """Return a dataset's folder and, where it has one, that of its complete clouds."""
    return [out, *([out / ORIGINAL] if (out / ORIGINAL / PLAN).exists() else [])]


def read_plan(out: Path) -> Plan:
    """Read back the plan of a dataset's folder.

    Raises
    ------
    DatasetError
        There is none, or it is damaged.
    """
    path = out / PLAN
    if not path.exists():
        raise DatasetError(f"{out} must hold a dataset; it has no {PLAN}. Was it made by `zbuf-occlude generate`?")
    try:
        document = json.loads(path.read_text())
        plan = Plan.from_document(document)
    except (ValueError, KeyError, TypeError) as error:
        raise DatasetError(
            f"{path} must be a plan; it is damaged ({error}). Generate again with --overwrite."
        ) from None
    if plan.fingerprint != document["fingerprint"]:
        raise DatasetError(
            f"{path} must have the fingerprint {document['fingerprint']}; it has {plan.fingerprint}. "
            "It was changed, or made by another version; generate again with --overwrite."
        )
    return plan


def read_manifest(out: Path) -> dict[str, Any] | None:
    """Return the manifest of a folder whose dataset is complete, None for one that is not."""
    path = out / MANIFEST
    if not path.exists():
        return None
    try:
        document: dict[str, Any] = json.loads(path.read_text())
    except ValueError as error:
        raise DatasetError(f"{path} must be JSON; it is damaged ({error}). Generate again with --overwrite.") from None
    return document


def read_finished(out: Path) -> tuple[Plan, dict[str, Any]]:
    """Return the plan and the manifest of a complete dataset.

    Raises
    ------
    DatasetError
        It is not complete, or there is none.
    """
    plan, manifest = read_plan(out), read_manifest(out)
    if manifest is None:
        raise DatasetError(
            f"{out} must hold a complete dataset; it has no {MANIFEST}. Finish it: zbuf-occlude status {out}"
        )
    return plan, manifest


def checksums(out: Path, files: dict[str, list[str]]) -> dict[str, str]:
    """Return the SHA-256 of each file of a dataset, in hexadecimal, by name; of a list of files, with all it lists."""
    return {name: _checksum(out, name) for names in files.values() for name in names}


def _checksum(out: Path, name: str) -> str:
    with open(out / name, "rb") as file:
        digest = hashlib.file_digest(file, "sha256")
    if name.endswith(".txt"):
        for listed in (out / name).read_text().splitlines():
            digest.update(_checksum(out, listed).encode())
    return digest.hexdigest()
