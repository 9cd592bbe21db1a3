"""Mesh: vertices and triangles as two arrays, with normals, areas and bounds."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.base.arrays import (
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
from zbuf_occlude.base.errors import ArgumentError, MeshError, check_choice
from zbuf_occlude.base.extras import importing
from zbuf_occlude.base.jit.compiler import njit
from zbuf_occlude.base.jit.vec3 import cross, dot, minus
from zbuf_occlude.base.provenance import UNKNOWN, MeshSource
from zbuf_occlude.geometry.colors import SurfaceColors, of_trimesh

HASH_FACTOR = 0x1E3779B97F4A7C15
"""Odd number without a pattern of bits, by which the hashes of rows are multiplied."""
NO_AREA = 1e-12
"""Length of a face's normal, as a share of its longest edge squared, up to which the face counts as having no area."""

UP = ("z", "y")
"""Axes that may point up in a file."""
UNITS = MappingProxyType({"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254})
"""Units of a file's coordinates, in metres."""


@dataclass(frozen=True, eq=False)
class Mesh(ReadOnlyArrays):
    """Triangle mesh in world space. Immutable: every transformation returns a new mesh.

    Parameters
    ----------
    vertices : (v, 3) float
        Positions; any unit. Stored as float64.
    faces : (f, 3) int
        Indices into `vertices`. Winding has no meaning (ModelNet's is inconsistent). Stored as int32.
    name : str
        Name in messages and manifests.
    source_face_ids : (f,) int, optional
        Index in the file of each face; ``arange(f)`` by default.
    dropped : dict of str to int
        Number of faces that `cleaned` removed, by reason.
    origin : MeshSource
        Source, if known: the content of the mesh's files, or a shape's recipe.
    colors : SurfaceColors, optional
        Base colours of the faces, if loaded.

    Raises
    ------
    MeshError
        No faces, or no vertices.
    ArgumentError
        Arrays of the wrong shape or type, NaN or infinite positions, indices out of range.

    Notes
    -----
    The constructor does not merge, reorder or repair anything; `cleaned` drops duplicate and degenerate faces, and
    `load_mesh` calls it.

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
        """Make a mesh of checked C-contiguous arrays, float64 and int32, without copying; the mesh owns them."""
        mesh = object.__new__(cls)
        arrays: dict[str, NDArray[Any]] = {"vertices": vertices, "faces": faces, "source_face_ids": source_face_ids}
        vars(mesh).update({key: set_readonly(array) for key, array in arrays.items()})
        vars(mesh).update(name=name, dropped=dropped, origin=origin, colors=colors)
        return mesh

    @classmethod
    def from_trimesh(cls, mesh: Any, name: str = "mesh", *, colors: bool = False) -> "Mesh":
        """Make a mesh of the vertices and faces of a ``trimesh.Trimesh``, not cleaned; optionally with its colours."""
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
            Open3D is not installed, or cannot be imported.
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
        x, y, z = self.face_normals.T.copy()  # three times as fast as norm(axis=1), with equal results
        return set_readonly(np.sqrt(x * x + y * y + z * z) / 2.0)

    @cached_property
    def bounds(self) -> FloatArray:
        """Lower and upper corner of the bounding box of the vertices in use, (2, 3)."""
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
        """Diagonal of the bounding box, to which the contact tolerance is relative."""
        return math.hypot(*np.ptp(self.bounds, axis=0))  # it does not underflow

    def in_box(self, positions: FloatArray) -> BoolArray:
        """Return which positions (n, 3) lie inside the bounding box, (n,)."""
        return np.asarray(((positions > self.bounds[0]) & (positions < self.bounds[1])).all(axis=1))

    def transformed(self, scale: float = 1.0, translation: ArrayLike = (0.0, 0.0, 0.0)) -> "Mesh":
        """Return the mesh with every vertex v moved to ``scale * v + translation``."""
        factor, shift = as_numbers(scale, "scale", ()), as_numbers(translation, "translation", (3,))
        with np.errstate(all="ignore"):  # overflow is reported when the new vertices are checked
            return self._with_vertices(self.vertices * factor + shift)

    def rotated(self, rotation: ArrayLike) -> "Mesh":
        """Return the mesh with every vertex v moved to ``rotation @ v``; rotation is (3, 3)."""
        matrix = as_numbers(rotation, "rotation", (3, 3), " Take the upper left of a (4, 4)?")
        with np.errstate(all="ignore"):
            return self._with_vertices(self.vertices @ matrix.T)

    def normalized(self) -> "Mesh":
        """Return the mesh centred at the origin with its longest side 1 (paper 3.4: "maximum dimension is 1")."""
        if self.longest_side == 0.0:
            raise MeshError(f"All vertices of {self.name} coincide, so it cannot be normalized.")
        return self._with_vertices((self.vertices - self.centre) / self.longest_side)

    def transparent(self, shares: Mapping[str, float | None]) -> "Mesh":
        """Return the mesh with only the materials named in `shares` transparent (`SurfaceColors.transparent`)."""
        return self if self.colors is None else replace(self, colors=self.colors.transparent(shares))

    def cleaned(self) -> "Mesh":
        """Return the mesh without duplicate faces and faces of no area; `dropped` counts the removed faces.

        Two faces are duplicates if their corners have the same three positions in any order; the first is kept. A face
        has no area if the length of its normal is at most `NO_AREA` times its longest edge squared. Vertices are
        neither merged nor reordered. `source_face_ids` are those of the faces before cleaning.

        Raises
        ------
        MeshError
            No face is left.
        """
        degenerate, duplicate = _faulty_faces(self.vertices, self.faces)
        keep = ~(degenerate | duplicate)
        if not keep.any():
            raise MeshError(f"All {len(keep)} faces of {self.name} have zero area.")
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
    """Raise OptionError unless `up` is in `UP` or None, and `unit` in `UNITS` or None."""
    if up is not None:
        check_choice("up", up, UP)
    if unit is not None:
        check_choice("unit", unit, UNITS)


def convert_frame(vertices: FloatArray, up: str | None, unit: str | None) -> FloatArray:
    """Return vertices (v, 3) with axis `up` turned to z and `unit` converted to metres; None leaves them."""
    if up == "y":
        vertices = np.stack([vertices[:, 0], 0.0 - vertices[:, 2], vertices[:, 1]], axis=1)
    return vertices if unit in (None, "m") else vertices * UNITS[unit]


def box_around(positions: FloatArray) -> Mesh:
    """Return the bounding box of (n, 3) positions, n > 0, as the mesh of a point cloud."""
    ends = np.stack([positions.min(axis=0), positions.max(axis=0)])
    corner = np.indices((2, 2, 2)).reshape(3, 8).T
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return Mesh(ends[corner, [0, 1, 2]], np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]), name="box")


@njit(cache=True, nogil=True)
def _fill_bounds(vertices, faces, is_used, bounds):
    """Fill (2, 3) with the bounds of the vertices in use; six times as fast as NumPy."""
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
    """Return which faces have no area and which are duplicates (`Mesh.cleaned`), each (f,) bool; -0.0 equals 0.0."""
    positions = _first_equal_rows((vertices + 0.0).view(np.int64))  # -0.0 + 0.0 is 0.0
    corners, degenerate = np.empty((len(faces), 3), dtype=np.int64), np.empty(len(faces), dtype=np.bool_)
    _fill_faulty(vertices, faces, positions, corners, degenerate)
    return degenerate, _first_equal_rows(corners) != np.arange(len(faces))


def _first_equal_rows(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the index of the first row equal to each row of (n, 3) int64, (n,) int64; O(n)."""
    first, bits = np.empty(len(rows), dtype=np.int64), len(rows).bit_length() + 1
    _fill_first_equal(rows.view(np.uint64), 64 - bits, np.full(1 << bits, -1, dtype=np.int64), first)
    return first


@njit(cache=True, nogil=True)
def _fill_first_equal(rows, shift, table, first):
    """Fill in the first row equal to each, by a hash table of row indices, -1 where empty, with linear probing.

    The high bits of a product depend on all bits of its factors, unlike the low ones: many coordinates end in zeros.
    """
    factor, half = np.uint64(HASH_FACTOR), np.uint64(32)
    for i in range(len(rows)):
        code = np.uint64(0)
        for axis in range(3):
            code = (code ^ rows[i, axis]) * factor
            code ^= code >> half
        slot = np.int64((code * factor) >> np.uint64(shift))
        while table[slot] >= 0 and (
            rows[table[slot], 0] != rows[i, 0]
            or rows[table[slot], 1] != rows[i, 1]
            or rows[table[slot], 2] != rows[i, 2]
        ):
            slot = (slot + 1) & (len(table) - 1)
        if table[slot] < 0:
            table[slot] = i
        first[i] = table[slot]


@njit(cache=True, nogil=True)
def _fill_faulty(vertices, faces, positions, corners, degenerate):
    """Fill in the position ids of each face's corners in ascending order, and whether the face has no area."""
    for i in range(len(faces)):
        first, second, third = positions[faces[i, 0]], positions[faces[i, 1]], positions[faces[i, 2]]
        low, high = min(first, second, third), max(first, second, third)
        corners[i, 0], corners[i, 1], corners[i, 2] = low, first + second + third - low - high, high
        a, b, c = vertices[faces[i, 0]], vertices[faces[i, 1]], vertices[faces[i, 2]]
        u, v, w = minus(b, a), minus(c, a), minus(c, b)
        n = cross(u, v)
        longest = max(dot(u, u), dot(v, v), dot(w, w))
        degenerate[i] = math.sqrt(dot(n, n)) <= NO_AREA * longest
