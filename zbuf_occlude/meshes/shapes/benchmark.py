"""Meshes of a chosen number of faces, for measurements of time and error."""

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.errors import OptionError, check_int
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.shapes.families import make

Indices = NDArray[np.int64]
_DETAILS = (0.55, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 9.0)


def benchmark_mesh(n_faces: int, label: str = "airplane", index: int = 0) -> Mesh:
    """Return a member of a family with a chosen number of faces, all of them small.

    The member is tessellated finely, to at most half of `n_faces`. Then its longest edges are halved until the number
    is reached: large flat faces become many small ones, and the surface stays.

    Parameters
    ----------
    n_faces : int
        Number of faces: at least that of the member's coarsest tessellation (hundreds to thousands).
    label, index
        As in `make`.

    Returns
    -------
    Mesh
        Between ``n_faces - 8`` and ``n_faces`` faces. Cleaned.

    Raises
    ------
    OptionError
        Fewer faces than the member can have, an unknown label, a negative index.
    """
    mesh = make(label, index, detail=_DETAILS[0])
    if n_faces < len(mesh.faces):
        raise OptionError(f"n_faces must be at least {len(mesh.faces)} for {label} {index}; got {n_faces}.")
    for detail in _DETAILS[1:]:
        finer = make(label, index, detail=detail)
        if len(finer.faces) > n_faces // 2:
            break
        mesh = finer
    return refined(mesh, n_faces)


def soup(n_faces: int, size: float = 0.1, seed: int = 0) -> Mesh:
    """Return random triangles in a unit cube, about `size` long, most of which intersect."""
    check_int("n_faces", n_faces, 1)
    rng = np.random.default_rng(seed)
    corners = rng.random((n_faces, 1, 3)) + rng.normal(scale=size / 2, size=(n_faces, 3, 3))
    faces = np.arange(3 * n_faces, dtype=np.int32).reshape(-1, 3)
    return Mesh(corners.reshape(-1, 3), faces, name=f"soup_{n_faces}").normalized()


def refined(mesh: Mesh, n_faces: int) -> Mesh:
    """Return a mesh whose longest edges are halved until it has between ``n_faces - 8`` and `n_faces` faces.

    Both faces at an edge are divided at the same midpoint, even where each face has its own vertices: no gap opens and
    the surface stays.
    """
    # equal positions become one vertex, so that faces at an edge share it
    points, which = np.unique(mesh.vertices + 0.0, axis=0, return_inverse=True)
    faces: Indices = which.reshape(-1)[mesh.faces].astype(np.int64)
    while True:
        edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)
        keys = (edges[..., 0] * len(points) + edges[..., 1]).ravel()
        unique, which, counts = np.unique(keys, return_inverse=True, return_counts=True)
        low, high = np.divmod(unique, len(points))
        length = np.linalg.norm(points[low] - points[high], axis=1)
        order = np.argsort(-length, kind="stable")
        # a face with m halved edges becomes m + 1 faces, so an edge adds as many faces as meet at it
        fits = np.cumsum(counts[order]) <= n_faces - len(faces)
        halved = order[fits & (length[order] > 0.6 * length[order[0]])]
        if len(halved) == 0:
            return Mesh(points, faces.astype(np.int32), name=f"{mesh.name}_{len(faces)}").cleaned()
        middle = np.full(len(unique), -1)
        middle[halved] = len(points) + np.arange(len(halved))
        points = np.concatenate([points, (points[low[halved]] + points[high[halved]]) / 2])
        faces = _divided(faces, middle[which].reshape(-1, 3))


def with_vertices(mesh: Mesh, n_vertices: int) -> Mesh:
    """Return a mesh in which corners have their own vertices until there are `n_vertices`, as in files without sharing.

    Parameters
    ----------
    mesh : Mesh
    n_vertices : int
        Number of vertices: at least those that the mesh's faces use, at most three per face.

    Returns
    -------
    Mesh
        The same faces at the same positions, without vertices that no face uses.

    Raises
    ------
    OptionError
        `n_vertices` is out of range.
    """
    used, corners = np.unique(mesh.faces, return_inverse=True)
    corners = corners.reshape(-1).astype(np.int64)
    if not len(used) <= n_vertices <= len(corners):
        raise OptionError(f"n_vertices must be from {len(used)} to {len(corners)} for {mesh.name}; got {n_vertices}.")
    first = np.zeros(len(corners), dtype=bool)
    first[np.unique(corners, return_index=True)[1]] = True
    moved = np.flatnonzero(~first)[: n_vertices - len(used)]
    points = np.concatenate([mesh.vertices[used], mesh.vertices[used[corners[moved]]]])
    corners[moved] = len(used) + np.arange(len(moved))
    return Mesh(points, corners.reshape(-1, 3).astype(np.int32), name=mesh.name)


def _divided(faces: Indices, middles: Indices) -> Indices:
    """Return faces (f, 3) divided at midpoints of their edges ab, bc, ca, (f, 3); -1 for an undivided edge."""
    count = (middles >= 0).sum(axis=1)
    # rotate each face so that one halved edge comes first, and a single whole edge last
    first = np.where(count == 2, np.argmin(middles, axis=1) + 1, np.argmax(middles >= 0, axis=1)) % 3
    turn = (first[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(faces, turn, axis=1).T
    ab, bc, ca = np.take_along_axis(middles, turn, axis=1).T
    pieces = {
        0: [(a, b, c)],
        1: [(a, ab, c), (ab, b, c)],
        2: [(ab, b, bc), (a, ab, bc), (a, bc, c)],
        3: [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)],
    }
    divided = [np.stack(piece, axis=1)[count == number] for number, rows in pieces.items() for piece in rows]
    return np.concatenate(divided)
