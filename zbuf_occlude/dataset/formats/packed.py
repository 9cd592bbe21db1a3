"""Packed archives: all points of the objects, and a bit for each point and view; `dataset/packed.py` has the layout."""

import json
import os
import zipfile
from collections import OrderedDict
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.atomic import reading
from zbuf_occlude.dataset.clouds import ScanPoints, gather_clouds, record_type
from zbuf_occlude.dataset.packing import (
    Grid,
    pack_colors,
    pack_faces,
    pack_mask,
    pack_normals,
    pack_scans,
    pack_steps,
    unpack_colors,
    unpack_faces,
    unpack_mask,
    unpack_normals,
    unpack_scans,
    unpack_steps,
)
from zbuf_occlude.dataset.pipeline import Sampling
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.scans import standing_points
from zbuf_occlude.dataset.source import IDS, Arranged, Numbers, Source, arranged
from zbuf_occlude.geometry.colors import GREY
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints
from zbuf_occlude.sensors.capture import in_metres
from zbuf_occlude.views import Views

OPEN_FILES, KEPT_BLOCKS = 16, 4
"""Files held open, and blocks held unpacked, by one reader in one process."""


def archive_name(batch: int) -> str:
    """Return the name of a batch's archive."""
    return f"packed-{batch:06d}.zip"


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the clouds as `generate` would draw them, in the order in which it would write them."""
    names = sorted({name for of_split in files.values() for name in of_split})
    return PackedFiles(plan, [out / name for name in names]).source()


class Archive:
    """Collects the points and bits of a batch, and writes its archive."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._members: list[tuple[str, bytes]] = []

    def keep(self, sampling: Sampling, key: str, variation: int) -> tuple[SurfacePoints, bytes, list[int]]:
        """Return of one sampling of a mesh the points, bits or scans as bytes, and the views that see nothing."""
        points, mask, views = sampling[:3]
        seen = pack_scans(points, mask, views) if isinstance(points, ScanPoints) else pack_mask(mask)
        return points, seen, np.flatnonzero(~mask.any(axis=1)).tolist()

    def add(self, mesh_id: int, mesh: Mesh, kept: list[tuple[SurfacePoints, bytes, list[int]]]) -> None:
        """Take what was kept of all samplings of a mesh."""
        entry, recipe = self._plan.meshes[mesh_id], self._plan.recipe
        kind, samples = "visible", [points for points, _, _ in kept]
        if recipe.setup is not None:
            kind = "scans"
            samples = [standing_points(mesh, entry.label, recipe, entry.key, i) for i in range(len(kept))]
            mesh, _ = in_metres(mesh, entry.label, recipe.setup)
        grid = Grid.of_box(mesh.bounds)
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
        self._members.append((f"{mesh_id:06d}/mesh.json", json.dumps(facts).encode()))
        for variation, (points, (_, seen, _)) in enumerate(zip(samples, kept, strict=True)):
            name = f"{mesh_id:06d}/{variation}"
            self._members.append((f"{name}.steps", pack_steps(grid.rounded(points.positions))))
            self._members.append((f"{name}.faces", pack_faces(points.face_ids)))
            self._members.append((f"{name}.{kind}", seen))
            if "normals" in recipe.attributes:
                self._members.append((f"{name}.normals", pack_normals(points.normals)))
            if "colors" in recipe.attributes:
                colors = np.full((len(points), 3), GREY, np.uint8) if points.colors is None else points.colors
                self._members.append((f"{name}.colors", pack_colors(colors)))

    def write(self, path: Path) -> None:
        """Write the archive; times in it are fixed, so the same clouds give the same bytes."""

        def fill(file: IO[bytes]) -> None:
            with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
                for name, content in self._members:
                    member = zipfile.ZipInfo(name)
                    member.compress_type = zipfile.ZIP_DEFLATED
                    archive.writestr(member, content)

        atomic.write(path, fill)


class Block(NamedTuple):
    """One sampling of one mesh, or its scans and a sampling, unpacked.

    Parameters
    ----------
    points : SurfacePoints
        The n points that views see: all of the sampling, or those of all scans.
    mask : (k, n) bool
        Which points each view of the plan sees.
    views : Views
        World units; of scans metres.
    whole : SurfacePoints
        The sampling of the whole surface, rounded; normals, if they are not kept, are zero.
    """

    points: SurfacePoints
    mask: BoolArray
    views: Views
    whole: SurfacePoints


