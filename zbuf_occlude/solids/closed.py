"""Which faces belong to closed surfaces, and which of their sides is outside: what is turned away there is hidden."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, IntArray
from zbuf_occlude.mesh import Mesh

THIN = 1e-4
"""A closed surface must be thicker than this in the mean, as a fraction of the mesh's diagonal: ten contact tolerances.
Sheets nearer than one do not hide each other, so the far side of a plate so thin is seen."""

Signs = NDArray[np.int8]


class ClosedSurfaces(NamedTuple):
    """The closed surfaces of a mesh.

    Attributes
    ----------
    outward : (f,) int8
        1 where the face's normal, as it is wound, points out of its closed surface; -1 where it points in;
        0 for a face of a surface that is not closed.
    surfaces : (f,) int32
        Which surface each face belongs to: faces connected by edges that exactly two of them share.
    sides : (f,) int8
        The same as `outward` where that is not 0. Elsewhere 1 or -1, so that the normals times it look to the same side
        of all faces of a surface, whichever that is; 0 where a surface has only one side.
    vertices : (f, 3) int32
        Numbers of the corners' positions.
    twins : (3 f,) int64
        Half-edge 3 i + j of face i runs from its corner j to the next; its twin is that of the one other face with
        this edge, -1 where there is none or several.
    """

    outward: Signs
    surfaces: IntArray
    sides: Signs
    vertices: IntArray
    twins: NDArray[np.int64]

    def without(self, opened: BoolArray) -> "ClosedSurfaces":
        """Return the same with some surfaces, (s,) bool, taken for open."""
        return self._replace(outward=np.where(opened[self.surfaces], np.int8(0), self.outward))


def closed_surfaces(mesh: Mesh) -> ClosedSurfaces:
    """Find the closed surfaces of a mesh, however it is wound and however often its vertices are stored.

    Notes
    -----
    A surface is closed here when every edge, by the positions of its ends, is shared by exactly two of its faces, it
    has two sides, and it is not `THIN`. From an eye outside, a face turned away is then hidden, with all points
    on it, *if* the surface does not cross itself; `crossing.crossing_surfaces` tells.
    """
    _, position_ids = np.unique(mesh.vertices + 0.0, axis=0, return_inverse=True)  # -0.0 becomes 0.0
    faces = position_ids.reshape(-1)[mesh.faces].astype(np.int64)
    starts, ends = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    keys = np.minimum(starts, ends) * (faces.max() + 1) + np.maximum(starts, ends)
    order = np.argsort(keys, kind="stable")
    sorted_keys = keys[order]
    first = np.flatnonzero(np.concatenate([[True], sorted_keys[1:] != sorted_keys[:-1]]))
    pairs = first[np.diff(np.append(first, len(keys))) == 2]
    twins = np.full(len(keys), -1, dtype=np.int64)
    twins[order[pairs]], twins[order[pairs + 1]] = order[pairs + 1], order[pairs]
    sides, surfaces, closed = _flood(twins, starts)
    outward = np.where(closed[surfaces], sides, np.int8(0))
    _point_out(outward, surfaces, mesh)
    sides = np.where(outward != 0, outward, sides)
    return ClosedSurfaces(outward, surfaces, sides, faces.astype(np.int32), twins)


@njit(cache=True)
def _flood(twins: NDArray[np.int64], starts: NDArray[np.int64]) -> tuple[Signs, IntArray, BoolArray]:
    """Give all faces of each surface the same side, 0 if it has but one; number the surfaces; tell which are closed."""
    f = len(twins) // 3
    whole = np.zeros(f, dtype=np.bool_)
    sides = np.zeros(f, dtype=np.int8)
    surfaces = np.full(f, -1, dtype=np.int32)
    queue = np.empty(f, dtype=np.int64)
    n_surfaces = 0
    for seed in range(f):
        if surfaces[seed] >= 0:
            continue
        surfaces[seed], sides[seed], queue[0] = n_surfaces, 1, seed
        done, length, closed, two_sided = 0, 1, True, True
        while done < length:
            face = queue[done]
            done += 1
            for half in range(3 * face, 3 * face + 3):
                twin = twins[half]
                if twin < 0:
                    closed = False
                    continue
                neighbour = twin // 3
                # two faces wound alike run along their common edge in opposite directions
                side = -sides[face] if starts[twin] == starts[half] else sides[face]
                if surfaces[neighbour] < 0:
                    surfaces[neighbour], sides[neighbour], queue[length] = n_surfaces, side, neighbour
                    length += 1
                elif sides[neighbour] != side:
                    two_sided = False  # like Moebius's strip
        if not two_sided:
            for i in range(length):
                sides[queue[i]] = 0
        whole[n_surfaces] = closed and two_sided
        n_surfaces += 1
    return sides, surfaces, whole[:n_surfaces]


def _point_out(outward: Signs, surfaces: IntArray, mesh: Mesh) -> None:
    """Turn the sides of each closed surface outwards, by the sign of the volume it encloses; 0 for a thin one."""
    n_surfaces = int(surfaces.max()) + 1
    corners = (mesh.corners - mesh.centre) / mesh.diagonal
    low, high = np.full((n_surfaces, 3), np.inf), np.full((n_surfaces, 3), -np.inf)
    np.minimum.at(low, surfaces, corners.min(axis=1))
    np.maximum.at(high, surfaces, corners.max(axis=1))
    local = corners - ((low + high) / 2.0)[surfaces][:, None]
    volumes = (local[:, 0] * np.cross(local[:, 1], local[:, 2])).sum(axis=1) / 6.0
    enclosed = np.bincount(surfaces, weights=volumes * outward, minlength=n_surfaces)
    areas = np.bincount(surfaces, weights=mesh.areas, minlength=n_surfaces) / mesh.diagonal**2
    thick = np.abs(enclosed) > THIN * areas / 2.0  # a plate's volume is its thickness times half its area
    turn = np.where(thick, np.sign(enclosed), 0.0).astype(np.int8)
    outward *= turn[surfaces]
