"""Layouts of others: files that published loaders read, exported from a finished dataset by one function each.

`generate --format pcn` makes a dataset in a folder of its own, exports it, and removes it. An export is for its
loaders: `verify` compares its checksums, but it is not read back. For each split ``clouds_SPLIT.npy`` has what a record
holds besides points (view, pose, face ids, ...), a row per cloud in the layout's order.
"""

import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.clouds import record_type
from zbuf_occlude.dataset.folder import (
    CONTACT_SHEET,
    EXPORT_NAMES,
    MANIFEST,
    STORED,
    WORK,
    checksums,
    read_finished,
    remove_work,
)
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.manifest import frame_of, write_names
from zbuf_occlude.dataset.placement import CLOUDS_PER_FILE
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.sheet import write_contact_sheet
from zbuf_occlude.dataset.source import Numbers, Source
from zbuf_occlude.errors import DatasetError, OptionError
from zbuf_occlude.meshes.collection import SPLITS

Records = NDArray[Any]


class Exported(NamedTuple):
    """What an export wrote: of each split, the names of its files and how many clouds they hold."""

    files: dict[str, list[str]]
    n_clouds: dict[str, int]


def stored_plan(plan: Plan) -> Plan:
    """Return the plan of the dataset that a layout's is exported from."""
    return replace(plan, format=find_format(plan.format).exported_from)


def export_here(plan: Plan, out: Path, manifest: dict[str, Any]) -> dict[str, Any]:
    """Export the dataset in ``out/stored``, which has this manifest, and remove it; return the export's manifest."""
    stored, _ = read_finished(out / STORED)
    files = {split: manifest["files"][split] for split in SPLITS if split in manifest["files"]}
    source = find_format(stored.format).load().read(out / STORED, replace(stored, meshes=plan.meshes), files)
    return export(plan, source, out, manifest)


def export(plan: Plan, source: Source, out: Path, about: dict[str, Any]) -> dict[str, Any]:
    """Export clouds as a layout's files, then write the manifest.

    Parameters
    ----------
    plan : Plan
        Of the export.
    source : Source
    out : Path
        A folder that is claimed. Files appear in it when all are written.
    about : dict
        The manifest of the dataset that the clouds are from.

    Raises
    ------
    DatasetError
        No object can be kept: the layout wants whole objects, and of each some view sees nothing.
    """
    folder = out / WORK / "export"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    exported: Exported = find_format(plan.format).load().export(as_theirs(source, plan), folder)
    if not any(exported.n_clouds.values()):
        raise DatasetError(
            f"at least one object must be seen by all its views, for {plan.format} keeps whole objects; none is. "
            "Choose other --views, or --points."
        )
    write_names(plan, folder)
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    sha256 = checksums(folder, names)
    atomic.write_json(out / WORK / EXPORT_NAMES, {"names": names})
    os.sync()  # one for all files
    for name in names:
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(folder / name, out / name)
    shutil.rmtree(folder)
    write_contact_sheet(out / CONTACT_SHEET, source)
    document = {
        **about,
        "classes": plan.classes,
        **frame_of(plan),
        "fingerprint": plan.fingerprint,
        "format": plan.format,
        "options": plan.document["recipe"],
        "counts": {
            **about["counts"],
            "clouds_by_split": {split: n for split, n in exported.n_clouds.items() if n},
        },
        "files": {split: files for split, files in exported.files.items() if exported.n_clouds[split]},
        "sha256": sha256,
    }
    atomic.write_json(out / MANIFEST, document)
    remove_work(out, plan)
    return document


def as_theirs(source: Source, plan: Plan) -> Source:
    """Return the clouds of a layout's classes, with its labels, positions and normals in its frame."""
    row, recipe = find_format(plan.format), plan.recipe
    axes, label_of = row.to_frame(recipe).T, [plan.classes.index(entry.label) if entry.label in plan.classes else -1
                                              for entry in plan.meshes]  # fmt: skip
    order = source.order
    if row.classes:
        known = np.array(label_of)[source.ids()["mesh_id"]] >= 0
        order = {split: numbers[known[numbers]] for split, numbers in order.items() if known[numbers].any()}

    def turned(records: Records) -> Records:
        records["label"] = np.array(label_of)[records["mesh_id"]][..., None]
        for name in {"data", "normal"}.intersection(records.dtype.names or ()):
            if not records.dtype[name].hasobject:  # layouts that hold clouds of unequal size turn nothing
                records[name] = records[name] @ axes
        return records

    whole = source.complete
    complete = None if whole is None else lambda mesh_id, n_points: turned(np.array(whole(mesh_id, n_points)))
    return replace(
        source,
        plan=plan,
        order=order,
        sizes=source.sizes if order is source.order else {},
        take=lambda numbers: turned(np.array(source.take(numbers))),
        complete=complete,
    )


