"""Mesh: vertices and triangles as two arrays, with the few measures that everything else needs."""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    ReadOnlyArrays,
    as_array,
    as_indices,
    as_numbers,
    as_vectors,
    readonly_copy,
    set_readonly,
)
from zbuf_occlude.errors import ArgumentError, MeshError, check_choice
from zbuf_occlude.extras import importing
from zbuf_occlude.geometry.colors import WHITE, SurfaceColors, of_trimesh
from zbuf_occlude.jit.compiler import njit
from zbuf_occlude.jit.vec3 import cross, dot, minus
from zbuf_occlude.provenance import UNKNOWN, MeshSource

NO_AREA = 1e-12
"""A face has no area when the length of its normal is at most this times its longest edge squared."""

MeshLike = Any
"""What `as_mesh` takes."""

UP = ("z", "y")
"""Axes that may point up in a file."""
UNITS = MappingProxyType({"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254})
"""Units that a file may be in, and their metres."""


@dataclass(frozen=True, eq=False)
class Mesh(ReadOnlyArrays):
    """A triangle mesh in world space. Immutable, its measures too: every transformation returns a new one.

    Parameters
    ----------
    vertices : (v, 3) float
        Positions; any unit. Stored as float64.
    faces : (f, 3) int
        Indices into `vertices`. Winding carries no meaning (ModelNet's is inconsistent). Stored as int32.
    name : str
        Shown in messages and manifests.
    source_face_ids : (f,) int, optional
        For each face the face of the file it came from; ``arange(f)`` by default.
    dropped : dict of str to int
        What `cleaned` removed, by reason.
    origin : MeshSource
        What it was made of, where that is known: the content of its files, or a shape's recipe.
    colors : SurfaceColors, optional
        Base colours of the faces, where they were asked for.

    Raises
    ------
    MeshError
        No faces, or no vertices.
    ArgumentError
        Arrays of the wrong shape or type, NaN or infinite positions, indices out of range.

    Notes
    -----
    Nothing is merged, reordered or repaired here; `cleaned` drops duplicate and degenerate faces,
    and `load_mesh` calls it once.

    Examples
    --------
    >>> mesh = zo.Mesh([[0, 0, 0], [2, 0, 0], [0, 1, 0]], [[0, 1, 2]], name="triangle")
    >>> mesh
    Mesh('triangle', 3 vertices, 1 faces)
    >>> mesh.normalized().bounds.tolist()
    [[-0.5, -0.25, 0.0], [0.5, 0.25, 0.0]]
    """

    vertices: FloatArray
    faces: IntArray
    name: str = "mesh"
    source_face_ids: IntArray | None = None
    dropped: dict[str, int] = field(default_factory=dict)
    origin: MeshSource = UNKNOWN
    colors: SurfaceColors | None = None

    def __post_init__(self) -> None:
        vertices = as_vectors(self.vertices, "vertices")
        faces = as_array(self.faces, "faces", "(n, 3) int", "Triangulate first.")
        if len(vertices) == 0 or faces.size == 0:
            raise MeshError(
                f"a mesh must have vertices and faces; {self.name} has {len(vertices)} vertices and "
                f"{len(np.atleast_1d(faces))} faces. Is it a point cloud or an empty file?"
            )
        if faces.ndim == 2 and faces.shape[1] == 4:
            raise ArgumentError(f"faces must be triangles, (n, 3) int; got quads, {faces.shape}. Triangulate first.")
        faces = as_indices(faces, "faces", columns=3, upper=len(vertices))
        source = np.arange(len(faces)) if self.source_face_ids is None else self.source_face_ids
        source = as_indices(source, "source_face_ids", columns=None, upper=np.iinfo(np.int32).max)
        if len(source) != len(faces):
            raise MeshError(f"source_face_ids must have one entry a face ({len(faces)}); got {len(source)}.")
        if self.colors is not None and len(self.colors.material_ids) != len(faces):
            raise MeshError(
                f"colors must be of {len(faces)} faces; they are of {len(self.colors.material_ids)}. Select alike."
            )
        vars(self).update(
            vertices=readonly_copy(vertices), faces=readonly_copy(faces), source_face_ids=readonly_copy(source)
        )

    def __repr__(self) -> str:
        return f"Mesh({self.name!r}, {len(self.vertices)} vertices, {len(self.faces)} faces)"

    @classmethod
    def of_checked(
        cls,
        vertices: FloatArray,
        faces: IntArray,
        name: str,
        source_face_ids: IntArray,
        dropped: dict[str, int],
        origin: MeshSource,
        colors: SurfaceColors | None = None,
    ) -> "Mesh":
        """Take over C-contiguous arrays that were checked already, float64 and int32, and that no one else holds."""
        mesh = object.__new__(cls)
        arrays: dict[str, NDArray[Any]] = {"vertices": vertices, "faces": faces, "source_face_ids": source_face_ids}
        vars(mesh).update({key: set_readonly(array) for key, array in arrays.items()})
        vars(mesh).update(name=name, dropped=dropped, origin=origin, colors=colors)
        return mesh

    @classmethod
    def from_trimesh(cls, mesh: Any, name: str = "mesh", *, colors: bool = False) -> "Mesh":
        """Take vertices and faces of a ``trimesh.Trimesh`` as they are (not cleaned), and its colours if asked for."""
        if not (hasattr(mesh, "vertices") and hasattr(mesh, "faces")):
            raise ArgumentError(
                f"mesh must be a trimesh.Trimesh; got {type(mesh).__name__}. Make one mesh of a scene: scene.to_mesh()."
            )
        found = of_trimesh(mesh) if colors else None
        return cls(np.asarray(mesh.vertices), np.asarray(mesh.faces), name=name, colors=found)

    def to_trimesh(self) -> Any:
        """Return a ``trimesh.Trimesh`` with copies of vertices and faces, nothing merged."""
        import trimesh

        return trimesh.Trimesh(np.array(self.vertices), np.array(self.faces), process=False)

    def to_open3d(self) -> Any:
        """Return an ``open3d.geometry.TriangleMesh`` with copies of vertices and faces.

        Raises
        ------
        UnavailableError
            Open3D is not installed, or broken.
        """
        with importing("open3d", "Mesh.to_open3d"):
            import open3d

            floats, integers = open3d.utility.Vector3dVector, open3d.utility.Vector3iVector
        return open3d.geometry.TriangleMesh(floats(np.array(self.vertices)), integers(np.array(self.faces)))

    @cached_property
    def corners(self) -> FloatArray:
        """Corner positions of every face, (f, 3 corners, 3)."""
        return set_readonly(self.vertices.take(self.faces, axis=0))  # three times as fast as vertices[faces]

    @cached_property
    def face_normals(self) -> FloatArray:
        """Normals of the faces, (f, 3), *not* of unit length: n = (b - a) x (c - a) (paper Eq. 1)."""
        normals = np.empty((len(self.faces), 3))
        _fill_normals(self.corners, normals)
        return set_readonly(normals)

    @cached_property
    def areas(self) -> FloatArray:
        """Areas of the faces, (f,) (paper Eq. 4)."""
        x, y, z = self.face_normals.T.copy()  # three times as fast as norm(axis=1), the same numbers
        return set_readonly(np.sqrt(x * x + y * y + z * z) / 2.0)

    @cached_property
    def bounds(self) -> FloatArray:
        """Lower and upper corner of the axis-aligned box of the vertices in use, (2, 3)."""
        bounds = np.empty((2, 3))
        _fill_bounds(self.vertices, self.faces, np.zeros(len(self.vertices), dtype=bool), bounds)
        return set_readonly(bounds)

    @cached_property
    def centre(self) -> FloatArray:
        """Centre of the bounding box, (3,)."""
        return set_readonly((self.bounds[0] + self.bounds[1]) / 2.0)

    @cached_property
    def longest_side(self) -> float:
        """Longest side of the bounding box: the paper's "maximum dimension"."""
        return float(np.ptp(self.bounds, axis=0).max())

    @cached_property
    def diagonal(self) -> float:
        """Diagonal of the bounding box; the length that the contact tolerance is relative to."""
        return float(np.linalg.norm(np.ptp(self.bounds, axis=0)))

    def in_box(self, positions: FloatArray) -> BoolArray:
        """Return which positions (n, 3) lie inside the bounding box, (n,)."""
        return np.asarray(((positions > self.bounds[0]) & (positions < self.bounds[1])).all(axis=1))

    def transformed(self, scale: float = 1.0, translation: ArrayLike = (0.0, 0.0, 0.0)) -> "Mesh":
        """Return the mesh with every vertex v moved to ``scale * v + translation``."""
        factor, shift = as_numbers(scale, "scale", ()), as_numbers(translation, "translation", (3,))
        with np.errstate(all="ignore"):  # what overflows is judged as the vertices that it gives
            return self._with_vertices(self.vertices * factor + shift)

    def rotated(self, rotation: ArrayLike) -> "Mesh":
        """Return the mesh with every vertex v moved to ``rotation @ v``; rotation is (3, 3)."""
        matrix = as_numbers(rotation, "rotation", (3, 3), " Take the upper left of a (4, 4)?")
        with np.errstate(all="ignore"):
            return self._with_vertices(self.vertices @ matrix.T)

    def normalized(self) -> "Mesh":
        """Return the mesh centred at the origin with its longest side 1 (paper 3.4: "maximum dimension is 1")."""
        if self.longest_side == 0.0:
            raise MeshError(f"a mesh must have an extent to be normalized; all vertices of {self.name} coincide.")
        return self._with_vertices((self.vertices - self.centre) / self.longest_side)

    def transparent(self, shares: Mapping[str, float | None]) -> "Mesh":
        """Return the mesh with only those materials transparent that `shares` name (`SurfaceColors.transparent`)."""
        return self if self.colors is None else replace(self, colors=self.colors.transparent(shares))

    def cleaned(self) -> "Mesh":
        """Return the mesh without duplicate faces and faces of no area, and count what went in `dropped`.

        Two faces are duplicates when their corners have the same three positions in any order; the first stays.
        A face has no area when the length of its normal is at most `NO_AREA` times its longest edge squared.
        Vertices are neither merged nor reordered. `source_face_ids` leads back to the faces before cleaning.

        Raises
        ------
        MeshError
            Nothing is left.
        """
        degenerate, duplicate = _faulty_faces(self.vertices, self.faces)
        keep = ~(degenerate | duplicate)
        if not keep.any():
            raise MeshError(f"a mesh must have faces of some area; none of the {len(keep)} faces of {self.name} has.")
        dropped = {
            **self.dropped,
            "degenerate": self.dropped.get("degenerate", 0) + int(degenerate.sum()),
            "duplicate": self.dropped.get("duplicate", 0) + int((duplicate & ~degenerate).sum()),
        }
        assert self.source_face_ids is not None  # set in __post_init__; for the type checker
        colors = None if self.colors is None else self.colors.select(keep)
        return Mesh.of_checked(
            self.vertices,
            self.faces.compress(keep, axis=0),  # four times as fast as faces[keep]
            self.name,
            self.source_face_ids.compress(keep),
            dropped,
            self.origin,
            colors,
        )

    def _with_vertices(self, vertices: FloatArray) -> "Mesh":
        return Mesh(vertices, self.faces, self.name, self.source_face_ids, self.dropped, self.origin, self.colors)


def check_frame(up: str | None, unit: str | None) -> None:
    """Raise OptionError where `up` is no axis of `UP`, or `unit` none of `UNITS`; None is neither."""
    if up is not None:
        check_choice("up", up, UP)
    if unit is not None:
        check_choice("unit", unit, UNITS)


def stood(vertices: FloatArray, up: str | None, unit: str | None) -> FloatArray:
    """Return vertices (v, 3) with z up and in metres, of such with `up` up and in `unit`; None: as they are."""
    if up == "y":
        vertices = np.stack([vertices[:, 0], 0.0 - vertices[:, 2], vertices[:, 1]], axis=1)
    return vertices if unit in (None, "m") else vertices * UNITS[unit]


def as_mesh(mesh: MeshLike, *, up: str | None = None, unit: str | None = None, colors: bool = False) -> Mesh:
    """Return a Mesh of anything that is one.

    Parameters
    ----------
    mesh : Mesh, path, trimesh.Trimesh, open3d TriangleMesh, or (vertices, faces)
        Also any object with `vertices` and `faces` or `triangles`. A file is loaded and cleaned (`load_mesh`); arrays
        are taken as they are, so that face ids index the faces that were given.
    up, unit : str, optional
        As in `load_mesh`, of whatever it is: "z" or "y", and "mm", "cm", "m" or "in".
    colors : bool
        Take base colours too, of what has them.

    Raises
    ------
    ArgumentError
        None of these, or faces that are not triangles.
    MeshError, OptionError
        As `load_mesh`.
    """
    if isinstance(mesh, str | os.PathLike):
        from zbuf_occlude.meshes.load import load_mesh  # late: reading files is a floor above

        return load_mesh(mesh, up=up, unit=unit, colors=colors)
    check_frame(up, unit)
    found = _of_object(mesh, colors)
    if up in (None, "z") and unit in (None, "m"):
        return found
    return replace(found, vertices=stood(found.vertices, up, unit))


def _of_object(mesh: MeshLike, colors: bool) -> Mesh:
    """Return a Mesh of an object that is one."""
    if isinstance(mesh, Mesh):
        return mesh
    if isinstance(mesh, tuple | list) and len(mesh) == 2:
        return Mesh(*mesh)
    if hasattr(mesh, "to_legacy"):  # of Open3D's tensors
        mesh = mesh.to_legacy()
    if hasattr(mesh, "vertices") and hasattr(mesh, "faces"):
        return Mesh.from_trimesh(mesh, colors=colors)
    if hasattr(mesh, "vertices") and hasattr(mesh, "triangles"):
        faces, found = np.asarray(mesh.triangles), None
        if colors and len(per_vertex := np.asarray(getattr(mesh, "vertex_colors", ()))):
            found = SurfaceColors((WHITE,), np.zeros(len(faces), np.int32), per_vertex[faces])
        return Mesh(np.asarray(mesh.vertices), faces, colors=found)
    hint = " Make one mesh of a scene: scene.to_mesh()." if hasattr(mesh, "to_mesh") else ""
    raise ArgumentError(
        "mesh must be a path, a Mesh, (vertices, faces), or have vertices and faces or triangles, as those of trimesh "
        f"and Open3D; got {type(mesh).__name__}.{hint}"
    )


def box_around(positions: FloatArray) -> Mesh:
    """Return the box, along the axes, around (n, 3) positions, n > 0: what a cloud has instead of a mesh."""
    ends = np.stack([positions.min(axis=0), positions.max(axis=0)])
    corner = np.indices((2, 2, 2)).reshape(3, 8).T
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return Mesh(ends[corner, [0, 1, 2]], np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]), name="box")


