"""Packed datasets: all points of each object once a variation, and one visibility bit for each point and view.

    clouds = PackedDataset("occluded", split="train")
    clouds[7].positions, clouds[7].label                 # all visible points of one view, in the mesh's own units

A shard is a ZIP archive; any language reads it. For mesh 17 of the plan and its variation 2 it holds

    000017/mesh.json    key, label, split; n_points of each variation; low, step: positions are low + step * q;
                        centre, longest_side; blind: for each variation the views that see nothing
    000017/2.steps      q of all points, three 16-bit integers each (`zbuf_occlude.dataset.packing`)
    000017/2.faces      the face each point lies on
    000017/2.visible    for each view of the plan a row of bits, one a point
    000017/2.normals    with `Recipe.attributes`: unit normals, as the faces are wound, three floats each
    000017/2.colors     likewise: red, green, blue

The views are those of plan.json, about `centre` at multiples of `longest_side`. Visibility was computed for
the points before they were rounded; rounding moves a point by at most half a step along each axis, a 131,070th of the
longest side.
"""

import json
import os
import zipfile
import zlib
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, ClassVar, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.checks import check_word
from zbuf_occlude.colors import GREY
from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.clouds import gather_clouds, record_type
from zbuf_occlude.dataset.damage import reading
from zbuf_occlude.dataset.folder import read_finished
from zbuf_occlude.dataset.order import order_of
from zbuf_occlude.dataset.packing import (
    Grid,
    pack_colors,
    pack_faces,
    pack_mask,
    pack_normals,
    pack_steps,
    unpack_colors,
    unpack_faces,
    unpack_mask,
    unpack_normals,
    unpack_steps,
)
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.records import Run
from zbuf_occlude.dataset.source import Arranged, Numbers, Source, arranged
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.sampling import SurfacePoints
from zbuf_occlude.views import Views

OPEN_FILES, KEPT_BLOCKS = 16, 4
"""Archives held open, and blocks held unpacked, by one reader in one process."""


def shard_name(shard: int) -> str:
    """Return what a shard's archive is called in the dataset's folder."""
    return f"packed-{shard:06d}.zip"


