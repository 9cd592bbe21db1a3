"""Exports: the layouts that published loaders read, made from a dataset, and conversion to another format.

A layout is exported from the clouds of a dataset by one function. `generate --format pcn` makes the files of its shards
in ``shards/``, exports them, and removes them. An export is for its loaders: `verify` compares its checksums. Only
layouts of completion are read back, to be looked at. For each split ``clouds_SPLIT.npy`` has what a record holds
besides points (view, pose, face ids, ...), a row per cloud in the layout's order.
"""

import math
import os
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base import atomic
from zbuf_occlude.base.errors import DatasetError, OptionError
from zbuf_occlude.base.provenance import MeshSource
from zbuf_occlude.datasets.counts import Blank
from zbuf_occlude.datasets.folder import (
    CONTACT_SHEET,
    EXPORT_NAMES,
    MANIFEST,
    WORK,
    checksums,
    claim_folder,
    contains_plan,
    damaged,
    leftover_work,
    locked,
    read_command,
    read_finished,
    read_manifest,
    recorded,
    remove_files,
    sizes,
    unfinish,
    write_names,
)
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.datasets.gallery import write_contact_sheet
from zbuf_occlude.datasets.plan import Numbers, Plan
from zbuf_occlude.datasets.records import Records, record_type
from zbuf_occlude.datasets.source import CloudReader, open_dataset
from zbuf_occlude.meshes.collection import MeshEntry
from zbuf_occlude.meshes.load import SUFFIXES

UNSEEN = "not all its views see it"


class Exported(NamedTuple):
    """Report on an export: the files and the number of clouds of each split, and other counts.

    `left_out` has the reasons why meshes with clouds, by index, are not in it.
    """

    files: dict[str, list[str]]
    n_clouds: dict[str, int]
    counts: Mapping[str, int] = MappingProxyType({})
    left_out: Mapping[int, str] = MappingProxyType({})


def check_sources(entries: Iterable[MeshEntry], manifest: Mapping[str, Any], out: Path) -> None:
    """Raise DatasetError where a mesh has another size than when the data in a folder were made of it."""
    for entry in entries:
        source = manifest["origins"].get(entry.key)
        if source is not None and entry.has_changed(MeshSource.from_dict(source)):
            raise DatasetError(
                f"{entry.key} has changed since the data in {out} were made of it, sha256 {source['sha256'][:12]}.... "
                "Put it back, choose another folder, or make all clouds again with --overwrite."
            )


