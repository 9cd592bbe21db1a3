"""Packed datasets: all points of each object once a variation, and one visibility bit for each point and view.

    clouds = PackedDataset("occluded", split="train")
    clouds[7].positions, clouds[7].label                 # all visible points of one view, in the mesh's own units

Each file is a ZIP archive; any language reads it. For mesh 17 of the plan and its variation 2 it holds

    000017/mesh.json    key, label, split; n_points of each variation; low, step: positions are low + step * q;
                        centre, longest_side; blind: for each variation the views that see nothing
    000017/2.steps      q of all points, three 16-bit integers each (`pack_integers`)
    000017/2.faces      the face each point lies on
    000017/2.visible    for each view of the plan a row of bits, one per point
    000017/2.scans      of scans instead of 2.visible: their points, not rounded (`pack_scans`);
                        all else is then of the object as it stood before the sensor, in metres
    000017/2.places     of complete clouds before a sensor instead of 2.scans: the table of the k places
    000017/2.normals    with `DatasetConfig.attributes`: unit normals, as the faces are wound, three floats each
    000017/2.colors     likewise: red, green, blue

The views are those of plan.json, about `centre` at multiples of `longest_side`. Visibility was computed for
the points before they were rounded; rounding moves a point by at most half a step along each axis, a 131,070th of the
longest side.

Numbers that grow slowly from point to point become small ones: each is replaced by its difference to the one before,
folded so that small negative ones are small too (0, -1, 1, -2, 2 become 0, 1, 2, 3, 4), and the bytes are regrouped:
first the lowest byte of all, then the next. What is left for the archive's compression (deflate) is mostly zeros.
Columns (x, y, z) are packed in turn. Scans are NumPy's arrays, one after the other: offsets (k + 1,), the table of the
k places, a row per scan, a row per point.
"""

import io
import json
import os
import zipfile
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import IO, Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.base.atomic import FileDigest, reading
from zbuf_occlude.base.documents import as_path
from zbuf_occlude.base.errors import DatasetError, check_choice
from zbuf_occlude.datasets.folder import read_finished
from zbuf_occlude.datasets.pipeline import Sampling, standing_points
from zbuf_occlude.datasets.plan import Numbers, Plan
from zbuf_occlude.datasets.records import (
    IDS,
    Records,
    ScanPoints,
    colors_of,
    gather_clouds,
    mask_of_scans,
    record_type,
)
from zbuf_occlude.datasets.source import CloudReader, StoredSampling
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.collection import SPLITS
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.sensors.capture import in_metres
from zbuf_occlude.views import Views

OPEN_FILES, KEPT_BLOCKS = 16, 4
"""Maximum numbers of open files and of unpacked blocks of a reader."""
QUANT_LEVELS = 2**16 - 1
"""Number of steps along an object's longest side; positions are rounded to whole steps."""


def archive_name(shard: int) -> str:
    """Return the name of a shard's archive."""
    return f"packed-{shard:06d}.zip"


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> CloudReader:
    """Return the clouds as `generate` would draw them, in the order in which it would write them."""
    return PackedFiles(plan, out, files).source()


class Quantizer(NamedTuple):
    """Grid of rounded positions: ``low + step * q`` (world space) for the integers q in 0..65535."""

    low: FloatArray
    step: float

    @classmethod
    def of_box(cls, bounds: FloatArray) -> "Quantizer":
        """Return the grid of an object's box, (2, 3): its longest side is `QUANT_LEVELS` steps."""
        return cls(bounds[0], float(np.ptp(bounds, axis=0).max()) / QUANT_LEVELS)

    def quantize(self, positions: FloatArray) -> NDArray[np.uint16]:
        """Round positions (n, 3) in the box to steps."""
        return np.clip(np.round((positions - self.low) / self.step), 0, QUANT_LEVELS).astype(np.uint16)

    def positions(self, rounded: NDArray[Any]) -> FloatArray:
        """Return the positions (n, 3) of steps, world space."""
        return np.asarray(self.low + self.step * rounded)