@njit(cache=True, nogil=True)
def _fill_bounds(vertices, faces, is_used, bounds):
    """Fill (2, 3) with the bounds of the vertices that faces have; six times as fast as NumPy."""
    for face in range(len(faces)):
        is_used[faces[face, 0]] = is_used[faces[face, 1]] = is_used[faces[face, 2]] = True
    low, high = (math.inf, math.inf, math.inf), (-math.inf, -math.inf, -math.inf)
    for i in range(len(vertices)):
        if is_used[i]:
            x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
            low = min(low[0], x), min(low[1], y), min(low[2], z)
            high = max(high[0], x), max(high[1], y), max(high[2], z)
    for axis in range(3):
        bounds[0, axis], bounds[1, axis] = low[axis], high[axis]


@njit(cache=True, nogil=True)
def _fill_normals(corners, normals):
    """Fill (f, 3) with the normals (b - a) x (c - a) of faces (f, 3 corners, 3), not of unit length."""
    for face in range(len(corners)):
        a, b, c = corners[face, 0], corners[face, 1], corners[face, 2]
        n = cross(minus(b, a), minus(c, a))
        normals[face, 0], normals[face, 1], normals[face, 2] = n[0], n[1], n[2]


def _faulty_faces(vertices: FloatArray, faces: IntArray) -> tuple[BoolArray, BoolArray]:
    """Return which faces have no area and which are duplicates, as `Mesh.cleaned` says, each (f,) bool; 0.0 is -0.0."""
    positions = _first_equal_rows((vertices + 0.0).view(np.int64))  # -0.0 + 0.0 is 0.0
    corners, degenerate = np.empty((len(faces), 3), dtype=np.int64), np.empty(len(faces), dtype=np.bool_)
    _look_at_faces(vertices, faces, positions, corners, degenerate)
    return degenerate, _first_equal_rows(corners) != np.arange(len(faces))