def export(plan: Plan, source: CloudReader, out: Path, about: dict[str, Any]) -> dict[str, Any]:
    """Export clouds into a folder that is this plan's: files appear when all are written, then the manifest.

    `about` is the manifest of the dataset that the clouds are from.
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
    if find_format(plan.format).from_meshes:
        check_sources(plan.meshes, about, out)
    write_names(plan, folder)
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    sha256, before = checksums(folder, names), set(recorded(out))
    atomic.write_json(out / WORK / EXPORT_NAMES, {"names": sorted(before.union(names))})
    os.sync()  # one for all files
    remove_files(out, before.difference(names))
    for name in names:
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(folder / name, out / name)
    shutil.rmtree(folder)
    files = {split: of_split for split, of_split in exported.files.items() if exported.n_clouds[split]}
    by_split = {split: exported.n_clouds[split] for split in files}
    blank = about["blank_views"]
    left_out = {plan.meshes[mesh_id].key: why for mesh_id, why in exported.left_out.items()}
    left_out |= {key: Blank(**blank[key]).said for key, why in left_out.items() if why == UNSEEN and key in blank}
    unknown = [entry.key for entry in plan.meshes if entry.label not in plan.classes]
    left_out |= dict.fromkeys(unknown, f"{plan.format} has no label for its class")
    left_out = {**about["left_out"], **left_out}
    counts = {
        **about["counts"],
        **exported.counts,
        "meshes": len(plan.meshes) - len({**about["failures"], **left_out}),
        "clouds": sum(by_split.values()),
        "clouds_by_split": by_split,
    }
    about = {
        **about,
        "classes": plan.classes,
        **frame_in_words(plan),
        "counts": counts,
        "left_out": left_out,
    }
    return finish_folder(plan, source, out, about, files, sha256)


def finish_folder(
    plan: Plan,
    source: CloudReader,
    out: Path,
    about: dict[str, Any],
    files: dict[str, list[str]],
    sha256: dict[str, str],
) -> dict[str, Any]:
    """Write the picture and the manifest of a dataset whose clouds are written; return the manifest."""
    write_contact_sheet(out / CONTACT_SHEET, source)
    document = {
        **about,
        "fingerprint": plan.fingerprint,
        "format": plan.format,
        "options": plan.config.to_dict(),
        "files": files,
        "sha256": sha256,
        "bytes": sizes(out, sha256),
    }
    atomic.write_json(out / MANIFEST, document)
    remove_files(out, leftover_work(out, plan))
    return document


def frame_in_words(plan: Plan) -> dict[str, Any]:
    """Return the axes of the clouds in the files, in those of the mesh with z up or of the camera, and the one up."""
    if plan.config.frame == "camera":
        y_and_z = ("up", "backwards") if plan.config.axes == "opengl" else ("down", "forward")
        return {"axes": ["right", *y_and_z], "up": None}
    axes = find_format(plan.format).axes_in(plan.config.frame)
    return {"axes": list(axes), "up": "xyz"[[axis[-1] for axis in axes].index("z")]}


def as_theirs(source: CloudReader, plan: Plan) -> CloudReader:
    """Return the clouds of a layout's classes, with its labels, positions and normals in its frame."""
    row, axes = find_format(plan.format), find_format(plan.format).to_frame(plan.config).T
    longest_side = np.linalg.norm(axes[0])
    number_of = {name: number for number, name in enumerate(plan.classes)}
    label_of = np.array([number_of.get(entry.label, -1) for entry in plan.meshes])
    order = source.order
    if row.class_list:
        known = label_of[source.ids()["mesh_id"]] >= 0
        order = {split: numbers[known[numbers]] for split, numbers in order.items() if known[numbers].any()}

    def turned(records: Records) -> Records:
        records["label"] = label_of[records["mesh_id"]][..., None]
        records["factor"] *= longest_side
        for name, matrix in (("data", axes), ("normal", axes / longest_side)):
            if name in (records.dtype.names or ()):
                _turn(records[name], matrix)
        return records

    whole = source.complete
    return replace(
        source,
        plan=plan,
        order=order,
        sizes=source.sizes if order is source.order else {},
        take=lambda numbers: turned(np.array(source.take(numbers))),
        complete=None if whole is None else lambda partial, n_points: turned(np.array(whole(partial, n_points))),
    )


def _turn(vectors: NDArray[Any], matrix: NDArray[np.float32]) -> None:
    """Multiply the rows of clouds (k, n, 3), or of k clouds of unequal size, by a matrix in place."""
    if not vectors.dtype.hasobject:
        vectors[...] = vectors @ matrix
        return
    for number, cloud in enumerate([] if np.array_equal(matrix, np.eye(3)) else vectors):
        vectors[number] = cloud @ matrix


def convert(
    folder: Path, out: Path, format: str, *, progress: Callable[[int], None] = lambda clouds: None
) -> dict[str, Any]:
    """Write the clouds of a dataset in another format.

    Parameters
    ----------
    folder : Path
        A complete dataset.
    out : Path
        Created where missing; else empty, or of this same conversion, whose files are not written again.
    format : str
        Name in the table of formats.
    progress : callable
        Called with the number of clouds after each write.

    Returns
    -------
    dict
        The manifest of the new dataset; ``converted_from`` names the old one's format and fingerprint.

    Raises
    ------
    DatasetError
        There is no complete dataset; `out` holds something else; the dataset lacks data that the format needs.
    OptionError
        The dataset was drawn with options that the format cannot hold.

    Notes
    -----
    From `packed` the clouds are drawn as `generate` would have drawn them for that format: the same points in the same
    order, rounded to the packed step. Clouds of classes that a format's published list lacks are left out.
    """
    old, manifest = read_finished(folder)
    plan = _converted(old, format)
    command = _command_of(plan, read_command(folder))
    about = {**manifest, "command": command, "converted_from": plan.converted_from}
    redrawn = None
    if find_format(old.format).whole_objects:  # draw and order are those of the new format
        redrawn = replace(old, config=plan.config, format=find_format(format).storage.name)
    source = open_dataset(folder, redrawn)
    contains_plan(plan, out)
    with locked(out):
        claim_folder(plan, out, command)
        return _convert(plan, replace(source, plan=plan), out, about, progress)


