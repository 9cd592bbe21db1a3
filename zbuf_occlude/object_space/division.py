"""Division of faces of large area into smaller ones (paper 3.3, Fig. 4)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints


@dataclass(frozen=True, eq=False)
class Division:
    """A mesh with its large faces divided, and the way from a point on a face to the child it lies in.

    Parameters
    ----------
    parent : Mesh
        f faces.
    mesh : Mesh
        The divided one: the children of face 0, then those of face 1, and so on. Its first vertices are the parent's.
    parts : (f,) int32
        m: the edges of face i are cut into m parts, the face into m^2 congruent children; 1 = left whole.
    limited : bool
        Whether the division is coarser than was asked for, because it would have made too many faces.
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
            Indices of `mesh.faces`; -1 for free points.
        """
        on_face = points.face_ids >= 0
        own = points.face_ids[on_face]
        first = np.cumsum(self.parts.astype(np.int64) ** 2) - self.parts.astype(np.int64) ** 2
        children = np.full(len(points), -1, dtype=np.int32)
        beta, gamma = _plane_coordinates(self.parent.corners[own], points.positions[on_face])
        m = self.parts[own]
        row = np.clip(np.floor(gamma * m), 0, m - 1).astype(np.int64)
        column = np.clip(np.floor(beta * m), 0, m - 1 - row).astype(np.int64)
        # the upper triangle of a lattice cell begins beyond its diagonal; the last cell of a row has none
        upper = ((beta * m - column) + (gamma * m - row) > 1.0) & (column < m - 1 - row)
        children[on_face] = first[own] + row * (2 * m - row) + 2 * column + upper
        return children


def divide_faces(mesh: Mesh, largest: float, max_faces: int) -> Division:
    """Divide every face whose area is above a limit into congruent children whose area is not.

    Parameters
    ----------
    mesh : Mesh
    largest : float
        The largest area that a face may keep, as a fraction of the mesh's whole area.
    max_faces : int
        Make no more faces than this: `largest` is then raised until they suffice (`Division.limited`).

    Returns
    -------
    Division

    Notes
    -----
    Each edge of a face is cut into m = ceil(sqrt(area / largest)) equal parts, which makes m^2 children similar to the
    face. The number of faces is known beforehand, so that the limit costs nothing and nothing explodes.

    References
    ----------
    Paper 3.3 and Fig. 4. The paper names neither the rule of division nor its limit; both are ours.
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
    # the subtraction keeps a face of exactly m^2 times the limit at m parts; the upper bound keeps the squares in int64
    return np.clip(np.ceil(np.sqrt(relative / largest) - 1e-9), 1, 2**24).astype(np.int32)


def _children(mesh: Mesh, parts: IntArray) -> tuple[FloatArray, IntArray]:
    """Vertices and faces of the divided mesh, faces in the order that `Division` states."""
    m = parts.astype(np.int64)
    counts = m**2
    face = np.repeat(np.arange(len(m)), counts)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    m_of = m[face]
    # row r begins at child r (2 m - r); from there to the end there are (m - r)^2 children
    row = m_of - np.ceil(np.sqrt(m_of**2 - within)).astype(np.int64)
    column, upper = np.divmod(within - row * (2 * m_of - row), 2)
    lattice = np.stack(  # column and row of the children's three corners
        [
            np.stack([column + upper, row], axis=1),
            np.stack([column + 1, row + upper], axis=1),
            np.stack([column, row + 1], axis=1),
        ],
        axis=1,
    )
    nodes, positions = _lattice_nodes(mesh, m)
    node_first = len(mesh.vertices) + np.cumsum(nodes) - nodes
    c, r = lattice[..., 0], lattice[..., 1]
    wide = m_of[:, None]
    index = node_first[face][:, None] + r * (wide + 1) - r * (r - 1) // 2 + c
    # the lattice's corners are the face's own vertices, so that a face left whole adds none
    corners = mesh.faces[face].astype(np.int64)
    index = np.where((c == 0) & (r == 0), corners[:, 0:1], index)
    index = np.where(c == wide, corners[:, 1:2], index)
    index = np.where(r == wide, corners[:, 2:3], index)
    vertices = np.concatenate([mesh.vertices, positions])
    used = np.zeros(len(vertices), dtype=bool)
    used[: len(mesh.vertices)] = True
    used[index] = True
    renumbered = np.cumsum(used) - 1
    return vertices[used], renumbered[index].astype(np.int32)


def _lattice_nodes(mesh: Mesh, m: NDArray[np.int64]) -> tuple[NDArray[np.int64], FloatArray]:
    """How many lattice nodes each face has (none when it stays whole), and their positions, row by row."""
    nodes = np.where(m > 1, (m + 1) * (m + 2) // 2, 0)
    face = np.repeat(np.arange(len(m)), nodes)
    within = np.arange(nodes.sum()) - np.repeat(np.cumsum(nodes) - nodes, nodes)
    # counted from the end, row r (of m + 1 - r nodes) holds the triangular numbers' r-th stretch
    left = nodes[face] - 1 - within
    row = m[face] - (np.sqrt(8.0 * left + 1.0).astype(np.int64) - 1) // 2
    column = within - (row * (m[face] + 1) - row * (row - 1) // 2)
    a, b, c = (mesh.corners[face, i] for i in range(3))
    beta, gamma = (column / m[face])[:, None], (row / m[face])[:, None]
    return nodes, a + beta * (b - a) + gamma * (c - a)


def _plane_coordinates(corners: FloatArray, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """beta, gamma of p = a + beta (b - a) + gamma (c - a), for points in the triangles' planes."""
    a = corners[:, 0]
    first, second, offset = corners[:, 1] - a, corners[:, 2] - a, positions - a
    normal = np.cross(first, second)
    squared = np.maximum(np.einsum("nx,nx->n", normal, normal), np.finfo(np.float64).tiny)
    beta = np.einsum("nx,nx->n", np.cross(offset, second), normal) / squared
    gamma = np.einsum("nx,nx->n", np.cross(first, offset), normal) / squared
    return np.asarray(beta), np.asarray(gamma)