class PackedFiles:
    """The blocks and clouds of some packed files; files are opened when they are needed, in each process anew.

    Parameters
    ----------
    plan : Plan
    paths : list of Path

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
        return Source(self.plan, found.order, self.take, self.blocks_of, self.complete, found.sizes, self._ids)

    def arranged(self) -> Arranged:
        """Return the numbers of the clouds as they stand in the files that are written of them."""
        ids = self._ids()
        return arranged(self.plan, *self.plan.placement.of(ids["mesh_id"], ids["variation"], ids["view_id"]))

    def _ids(self) -> NDArray[Any]:
        ids = np.empty(len(self.mesh_ids), IDS)
        ids["mesh_id"] = self.mesh_ids
        ids["variation"] = np.repeat([v for _, v in self.blocks], [len(seeing) for seeing in self._seeing])
        ids["view_id"] = np.concatenate([np.empty(0, int), *self._seeing])
        return ids

    def take(self, numbers: Numbers) -> NDArray[Any]:
        """Return the records of some clouds: the same draw that `generate` makes, of the rounded points."""
        recipe = self.plan.recipe
        records = np.empty(len(numbers), record_type(recipe))
        places = np.array([self.place(number) for number in numbers]).reshape(-1, 2)
        for index in np.unique(places[:, 0]):
            rows = np.flatnonzero(places[:, 0] == index)
            mesh_id, variation = self.blocks[index]
            entry, block, views = self.plan.meshes[mesh_id], self.block(index), places[rows, 1]
            points, mask = (block.whole, _everything(block)) if recipe.complete else (block.points, block.mask)
            found = gather_clouds(points, mask, block.views, recipe, entry.key, variation, which=views)
            found["mesh_id"], found["label"] = mesh_id, self.plan.classes.index(entry.label)
            records[rows] = found
        return records

    def complete(self, mesh_id: int, n_points: int) -> Any:
        """Return a record of `n_points` of an object's whole surface, hidden points too, of its first variation."""
        recipe = replace(self.plan.recipe, sample_size=n_points, complete=True)
        entry, block = self.plan.meshes[mesh_id], self.block(self.blocks.index((mesh_id, 0)))
        key, everything = entry.key + "/complete", _everything(block)
        (record,) = gather_clouds(block.whole, everything, block.views, recipe, key, 0, which=[0])
        record["mesh_id"], record["label"] = mesh_id, self.plan.classes.index(entry.label)
        return record

    def _unpack(self, mesh_id: int, variation: int) -> Block:
        facts, path, recipe = self._facts[mesh_id], self._path_of[mesh_id], self.plan.recipe
        n_points, name = facts["n_points"][variation], f"{mesh_id:06d}/{variation}"
        with reading(path):
            archive = self._archive(path)
            steps, faces = archive.read(f"{name}.steps"), archive.read(f"{name}.faces")
            more = {kind: archive.read(f"{name}.{kind}") for kind in recipe.attributes}
            scans = None if recipe.setup is None else unpack_scans(archive.read(f"{name}.scans"))
            bits = archive.read(f"{name}.visible") if scans is None else b""
        positions = Grid(np.asarray(facts["low"]), facts["step"]).positions(unpack_steps(steps, n_points))
        normals = unpack_normals(more["normals"], n_points) if "normals" in more else np.zeros_like(positions)
        colors = unpack_colors(more["colors"], n_points) if "colors" in more else None
        face_ids = unpack_faces(faces, n_points)
        if scans is not None:
            size = {"size": np.array([facts["longest_side"]])}
            return Block(*scans, ScanPoints(positions, face_ids, normals, colors, facts=size))
        points = SurfacePoints(positions, face_ids, normals, colors)
        mask = unpack_mask(bits, len(self.plan.views), n_points)
        views = self.plan.views_of(self.plan.meshes[mesh_id].key)
        return Block(points, mask, views.around(facts["centre"], facts["longest_side"]), points)

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


def _everything(block: Block) -> BoolArray:
    """A mask of the whole surface for each view."""
    return np.ones((len(block.mask), len(block.whole)), dtype=bool)