def whole_objects(source: Source, n_kept: int | None = None) -> dict[str, Numbers]:
    """Return the clouds of the objects that all their views see, (n objects, n_kept clouds) for each split.

    Objects are in the order of the plan, their clouds by variation and view, the first `n_kept` of each.
    """
    ids, per_object = source.ids(), source.plan.clouds_per_mesh
    found = {}
    for split, numbers in source.order.items():
        mine = ids[numbers]
        numbers = numbers[np.lexsort((mine["view_id"], mine["variation"], mine["mesh_id"]))]
        _, object_of, n_seeing = np.unique(ids[numbers]["mesh_id"], return_inverse=True, return_counts=True)
        found[split] = numbers[n_seeing[object_of] == per_object].reshape(-1, per_object)[:, :n_kept]
    return found


def in_order(source: Source, numbers: Numbers) -> Iterator[Records]:
    """Yield the records of some clouds, in their order, as many at a time as a file has."""
    for begin in range(0, numbers.size, CLOUDS_PER_FILE):
        yield source.take(numbers.reshape(-1)[begin : begin + CLOUDS_PER_FILE])


class Rest:
    """The file ``clouds_SPLIT.npy``: what records hold besides their points, row by row.

    Parameters
    ----------
    folder : Path
    split : str
    plan : Plan
    n_rows : int
    """

    def __init__(self, folder: Path, split: str, plan: Plan, n_rows: int) -> None:
        self.name = f"clouds_{split}.npy"
        kind = _rest_type(plan.recipe)
        self._rows: Records | None = None
        if n_rows and not kind.hasobject:
            self._rows = np.lib.format.open_memmap(folder / self.name, "w+", kind, (n_rows,))

    def write(self, rows: slice | Numbers, records: Records) -> None:
        """Write the rows of some records."""
        if self._rows is not None:
            for name in self._rows.dtype.names or ():
                self._rows[name][rows] = records[name]


def _rest_type(recipe: Recipe) -> np.dtype[Any]:
    whole = record_type(recipe)
    return np.dtype([(name, whole[name]) for name in whole.names or () if name != "data"])


def check_pairs(plan: Plan, name: str, *, n_complete: int, n_views: int | None = None, size: int | None = None) -> None:
    """Raise OptionError unless a plan makes pairs of partial and complete clouds as a layout's loaders expect them.

    Parameters
    ----------
    plan : Plan
    name : str
        Of the layout.
    n_complete : int
        Points of a complete cloud: as many must be sampled on each object.
    n_views, size : int, optional
        Views per object, and points of a partial cloud, where loaders have a number in their code.
    """
    recipe = plan.recipe
    for what, option, found, wanted in (
        ("views per object", "--views", len(plan.views), n_views),
        ("variation", "--variations", recipe.variations, 1),
        ("points per partial cloud", "--sample-size", recipe.sample_size, size),
    ):
        if wanted is not None and found != wanted:
            raise OptionError(
                f"{name} must have {wanted:,} {what}, for its loaders count on it; got {found:,}. See {option}."
            )
    if recipe.n_points is None or recipe.n_points < n_complete:
        sampled = "a density" if recipe.n_points is None else f"{recipe.n_points:,}"
        raise OptionError(
            f"{name} must have {n_complete:,} points in each complete cloud; got {sampled}. Give --points {n_complete}."
        )
    if recipe.scale == "cloud" or recipe.frame == "camera":
        raise OptionError(
            f"{name} must have partial and complete clouds in one frame; got --scale {recipe.scale} --frame "
            f"{recipe.frame}. Give --scale object --frame object."
        )