def pack_integers(values: NDArray[Any]) -> bytes:
    """Pack integers (n,) or (n, 3), those column by column: differences folded, lowest bytes first."""
    signed = values.view(values.dtype.str.replace("u", "i"))
    return b"".join(map(_pack, signed.T if values.ndim == 2 else [signed]))


def unpack_integers(content: bytes, dtype: str, shape: tuple[int, ...], what: str) -> NDArray[Any]:
    """Return the integers that were packed, in this type and shape."""
    kind = np.dtype(dtype)
    _check(content, kind.itemsize * int(np.prod(shape)), what)
    n_bytes = kind.itemsize * shape[0]
    signed = np.dtype(kind.str.replace("u", "i"))
    columns = [_unpack(content[i * n_bytes :][:n_bytes], signed) for i in range(int(np.prod(shape[1:])))]
    return np.stack(columns, axis=1).reshape(shape).view(kind)


def _pack(values: NDArray[Any]) -> bytes:
    kind = values.dtype
    differences = np.diff(values, prepend=kind.type(0))  # wraps around, and back again
    folded = (differences << kind.type(1)) ^ (differences >> kind.type(8 * kind.itemsize - 1))
    return folded.astype(kind.newbyteorder("<")).view(np.uint8).reshape(-1, kind.itemsize).T.tobytes()


def _unpack(content: bytes, kind: np.dtype[Any]) -> NDArray[Any]:
    planes = np.frombuffer(content, np.uint8).reshape(kind.itemsize, -1)
    folded = np.ascontiguousarray(planes.T).view(kind.str.replace("i", "u"))[:, 0]
    differences = (folded >> 1).astype(kind) ^ -(folded & 1).astype(kind)
    return np.cumsum(differences, dtype=kind)


def _check(content: bytes, size: int, what: str) -> None:
    if len(content) != size:
        raise DatasetError(f"the {what} must be {size} bytes; they are {len(content)}. The file is damaged; verify it.")


def pack_mask(mask: BoolArray) -> bytes:
    """Pack a mask (k, n): a row of ceil(n / 8) bytes per view, the first point in the highest bit."""
    return np.packbits(mask, axis=1).tobytes()


