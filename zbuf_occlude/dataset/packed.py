"""Packed datasets: all points of each object once a variation, and one visibility bit for each point and view.

    clouds = PackedDataset("occluded", split="train")
    clouds[7].positions, clouds[7].label                 # all visible points of one view, in the mesh's own units

Each file is a ZIP archive; any language reads it. For mesh 17 of the plan and its variation 2 it holds

    000017/mesh.json    key, label, split; n_points of each variation; low, step: positions are low + step * q;
                        centre, longest_side; blind: for each variation the views that see nothing
    000017/2.steps      q of all points, three 16-bit integers each (`zbuf_occlude.dataset.packing`)
    000017/2.faces      the face each point lies on
    000017/2.visible    for each view of the plan a row of bits, one per point
    000017/2.scans      of scans instead of 2.visible: their points, not rounded (`packing.pack_scans`);
                        all else is then of the object as it stood before the sensor, in metres
    000017/2.normals    with `Recipe.attributes`: unit normals, as the faces are wound, three floats each
    000017/2.colors     likewise: red, green, blue

The views are those of plan.json, about `centre` at multiples of `longest_side`. Visibility was computed for
the points before they were rounded; rounding moves a point by at most half a step along each axis, a 131,070th of the
longest side.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import overload

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.dataset.folder import read_finished
from zbuf_occlude.dataset.formats.packed import PackedFiles
from zbuf_occlude.dataset.source import Numbers
from zbuf_occlude.errors import DatasetError, check_word


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
        self.archives = PackedFiles(plan, [Path(folder) / name for name in names])
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
        (mesh_id, variation), (points, mask, views, whole) = self.archives.blocks[index], self.archives.block(index)
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
            len(whole),
        )