def _convert(
    plan: Plan, source: CloudReader, out: Path, about: dict[str, Any], progress: Callable[[int], None]
) -> dict[str, Any]:
    row, finished = find_format(plan.format), read_manifest(out)
    if finished is not None:
        if not (lost := damaged(out, finished)):
            progress(sum(source.n_clouds.values()))
            return finished
        unfinish(out)
        remove_files(out, lost)
    if row.exported_from:
        document = export(plan, source, out, about)
        progress(sum(source.n_clouds.values()))
        return document
    module, names, known = row.load(), {split: list[str]() for split in source.order}, dict[str, str]()
    for split in source.order:
        for number, numbers in source.files(split):
            name = module.file_name(split, number)
            names[split].append(name)
            if not (out / name).exists():
                known[name] = module.write(out / name, source.take(numbers), plan, number).sha256
            progress(len(numbers))
    write_names(plan, out)
    row.finish(out, plan, names)
    sha256 = checksums(out, (name for of_split in names.values() for name in of_split), known)
    return finish_folder(plan, source, out, about, names, sha256)


def _command_of(plan: Plan, before: dict[str, Any]) -> dict[str, Any]:
    """Return the options of `generate` that make a converted dataset, from those that made the dataset before.

    There are none where that one was made in Python, or where no option takes a format's own range away.
    """
    config, row = plan.config, find_format(plan.format)
    if not before or (config.scan is not None and config.scan.range is None and "range_" in row.options):
        return {}
    size = "all" if config.sample_size is None else str(config.sample_size)
    found = {"views": config.views, "sample-size": size, "scale": config.scale}
    own = {name: value for name, value in found.items() if name.replace("-", "_") in row.options}
    # without complete clouds a format has nothing of scans but the scans
    idle = () if config.scan is None or row.keeps_points or config.complete else ("points", "density")
    return {name: value for name, value in before.items() if name not in idle} | {"format": plan.format, **own}


def _converted(old: Plan, format: str) -> Plan:
    """Return the plan of a dataset's clouds in another format, once that can hold them."""
    row, is_packed = find_format(format), find_format(old.format).whole_objects
    if row.whole_objects:
        raise DatasetError(
            f"a {format} dataset must be made of all points of its objects; {old.format} keeps those of each cloud. "
            f"Make it with `zbuf-occlude generate --format {format}`."
        )
    if row.from_meshes:
        raise DatasetError(
            f"{format} must be made from the meshes, which a dataset does not hold. "
            f"Make it with `zbuf-occlude generate --format {format}`."
        )
    if (row.keeps_points or row.complete) and not is_packed:
        raise DatasetError(
            f"{format} must be made of all points of the objects, for it holds complete clouds; {old.format} keeps "
            f"only those drawn. Make it with `zbuf-occlude generate --format {format}`, or convert a packed dataset."
        )
    plan: Plan = replace(old, format=format, converted_from={"format": old.format, "fingerprint": old.fingerprint})
    if is_packed:
        plan = replace(plan, config=row.redrawn(plan.config))
    try:
        row.check(replace(plan, meshes=row.choose_meshes(plan.meshes)))
    except OptionError as error:
        raise OptionError(f"{error} Make it so by `zbuf-occlude generate`: convert keeps what was drawn.") from None
    return plan


LONGEST = 150
"""Characters of a name."""


class Layout(NamedTuple):
    """A layout in a module of several layouts. Its fields are the functions of a module of one layout."""

    export: Callable[[CloudReader, Path], Exported]
    check: Callable[[Plan], None] = lambda plan: None
    read: Callable[[Path, Plan, Mapping[str, list[str]]], CloudReader] | None = None  # to look at


class Names(NamedTuple):
    """Names of objects in a layout, by mesh index: only letters, digits and underscores."""

    classes: list[str]
    taxonomies: list[str]  # ShapeNet's synset where the key begins with one, else the class's name
    objects: list[str]  # last part of the key without its ending; unique within its taxonomy and within its class

    def object_file(self, pattern: str, mesh_id: int, **more: Any) -> str:
        """Return the name of an object's file, whose label, taxonomy and name are filled into a pattern."""
        label, taxonomy, name = (each[mesh_id] for each in self)
        return pattern.format(label=label, taxonomy=taxonomy, name=name, **more)


def names_of(plan: Plan) -> Names:
    """Return the names of the meshes of a plan; the same plan gives the same names."""
    taken, last = set[tuple[str, str]](), dict[tuple[str, str], int]()

    def unused(name: str, *places: str) -> str:
        """Turn a name into a word that differs from all before in the same places."""
        word = found = re.sub(r"\W", "_", name, flags=re.ASCII)[:LONGEST] or "_"
        while any((place, found) in taken for place in places):
            number = last[places[0], word] = last.get((places[0], word), 1) + 1
            found = f"{word}_{number}"
        taken.update((place, found) for place in places)
        return found

    words = {label: unused(label, "") for label in plan.meshes.classes}
    names = Names([words[entry.label] for entry in plan.meshes], [], [])
    for entry in plan.meshes:
        path = PurePosixPath(entry.key)
        synset = path.parts[0]
        taxonomy = synset if re.fullmatch(r"\d{8}", synset) and len(path.parts) > 1 else words[entry.label]
        names.taxonomies.append(taxonomy)
        name = path.stem if path.suffix.lower() in SUFFIXES else path.name
        names.objects.append(unused(name, taxonomy, f"class {words[entry.label]}"))
    return names