def unpack_mask(content: bytes, n_views: int, n_points: int) -> BoolArray:
    """Return the packed mask (k, n)."""
    width = -(-n_points // 8)
    _check(content, n_views * width, "visibility bits")
    rows = np.frombuffer(content, np.uint8).reshape(n_views, width)
    return np.unpackbits(rows, axis=1, count=n_points).view(np.bool_)


def pack_scans(points: ScanPoints, mask: BoolArray, places: Views) -> bytes:
    """Return the bytes of k scans whose points stand one after the other; `mask` (k, n) is True for the points of each
    scan."""
    of_points: dict[str, NDArray[Any]] = {"position": points.positions, "face_id": points.face_ids, **points.columns}
    offsets = np.cumsum([0, *np.count_nonzero(mask, axis=1)], dtype=np.int64)
    return _saved(offsets, places.to_rows(), _table(dict(points.facts)), _table(of_points))


def pack_places(places: Views) -> bytes:
    """Return the bytes of the table of some places of a sensor."""
    return _saved(places.to_rows())


def unpack_places(content: bytes) -> Views:
    """Return the places that were packed; raise ValueError for other content."""
    return Views.from_rows(np.load(io.BytesIO(content), allow_pickle=False))


def unpack_scans(content: bytes) -> tuple[ScanPoints, BoolArray, Views]:
    """Return the scans that were packed; raise ValueError or KeyError for other content."""
    file = io.BytesIO(content)
    offsets, table, facts, rows = (np.load(file, allow_pickle=False) for _ in range(4))
    lengths = np.diff(offsets)
    if len(table) != len(lengths) or len(facts) != len(lengths) or offsets[-1] != len(rows):
        raise ValueError(f"{len(lengths)} scans, where there are {len(table)} places and {len(rows)} points")
    columns = {name: np.ascontiguousarray(rows[name]) for name in rows.dtype.names or ()}
    points = ScanPoints(
        columns.pop("position"),
        columns.pop("face_id"),
        columns["normal"],
        columns.get("color"),
        columns=columns,
        facts={name: facts[name] for name in facts.dtype.names or ()},
    )
    return points, mask_of_scans(lengths), Views.from_rows(table)


def _saved(*arrays: NDArray[Any]) -> bytes:
    """Return the bytes of arrays one after the other, as NumPy saves them."""
    file = io.BytesIO()
    for array in arrays:
        np.save(file, array, allow_pickle=False)
    return file.getvalue()


def _table(columns: dict[str, NDArray[Any]]) -> NDArray[Any]:
    kinds = [(name, values.dtype.newbyteorder("<"), values.shape[1:]) for name, values in columns.items()]
    rows: NDArray[Any] = np.empty(len(next(iter(columns.values()))), kinds)
    for name, values in columns.items():
        rows[name] = values
    return rows


class Shard:
    """The points and bits of a shard, as the members of its archive."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._members: list[tuple[str, bytes]] = []

    def keep(self, sampling: Sampling, key: str, variation: int) -> tuple[SurfacePoints, bytes, list[int]]:
        """Return the points of one sampling of a mesh, its bits or scans as bytes, and the views that see nothing."""
        points, mask, views = sampling[:3]
        if not isinstance(points, ScanPoints):
            seen = pack_mask(mask)
        else:
            seen = pack_places(views) if self._plan.config.complete else pack_scans(points, mask, views)
        return points, seen, np.flatnonzero(~mask.any(axis=1)).tolist()

    def add(self, mesh_id: int, mesh: Mesh, kept: list[tuple[SurfacePoints, bytes, list[int]]]) -> None:
        """Add all samplings of a mesh."""
        entry, config = self._plan.meshes[mesh_id], self._plan.config
        kind, samples = "visible", [points for points, _, _ in kept]
        if config.scan is not None:
            kind = "places" if config.complete else "scans"
            samples = [standing_points(mesh, entry.label, config, config.scan, entry.key, i) for i in range(len(kept))]
            mesh, _ = in_metres(mesh, entry.label, config.scan)
        grid = Quantizer.of_box(mesh.bounds)
        facts = {
            "key": entry.key,
            "label": entry.label,
            "split": entry.split,
            "n_points": list(map(len, samples)),
            "low": grid.low.tolist(),
            "step": grid.step,
            "centre": mesh.centre.tolist(),
            "longest_side": mesh.longest_side,
            "blind": [blind for _, _, blind in kept],
        }
        members = [(f"{mesh_id:06d}/mesh.json", json.dumps(facts).encode())]
        for variation, (points, (_, seen, _)) in enumerate(zip(samples, kept, strict=True)):
            name = f"{mesh_id:06d}/{variation}"
            members.append((f"{name}.steps", pack_integers(grid.quantize(points.positions))))
            members.append((f"{name}.faces", pack_integers(points.face_ids)))
            members.append((f"{name}.{kind}", seen))
            if "normals" in config.attributes:
                bits = points.normals.astype("<f4").view("<i4")  # their differences are 0 along a face
                members.append((f"{name}.normals", pack_integers(bits)))
            if "colors" in config.attributes:
                members.append((f"{name}.colors", pack_integers(colors_of(points))))
        self._members += members

    def write(self, out: Path, shard: int) -> list[FileDigest]:
        """Write the archive; times in it are fixed, so the same clouds give the same bytes."""

        def write_members(file: IO[bytes]) -> None:
            with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
                for name, content in self._members:
                    member = zipfile.ZipInfo(name)
                    member.compress_type = zipfile.ZIP_DEFLATED
                    archive.writestr(member, content)

        path = out / archive_name(shard)
        if not self._members:
            path.unlink(missing_ok=True)  # an interrupted run may have left it
            return []
        return [atomic.write_data(path, write_members)]


class PackedFiles:
    """The blocks and clouds of packed files, by split; each process opens files when it needs them.

    Clouds are numbered in the order of the plan: by mesh, variation, view.
    """

    def __init__(self, plan: Plan, out: Path, files: Mapping[str, list[str]]) -> None:
        self.plan = plan
        self._forget()
        self._facts: dict[int, dict[str, Any]] = {}
        self._path_of: dict[int, Path] = {}
        for path in sorted(out / name for names in files.values() for name in names):
            with reading(path):
                archive = self._archive(path)
                for name in archive.namelist():
                    if name.endswith("mesh.json"):
                        mesh_id = int(name.partition("/")[0])
                        plan.meshes[mesh_id]  # there is one
                        self._facts[mesh_id] = json.loads(archive.read(name))
                        self._path_of[mesh_id] = path
        self.blocks = [(m, v) for m in sorted(self._facts) for v in range(len(self._facts[m]["n_points"]))]
        """(mesh_id, variation) of each block, in the order of the plan."""
        n_views = len(plan.views)
        self._seeing = [np.setdiff1d(np.arange(n_views), self._facts[m]["blind"][v]) for m, v in self.blocks]
        n_clouds = [len(each) for each in self._seeing]
        self._ends = np.cumsum([0, *n_clouds])[1:]
        self.ids = np.empty(sum(n_clouds), IDS)
        self.ids["mesh_id"] = np.repeat([m for m, _ in self.blocks], n_clouds)
        self.ids["variation"] = np.repeat([v for _, v in self.blocks], n_clouds)
        self.ids["view_id"] = np.concatenate([np.empty(0, int), *self._seeing])

    def __getstate__(self) -> dict[str, Any]:
        state = self.__dict__.copy()
        for name in ("_archive", "_unpacked"):  # another process opens its own
            del state[name]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._forget()

    def block(self, index: int) -> StoredSampling:
        """Unpack a block; the last few are kept."""
        if self._process != os.getpid():  # a file opened before a fork would be read at the other's position
            self._forget()
        if index not in self._unpacked:
            self._unpacked[index] = self._unpack(index)
            if len(self._unpacked) > KEPT_BLOCKS:
                self._unpacked.popitem(last=False)
        self._unpacked.move_to_end(index)
        return self._unpacked[index]

    def place(self, number: int) -> tuple[int, int]:
        """Return the block and the view of a cloud's number."""
        block = int(self.blocks_of(np.asarray(number)))
        return block, int(self._seeing[block][number - self._ends[block]])  # counted from the block's end: negative

    def blocks_of(self, numbers: Numbers) -> Numbers:
        """Return the block of each cloud."""
        return np.searchsorted(self._ends, numbers, side="right")

    def source(self) -> CloudReader:
        """Return the clouds, and the whole surfaces, as `generate` would draw them and write them into files."""
        ids = self.ids
        files, rows = self.plan.places(ids["mesh_id"], ids["variation"], ids["view_id"])
        numbers, n_clouds = np.lexsort((rows, files)), np.bincount(files, minlength=len(self.plan.files))
        split_of_file = np.array([file.split for file in self.plan.files])
        split_of = split_of_file[files[numbers]]
        present = [split for split in SPLITS if (split_of == split).any()]
        order = {split: numbers[split_of == split] for split in present}
        sizes = {split: n_clouds[split_of_file == split].tolist() for split in present}
        return CloudReader(
            self.plan, order, self.take, self.blocks_of, self.complete, self._block_of, sizes, lambda: ids
        )

    def _block_of(self, mesh_id: int, variation: int) -> StoredSampling:
        return self.block(self.blocks.index((mesh_id, variation)))

    def take(self, numbers: Numbers) -> Records:
        """Return the records of some clouds: the same draw that `generate` makes, of the rounded points."""
        config = self.plan.config
        records = np.empty(len(numbers), record_type(config))
        places = np.array([self.place(number) for number in numbers]).reshape(-1, 2)
        for index in np.unique(places[:, 0]):
            rows = np.flatnonzero(places[:, 0] == index)
            mesh_id, variation = self.blocks[index]
            entry, block, views = self.plan.meshes[mesh_id], self.block(index), places[rows, 1]
            points, mask = (block.whole, _everything(block)) if config.complete else (block.points, block.mask)
            found = gather_clouds(
                points, mask, block.views, block.longest_side, config, entry.key, variation, which=views
            )
            found["mesh_id"], found["label"] = mesh_id, self.plan.classes.index(entry.label)
            records[rows] = found
        return records

    def complete(self, partial: Any, n_points: int) -> Any:
        """Return a record of `n_points` of the whole surface of a record's object, of its first variation.

        In the camera's frame it is that of the record; else all clouds of an object have one.
        """
        config = replace(self.plan.config, sample_size=n_points, complete=True)
        mesh_id, view = int(partial["mesh_id"]), 0
        entry, block = self.plan.meshes[mesh_id], self.block(self.blocks.index((mesh_id, 0)))
        key, everything, views = entry.key + "/complete", _everything(block), block.views
        if config.frame == "camera":
            view = int(partial["view_id"])
            views = self.block(self.blocks.index((mesh_id, int(partial["variation"])))).views
        (record,) = gather_clouds(block.whole, everything, views, block.longest_side, config, key, 0, which=[view])
        record["mesh_id"], record["label"] = mesh_id, self.plan.classes.index(entry.label)
        return record

    def _unpack(self, index: int) -> StoredSampling:
        mesh_id, variation = self.blocks[index]
        facts, path, config = self._facts[mesh_id], self._path_of[mesh_id], self.plan.config
        n_points, name = facts["n_points"][variation], f"{mesh_id:06d}/{variation}"
        longest_side = facts["longest_side"]
        with reading(path):
            archive = self._archive(path)
            steps, faces = archive.read(f"{name}.steps"), archive.read(f"{name}.faces")
            more = {kind: archive.read(f"{name}.{kind}") for kind in config.attributes}
            kind = "visible" if config.scan is None else "scans"
            if kind == "scans" and f"{name}.places" in archive.namelist():
                kind = "places"
            held = archive.read(f"{name}.{kind}")
            scans = unpack_scans(held) if kind == "scans" else None
            places = unpack_places(held) if kind == "places" else None
        positions = Quantizer(np.asarray(facts["low"]), facts["step"]).positions(
            unpack_integers(steps, "<u2", (n_points, 3), "steps")
        )
        normals, colors = np.zeros_like(positions), None
        if "normals" in more:
            rows = unpack_integers(more["normals"], "<i4", (n_points, 3), "normals")
            normals = rows.view("<f4").astype(np.float64)
        if "colors" in more:
            colors = unpack_integers(more["colors"], "|u1", (n_points, 3), "colours")
        face_ids = unpack_integers(faces, "<i4", (n_points,), "face ids")
        if config.scan is not None:
            whole = ScanPoints(positions, face_ids, normals, colors, facts={"size": np.array([longest_side])})
            if places is not None:
                mask = np.ones((len(places), len(whole)), dtype=bool)
                return StoredSampling(whole, mask, places, longest_side, whole)
            assert scans is not None
            return StoredSampling(*scans, longest_side, whole)
        points = SurfacePoints(positions, face_ids, normals, colors)
        mask = unpack_mask(held, len(self.plan.views), n_points)
        views = self.plan.views_of(self.plan.meshes[mesh_id].key)
        return StoredSampling(points, mask, views.around(facts["centre"], longest_side), longest_side, points)

    def _forget(self) -> None:
        self._process = os.getpid()
        self._archive = lru_cache(OPEN_FILES)(zipfile.ZipFile)
        # no lru_cache of a method: in a cycle with this object, files would stay open until garbage is collected
        self._unpacked: OrderedDict[int, StoredSampling] = OrderedDict()


def _everything(block: StoredSampling) -> BoolArray:
    """Return a mask of the whole surface for each view."""
    return np.ones((len(block.mask), len(block.whole)), dtype=bool)


@dataclass(frozen=True, eq=False)
class PackedCloud:
    """All visible points of one view.

    Parameters
    ----------
    positions : (n, 3) float64
        World space (the mesh's own units), rounded to the object's step.
    face_ids : (n,) int32
    normals, colors : (n, 3) float64 and uint8, or None
        Where the dataset was made with them; normals as the faces are wound.
    label : int
        Index into the dataset's classes.
    key : str
        Of the mesh.
    mesh_id, variation, view_id : int
    view : (3,) float64
        Azimuth and elevation in radians, distance in world units.
    pose : (4, 4) float64
        View matrix: world space to eye space.
    n_points : int
        Points of the object, hidden ones too.
    """

    positions: FloatArray
    face_ids: IntArray
    normals: FloatArray | None
    colors: NDArray[np.uint8] | None
    label: int
    key: str
    mesh_id: int
    variation: int
    view_id: int
    view: FloatArray
    pose: FloatArray
    n_points: int


class PackedDataset(Sequence[PackedCloud]):
    """The clouds of a packed dataset, read when they are asked for.

    Parameters
    ----------
    folder : path-like
        A complete dataset in the format `packed`.
    split : {"train", "val", "test"}, optional
        Only the clouds of this split; all of them by default.

    Raises
    ------
    DatasetError
        The folder holds no complete dataset, or one of another format.
    OptionError
        The dataset has no such split.

    Notes
    -----
    In the order of the plan: by mesh, variation, view. Neighbours share a block, which is unpacked once and kept for a
    while; random access unpacks a block (some milliseconds) for nearly every cloud. Can be sent to other processes.
    """

    def __init__(self, folder: str | os.PathLike[str], split: str | None = None) -> None:
        folder = as_path(folder, "folder")
        plan, manifest = read_finished(folder)
        if plan.format != "packed":
            raise DatasetError(f"{folder} must be in the format packed; it is in {plan.format}.")
        files = manifest["files"]
        if split is not None:
            check_choice("split", split, files)
        self.archives = PackedFiles(plan, folder, files)
        splits = np.array([entry.split for entry in plan.meshes])[self.archives.ids["mesh_id"]]
        self.numbers: Numbers = np.flatnonzero(splits == split) if split else np.arange(len(splits))

    @property
    def classes(self) -> list[str]:
        """Names of the classes; a label is an index in here."""
        return self.archives.plan.classes

    def __len__(self) -> int:
        return len(self.numbers)

    @overload
    def __getitem__(self, index: int) -> PackedCloud: ...
    @overload
    def __getitem__(self, index: slice) -> list[PackedCloud]: ...
    def __getitem__(self, index: int | slice) -> PackedCloud | list[PackedCloud]:
        """Return a cloud, or for a slice a list."""
        if isinstance(index, slice):
            return [self._cloud(int(number)) for number in self.numbers[index]]
        return self._cloud(int(self.numbers[index]))

    def __iter__(self) -> Iterator[PackedCloud]:
        return (self._cloud(int(number)) for number in self.numbers)

    def _cloud(self, number: int) -> PackedCloud:
        index, view = self.archives.place(number)
        (mesh_id, variation), (points, mask, views, _, whole) = self.archives.blocks[index], self.archives.block(index)
        entry, seen, one = self.archives.plan.meshes[mesh_id], mask[view], views.select([view])
        return PackedCloud(
            points.positions[seen],
            points.face_ids[seen],
            points.normals[seen] if "normals" in self.archives.plan.config.attributes else None,
            None if points.colors is None else points.colors[seen],
            self.classes.index(entry.label),
            entry.key,
            mesh_id,
            variation,
            view,
            np.array([one.azimuth[0], one.elevation[0], one.distance[0]]),
            one.poses[0],
            len(whole),
        )