class PackedStore:
    """Collects the points and bits of a shard."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._members: list[tuple[str, bytes]] = []

    suffix: ClassVar[str] = ".zip"

    def keep(
        self, points: SurfacePoints, mask: BoolArray, views: Views, key: str, variation: int
    ) -> tuple[SurfacePoints, bytes, list[int]]:
        """Keep one sampling of a mesh: its points, the bits, the views that see nothing."""
        return points, pack_mask(mask), np.flatnonzero(~mask.any(axis=1)).tolist()

    def add(self, mesh_id: int, mesh: Mesh, kept: list[tuple[SurfacePoints, bytes, list[int]]]) -> None:
        """Take in what was kept of all samplings of a mesh."""
        entry, grid = self._plan.meshes[mesh_id], Grid.of_box(mesh.bounds)
        facts = {
            "key": entry.key,
            "label": entry.label,
            "split": entry.split,
            "n_points": [len(points) for points, _, _ in kept],
            "low": grid.low.tolist(),
            "step": grid.step,
            "centre": mesh.centre.tolist(),
            "longest_side": mesh.longest_side,
            "blind": [blind for _, _, blind in kept],
        }
        self._members.append((f"{mesh_id:06d}/mesh.json", json.dumps(facts).encode()))
        for variation, (points, bits, _) in enumerate(kept):
            name = f"{mesh_id:06d}/{variation}"
            self._members.append((f"{name}.steps", pack_steps(grid.rounded(points.positions))))
            self._members.append((f"{name}.faces", pack_faces(points.face_ids)))
            self._members.append((f"{name}.visible", bits))
            if "normals" in self._plan.recipe.attributes:
                self._members.append((f"{name}.normals", pack_normals(points.normals)))
            if "colors" in self._plan.recipe.attributes:
                colors = np.full((len(points), 3), GREY, np.uint8) if points.colors is None else points.colors
                self._members.append((f"{name}.colors", pack_colors(colors)))

    def write(self, path: Path, shard: int) -> list[Run]:
        """Write the archive, which is one run; times in it are fixed, so the same clouds give the same bytes."""

        def fill(file: IO[bytes]) -> None:
            with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
                for name, content in self._members:
                    member = zipfile.ZipInfo(name)
                    member.compress_type = zipfile.ZIP_DEFLATED
                    archive.writestr(member, content)

        atomic.write(path, fill)
        return [(path.stat().st_size, zlib.crc32(path.read_bytes()))]


class Block(NamedTuple):
    """One sampling of one mesh, unpacked.

    Parameters
    ----------
    points : SurfacePoints
        All n points, rounded; normals, if they are not kept, are zero.
    mask : (k, n) bool
        Which points each view of the plan sees.
    views : Views
        World units.
    """

    points: SurfacePoints
    mask: BoolArray
    views: Views


class Archives:
    """The blocks and clouds of some packed files; files are opened when they are needed, in each process anew.

    Parameters
    ----------
    plan : Plan
    paths : list of Path
        In the order of the plan's shards.

    Raises
    ------
    DatasetError
        A file is missing or damaged.
    """

    def __init__(self, plan: Plan, paths: list[Path]) -> None:
        self.plan = plan
        self._forget()
        self._facts: dict[int, dict[str, Any]] = {}
        self._path_of: dict[int, Path] = {}
        for path in paths:
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
        self._ends = np.cumsum([0, *map(len, self._seeing)])[1:]
        self.mesh_ids = np.repeat(np.array([m for m, _ in self.blocks], int), [len(each) for each in self._seeing])
        """The mesh of each cloud; clouds are numbered in the order of the plan: by mesh, variation, view."""

    def __getstate__(self) -> dict[str, Any]:
        state = self.__dict__.copy()
        for name in ("_open", "_kept"):  # another process opens its own
            del state[name]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._forget()

    def block(self, index: int) -> Block:
        """Unpack a block; the last few are kept."""
        if self._process != os.getpid():  # a file opened before a fork would be read at the other's position
            self._forget()
        if index not in self._kept:
            self._kept[index] = self._unpack(*self.blocks[index])
            if len(self._kept) > KEPT_BLOCKS:
                self._kept.popitem(last=False)
        self._kept.move_to_end(index)
        return self._kept[index]

    def place(self, number: int) -> tuple[int, int]:
        """Return the block and the view of a cloud's number."""
        block = int(self.blocks_of(np.asarray(number)))
        return block, int(self._seeing[block][number - self._ends[block]])  # counted from the block's end: negative

    def blocks_of(self, numbers: Numbers) -> Numbers:
        """Return the block of each cloud."""
        return np.searchsorted(self._ends, numbers, side="right")

    def source(self) -> Source:
        """Return the clouds, and the whole surfaces, as `generate` would draw them."""
        found = self.arranged()
        return Source(self.plan, found.order, self.take, self.blocks_of, self.complete, found.sizes)

    def arranged(self) -> Arranged:
        """Return the numbers of the clouds as they stand in the files that are written of them."""
        variations = np.repeat([v for _, v in self.blocks], [len(seeing) for seeing in self._seeing])
        views = np.concatenate([np.empty(0, int), *self._seeing])
        return arranged(self.plan, *order_of(self.plan).places(self.mesh_ids, variations, views))

    def take(self, numbers: Numbers) -> NDArray[Any]:
        """Return the records of some clouds: the same draw that `generate` makes, of the rounded points."""
        recipe = self.plan.recipe
        records = np.empty(len(numbers), record_type(recipe))
        places = np.array([self.place(number) for number in numbers]).reshape(-1, 2)
        for index in np.unique(places[:, 0]):
            rows = np.flatnonzero(places[:, 0] == index)
            mesh_id, variation = self.blocks[index]
            entry, block, views = self.plan.meshes[mesh_id], self.block(index), places[rows, 1]
            mask = np.ones_like(block.mask) if recipe.complete else block.mask
            found = gather_clouds(block.points, mask, block.views, recipe, entry.key, variation, which=views)
            found["mesh_id"], found["label"] = mesh_id, self.plan.classes.index(entry.label)
            records[rows] = found
        return records

    def complete(self, mesh_id: int, n_points: int) -> Any:
        """Return a record of `n_points` of an object's whole surface, hidden points too, of its first variation."""
        recipe = replace(self.plan.recipe, sample_size=n_points, complete=True)
        entry, block = self.plan.meshes[mesh_id], self.block(self.blocks.index((mesh_id, 0)))
        everything = np.ones_like(block.mask)
        (record,) = gather_clouds(block.points, everything, block.views, recipe, entry.key + "/complete", 0, which=[0])
        record["mesh_id"], record["label"] = mesh_id, self.plan.classes.index(entry.label)
        return record

    def _unpack(self, mesh_id: int, variation: int) -> Block:
        facts, path = self._facts[mesh_id], self._path_of[mesh_id]
        n_points, name = facts["n_points"][variation], f"{mesh_id:06d}/{variation}"
        with reading(path):
            archive = self._archive(path)
            steps, faces, bits = (archive.read(f"{name}.{kind}") for kind in ("steps", "faces", "visible"))
            more = {kind: archive.read(f"{name}.{kind}") for kind in self.plan.recipe.attributes}
        positions = Grid(np.asarray(facts["low"]), facts["step"]).positions(unpack_steps(steps, n_points))
        normals = unpack_normals(more["normals"], n_points) if "normals" in more else np.zeros_like(positions)
        colors = unpack_colors(more["colors"], n_points) if "colors" in more else None
        return Block(
            SurfacePoints(positions, unpack_faces(faces, n_points), normals, colors),
            unpack_mask(bits, len(self.plan.views), n_points),
            self.plan.views_of(self.plan.meshes[mesh_id].key).around(facts["centre"], facts["longest_side"]),
        )

    def _archive(self, path: Path) -> zipfile.ZipFile:
        if path not in self._open:
            self._open[path] = zipfile.ZipFile(path)
            if len(self._open) > OPEN_FILES:
                self._open.popitem(last=False)[1].close()
        self._open.move_to_end(path)
        return self._open[path]

    def _forget(self) -> None:
        self._process = os.getpid()
        self._open: OrderedDict[Path, zipfile.ZipFile] = OrderedDict()
        self._kept: OrderedDict[int, Block] = OrderedDict()


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
        plan, manifest = read_finished(Path(folder))
        if plan.format != "packed":
            raise DatasetError(f"{folder} must be in the format packed; it is in {plan.format}.")
        files = manifest["files"]
        if split is not None:
            check_word("split", split, files)
        names = sorted({name for names in files.values() for name in names})
        self.archives = Archives(plan, [Path(folder) / name for name in names])
        splits = np.array([entry.split for entry in plan.meshes])[self.archives.mesh_ids]
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
        (mesh_id, variation), (points, mask, views) = self.archives.blocks[index], self.archives.block(index)
        entry, seen, one = self.archives.plan.meshes[mesh_id], mask[view], views.select([view])
        return PackedCloud(
            points.positions[seen],
            points.face_ids[seen],
            points.normals[seen] if "normals" in self.archives.plan.recipe.attributes else None,
            None if points.colors is None else points.colors[seen],
            self.classes.index(entry.label),
            entry.key,
            mesh_id,
            variation,
            view,
            np.array([one.azimuth[0], one.elevation[0], one.distance[0]]),
            one.poses[0],
            len(points),
        )