def check_as_they_are(plan: Plan) -> None:
    """Raise OptionError unless a plan's clouds have all points, in the scans' frame."""
    for option, found, wanted in (
        ("--sample-size", plan.config.sample_size, None),
        ("--scale", plan.config.scale, "mesh"),
        ("--frame", plan.config.frame, "object"),
    ):
        if found != wanted:
            raise OptionError(
                f"{plan.format} must have all points as they are; got {option} {found}. Give {option} "
                f"{wanted or 'all'}."
            )


def check_one_frame(plan: Plan, *, of_object: bool = True) -> None:
    """Raise OptionError unless all clouds of an object, or else the two of each view, lie in one frame."""
    cures = ["--scale object or mesh"] if plan.config.scale in ("cloud", "metres") else []
    if of_object and plan.config.frame == "camera":
        cures += ["--frame object (hdf5, packed, completion3d and epn3d keep the camera's)"]
    if cures:
        raise OptionError(
            f"{plan.format} must have all clouds of an object in one frame; got --scale {plan.config.scale} --frame "
            f"{plan.config.frame}. Give {', '.join(cures)}."
        )


def whole_objects(source: CloudReader, n_kept: int | None = None) -> dict[str, Numbers]:
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


def incomplete(source: CloudReader) -> dict[int, str]:
    """Return the reasons for the meshes that `whole_objects` leaves out, by index."""
    numbers = np.concatenate(list(source.order.values()))
    mesh_ids, n_seeing = np.unique(source.ids()["mesh_id"][numbers], return_counts=True)
    return dict.fromkeys(mesh_ids[n_seeing < source.plan.clouds_per_mesh].tolist(), UNSEEN)


class Rows:
    """A ``.npy`` file whose rows are written in any order.

    On a full disk it raises an OSError, where a memory map would end the process.
    """

    def __init__(self, path: Path, kind: np.dtype[Any], shape: tuple[int, ...]) -> None:
        self._path, self._kind = path, kind
        self._row_bytes = kind.itemsize * math.prod(shape[1:])
        header = {"descr": np.lib.format.dtype_to_descr(kind), "fortran_order": False, "shape": shape}
        with open(path, "wb") as file:
            np.lib.format.write_array_header_1_0(file, header)
            self._begin = file.tell()
            file.truncate(self._begin + shape[0] * self._row_bytes)

    def write(self, rows: slice | Numbers, values: NDArray[Any]) -> None:
        """Write some rows, (m, ...); of a slice they follow each other."""
        content = np.ascontiguousarray(values, self._kind)
        parts = [(rows.start, content)] if isinstance(rows, slice) else zip(rows.tolist(), content, strict=True)
        with open(self._path, "r+b") as file:
            for row, part in parts:
                file.seek(self._begin + row * self._row_bytes)
                file.write(part.tobytes())


class CloudFields:
    """The file ``clouds_SPLIT.npy``: the fields of records besides their points, row by row.

    Of clouds of unequal size it has the fields that have one row per cloud.
    """

    def __init__(self, folder: Path, split: str, plan: Plan, n_rows: int) -> None:
        self.name = f"clouds_{split}.npy"
        whole = record_type(plan.config)
        fields = [(name, whole[name]) for name in whole.names or () if name != "data" and not whole[name].hasobject]
        self._kind = np.dtype(fields)
        self._rows = Rows(folder / self.name, self._kind, (n_rows,)) if n_rows else None

    def write(self, rows: slice | Numbers, records: Records) -> None:
        """Write the rows of some records."""
        if self._rows is not None:
            found = np.empty(len(records), self._kind)
            for name in self._kind.names or ():
                found[name] = records[name]
            self._rows.write(rows, found)

    def batches(self, source: CloudReader, split: str) -> Iterator[tuple[slice, Records]]:
        """Yield the rows and records of a split; each is written here."""
        row = 0
        for records in source.batches(split):
            rows = slice(row, row := row + len(records))
            self.write(rows, records)
            yield rows, records
