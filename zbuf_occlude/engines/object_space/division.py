"""Division of large faces into smaller ones (paper 3.3, Fig. 4)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import FloatArray, IntArray
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints


@dataclass(frozen=True, eq=False)
class Division:
    """Mesh with its large faces divided, and the map from points on the parent's faces to their children.

    Parameters
    ----------
    parent : Mesh
        f faces.
    mesh : Mesh
        Divided mesh: the children of face 0, then those of face 1, and so on. Its first vertices are the parent's.
    parts : (f,) int32
        Number of parts m of each edge of a face, which has m^2 congruent children; 1 for an undivided face.
    limited : bool
        True if the division is coarser than requested, because it would have made too many faces.
    """

    parent: Mesh
    mesh: Mesh
    parts: IntArray
    limited: bool

    def children_of(self, points: SurfacePoints) -> IntArray:
        """Find the child that each point on the parent lies in.

        Parameters
        ----------
        points : SurfacePoints
            n points; ``face_ids`` index the parent's faces.

        Returns
        -------
        (n,) int32
            Indices into `mesh.faces`; -1 for free points.
        """
        on_face = points.face_ids >= 0
        own = points.face_ids[on_face]
        first = np.cumsum(self.parts.astype(np.int64) ** 2) - self.parts.astype(np.int64) ** 2
        children = np.full(len(points), -1, dtype=np.int32)
        beta, gamma = _plane_coordinates(self.parent.corners[own], points.positions[on_face])
        m = self.parts[own]
        row = np.clip(np.floor(gamma * m), 0, m - 1).astype(np.int64)
        column = np.clip(np.floor(beta * m), 0, m - 1 - row).astype(np.int64)
        # the upper triangle of a lattice cell is beyond its diagonal; the last cell of a row has none
        upper = ((beta * m - column) + (gamma * m - row) > 1.0) & (column < m - 1 - row)
        children[on_face] = first[own] + row * (2 * m - row) + 2 * column + upper
        return children


def divide_faces(mesh: Mesh, largest: float, max_faces: int) -> Division:
    """Divide every face with an area above a limit into congruent children with an area within the limit.

    Parameters
    ----------
    mesh : Mesh
    largest : float
        Largest area of a face, as a fraction of the mesh's area.
    max_faces : int
        Maximum number of faces; `largest` is raised until it is met (`Division.limited`).

    Returns
    -------
    Division

    Notes
    -----
    Each edge of a face is divided into m = ceil(sqrt(area / largest)) equal parts, which makes m^2 children similar to
    the face. The number of faces is known in advance, so no mesh above the limit is ever built.

    References
    ----------
    Paper 3.3 and Fig. 4. The paper gives neither a rule of division nor a limit.
    """
    relative = mesh.areas / mesh.areas.sum() if mesh.areas.any() else np.zeros(len(mesh.faces))
    parts = _parts(relative, largest)
    limited = int((parts.astype(np.int64) ** 2).sum()) > max_faces
    if limited:
        low, high = largest, max(1.0, largest)  # at an area of 1 no face is divided
        for _ in range(60):
            middle = np.sqrt(low * high)
            if int((_parts(relative, middle).astype(np.int64) ** 2).sum()) > max_faces:
                low = middle
            else:
                high = middle
        parts = _parts(relative, high)
    if (parts == 1).all():
        return Division(mesh, mesh, parts, limited)
    vertices, faces = _children(mesh, parts)
    return Division(mesh, Mesh(vertices, faces, mesh.name), parts, limited)


def _parts(relative: FloatArray, largest: float) -> IntArray:
    # the subtraction keeps a face of exactly m^2 times the limit at m parts; the squares of clipped parts fit in int64
    return np.clip(np.ceil(np.sqrt(relative / largest) - 1e-9), 1, 2**24).astype(np.int32)


def _children(mesh: Mesh, parts: IntArray) -> tuple[FloatArray, IntArray]:
    """Return vertices and faces of the divided mesh, with the faces in the order of `Division.mesh`."""
    counts = parts.astype(np.int64) ** 2
    first = np.cumsum(counts) - counts
    faces = np.empty((counts.sum(), 3), dtype=np.int64)
    vertices, n_vertices = [mesh.vertices], len(mesh.vertices)
    for m in np.unique(parts).tolist():
        some = np.flatnonzero(parts == m)
        nodes, children = _lattice(m)
        a, b, c = np.moveaxis(mesh.corners[some], 1, 0)[:, :, None]
        beta, gamma = (nodes / m).T[:, :, None]
        vertices.append((a + beta * (b - a) + gamma * (c - a)).reshape(-1, 3))
        numbers = n_vertices + np.arange(len(vertices[-1])).reshape(len(some), -1)
        n_vertices += numbers.size
        # the lattice's corners are the face's own vertices, so that an undivided face adds none
        numbers[:, [0, m, -1]] = mesh.faces[some]
        faces[first[some, None] + np.arange(m * m)] = numbers[:, children]
    used = np.arange(n_vertices) < len(mesh.vertices)
    used[faces] = True
    return np.concatenate(vertices)[used], (np.cumsum(used) - 1)[faces].astype(np.int32)


def _lattice(m: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return column and row of each node of a face divided into m parts, (n, 2); nodes of its children, (m^2, 3)."""
    rows, columns = np.nonzero(np.add.outer(np.arange(m + 1), np.arange(m + 1)) <= m)
    number = np.zeros((m + 1, m + 1), dtype=np.intp)
    number[rows, columns] = np.arange(len(rows))
    r, c = np.nonzero(np.add.outer(np.arange(m), np.arange(m)) < m)
    lower = np.stack([number[r, c], number[r, c + 1], number[r + 1, c]], axis=1)
    upper = np.stack([number[r, c + 1], number[r + 1, c + 1], number[r + 1, c]], axis=1)
    exists = np.stack([r + c < m, r + c < m - 1], axis=1)  # the last cell of a row has no upper triangle
    return np.stack([columns, rows], axis=1), np.stack([lower, upper], axis=1)[exists]


def _plane_coordinates(corners: FloatArray, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return beta, gamma of p = a + beta (b - a) + gamma (c - a), for points in the triangles' planes."""
    a = corners[:, 0]
    first, second, offset = corners[:, 1] - a, corners[:, 2] - a, positions - a
    normal = np.cross(first, second)
    squared = np.maximum(np.einsum("nx,nx->n", normal, normal), np.finfo(np.float64).tiny)
    beta = np.einsum("nx,nx->n", np.cross(offset, second), normal) / squared
    gamma = np.einsum("nx,nx->n", np.cross(first, offset), normal) / squared
    return np.asarray(beta), np.asarray(gamma)