def _first_equal_rows(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """For each row of (n, 3) int64 the first row that equals it, (n,) int64."""
    first, table = np.empty(len(rows), dtype=np.int64), np.full(1 << max(4, (2 * len(rows) - 1).bit_length()), -1)
    _fill_first_equal(rows, table, first)
    return first


@njit(cache=True, nogil=True)
def _fill_first_equal(rows, table, first):
    """Enter rows in a hash table with open addresses: a power of two, twice as many as rows; -1 where nothing is."""
    size = len(table)
    for i in range(len(rows)):
        mixed = np.uint64(0)
        for axis in range(3):  # the constants and shifts are those of SplitMix64
            mixed = (mixed ^ np.uint64(rows[i, axis])) * np.uint64(0xBF58476D1CE4E5B9)
            mixed ^= mixed >> np.uint64(31)
        mixed *= np.uint64(0x94D049BB133111EB)
        slot = np.int64((mixed ^ (mixed >> np.uint64(32))) & np.uint64(size - 1))
        while True:
            other = table[slot]
            if other < 0:
                table[slot] = other = i
            if rows[other, 0] == rows[i, 0] and rows[other, 1] == rows[i, 1] and rows[other, 2] == rows[i, 2]:
                first[i] = other
                break
            slot = (slot + 1) & (size - 1)


@njit(cache=True, nogil=True)
def _look_at_faces(vertices, faces, positions, corners, degenerate):
    """Fill in the positions, given by number, of each face's corners in ascending order, and whether it has no area."""
    for i in range(len(faces)):
        first, second, third = positions[faces[i, 0]], positions[faces[i, 1]], positions[faces[i, 2]]
        low, high = min(first, second, third), max(first, second, third)
        corners[i, 0], corners[i, 1], corners[i, 2] = low, first + second + third - low - high, high
        a, b, c = vertices[faces[i, 0]], vertices[faces[i, 1]], vertices[faces[i, 2]]
        u, v, w = minus(b, a), minus(c, a), minus(c, b)
        n = cross(u, v)
        longest = max(dot(u, u), dot(v, v), dot(w, w))
        degenerate[i] = math.sqrt(dot(n, n)) <= NO_AREA * longest
