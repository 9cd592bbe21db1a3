"""A dataset's folder: what its files are called, and its plan and manifest read back."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from zbuf_occlude.dataset.damage import reading
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.meshes.collection import SPLITS

PLAN, MANIFEST = "plan.json", "manifest.json"
SHARDS = "shards"
"""Folder of unfinished work."""
CONTACT_SHEET, GALLERY = "contact_sheet.png", "gallery.html"
SHAPE_NAMES, MESH_KEYS = "shape_names.txt", "mesh_keys.txt"
ORIGINAL = "original"
"""Folder, in a dataset's own, of the dataset of complete clouds that some presets want beside it."""

PLAN_REMEDY = "Copy it again from where it was made; or delete the folder yourself, and make the dataset again."
"""Without a plan nothing says what in the folder is the dataset's, so nothing is deleted."""

Kinds = Mapping[str, Any]
"""What a JSON object must have: for each name a type or types, or, for an object in it, its own `Kinds`."""

_SHARE = (int, float, type(None))  # None: nothing was checked
_OF_MANIFEST: Kinds = {
    "classes": list,
    "counts": {
        "clouds": int, "clouds_by_split": dict, "meshes": int, "meshes_failed": int, "views": int, "variations": int,
    },
    "error": {"false_visible": _SHARE, "false_hidden": _SHARE, "interval": (list, type(None)), "n_checked": int},
    "failures": dict,
    "files": dict,
    "fingerprint": str,
    "format": str,
    "options": {"complete": bool, "method": str, "reason": str},
    "renderer": str,
    "seed": int,
    "sha256": dict,
}  # fmt: skip
"""What the commands read of it."""


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
    with reading(path, PLAN_REMEDY):
        document = read_object(path, {"fingerprint": str})
        plan = Plan.from_document(document)
        found = plan.fingerprint
    if found != document["fingerprint"]:
        raise DatasetError(
            f"{path} must have the fingerprint {document['fingerprint']}; it has {found}. It was changed. {PLAN_REMEDY}"
        )
    return plan


def read_manifest(out: Path) -> dict[str, Any] | None:
    """Return the manifest of a folder whose dataset is complete, None for one that is not.

    Raises
    ------
    DatasetError
        It is damaged, or lacks something that is read of it.
    """
    path = out / MANIFEST
    if not path.exists():
        return None
    with reading(path):
        document = read_object(path, _OF_MANIFEST)
        if not document["files"] or not all(document["files"].values()):
            raise ValueError("it names no files")
        for split, names in document["files"].items():
            for name in names:
                if not isinstance(document["sha256"][name], str):
                    raise TypeError(f"files of {split} without a checksum")
    return document


def read_object(path: Path, kinds: Kinds) -> dict[str, Any]:
    """Read a JSON object that has what it must have; else raise what `damage.reading` puts into words."""
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    _check_kinds(document, kinds, "it")
    return document


def _check_kinds(values: Any, kinds: Kinds, what: str) -> None:
    if not isinstance(values, dict):
        raise TypeError(f"{what} is no object")
    for name, kind in kinds.items():
        if name not in values:
            raise KeyError(name)
        if isinstance(kind, Mapping):
            _check_kinds(values[name], kind, name)
        elif not isinstance(values[name], kind):
            raise TypeError(f"{name} is {json.dumps(values[name])[:40]}")


def read_finished(out: Path) -> tuple[Plan, dict[str, Any]]:
    """Return the plan and the manifest of a complete dataset.

    Raises
    ------
    DatasetError
        It is not complete, or damaged, or there is none.
    """
    plan, manifest = read_plan(out), read_manifest(out)
    if manifest is None:
        raise DatasetError(
            f"{out} must hold a complete dataset; it has no {MANIFEST}. Finish it: zbuf-occlude status {out}"
        )
    return plan, manifest


def checksums(
    out: Path, files: Mapping[str, list[str]], known: Mapping[str, str] = MappingProxyType({})
) -> dict[str, str]:
    """Return the SHA-256 of each file of a dataset, in hexadecimal, by name; of a list of files, with all it lists.

    Parameters
    ----------
    out : Path
    files : mapping of split to file names
        As in the manifest. What labels and mesh ids stand for, and lists of files, are taken in beside them.
    known : mapping of file name to checksum
        Of files that are not read for it.
    """
    data = {name for of_split in files.values() for name in of_split}
    beside = {name for name in (SHAPE_NAMES, MESH_KEYS, *map(list_of, SPLITS)) if (out / name).exists()} - data
    return {
        **{name: checksum(out, name, known, of_data=True) for name in sorted(data)},
        **{name: checksum(out, name, known) for name in sorted(beside)},
    }


def list_of(split: str) -> str:
    """Return the name of the list of a split's files, which some formats have."""
    return f"{split}_files.txt"


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file's content, in hexadecimal."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def checksum(out: Path, name: str, known: Mapping[str, str] = MappingProxyType({}), *, of_data: bool = False) -> str:
    """Return the SHA-256 of one file; of a list that stands for a split's data, with all it lists."""
    if name in known:
        return known[name]
    with reading(out / name):
        if not (of_data and name.endswith("_files.txt")):
            return sha256_of(out / name)
        digest = hashlib.sha256((out / name).read_bytes())
        for listed in (out / name).read_text().splitlines():
            digest.update(checksum(out, listed, known).encode())
    return digest.hexdigest()
