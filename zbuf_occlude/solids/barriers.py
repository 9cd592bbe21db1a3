"""Barriers: where on a face others come within reach of it, so that what is before it may change without a contour."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.predicates import dot, minus
from zbuf_occlude.solids.triangles import corner, unit_normal

WIDE = 1e-3
"""Faces with wider barriers, in diagonals, have none: nothing could be followed over them."""


class Barriers(NamedTuple):
    """Parts of faces about which nothing is said; beyond them a face is farther than `reach` from all others.

    Attributes
    ----------
    starts : (f + 1,) int64
        The barriers of face i are those from ``starts[i]`` to ``starts[i + 1]``.
    ends : (b, 2, 3) float64
        Segments in the faces' planes.
    radii : (b,) float64
        What is nearer to the segment than this belongs to the barrier.
    """

    starts: NDArray[np.int64]
    ends: FloatArray
    radii: FloatArray


def no_barriers(n_faces: int) -> Barriers:
    """Return none."""
    return Barriers(np.zeros(n_faces + 1, dtype=np.int64), np.zeros((0, 2, 3)), np.zeros(0))


def make_barriers(corners: FloatArray, near: IntArray, counts: IntArray, reach: float) -> Barriers:
    """Make the barriers of faces from lists of those near them.

    Parameters
    ----------
    corners : (f, 3, 3) float64
        About the mesh's centre, in units of its diagonal.
    near : (f, most) int32
    counts : (f,) int32
        How many of a row count.
    reach : float
        Diagonals.
    """
    faces = np.repeat(np.arange(len(corners)), counts)
    ends, radii = _segments(corners, faces, near[np.arange(near.shape[1]) < counts[:, None]], reach)
    wide = np.zeros(len(corners), dtype=bool)
    wide[faces[radii > WIDE]] = True
    kept = ~wide[faces]
    starts = np.concatenate([[0], np.cumsum(np.where(wide, 0, counts))])
    return Barriers(starts, ends[kept], radii[kept])


@njit(cache=True)
def _segments(
    corners: FloatArray, faces: NDArray[np.int64], others: IntArray, reach: float
) -> tuple[FloatArray, FloatArray]:
    """Segments and radii of the barriers that others are on faces.

    A point of a face within reach of another lies within reach of the image, straight down onto the face's plane, of
    that part of the other which is within reach of this plane: a polygon, put between its two corners farthest apart.
    """
    ends, radii = np.zeros((len(faces), 2, 3)), np.zeros(len(faces))
    polygon = np.empty((9, 3))
    for k in range(len(faces)):
        f, g = corners[faces[k]], corners[others[k]]
        normal, origin = unit_normal(f), corner(f, 0)
        n = 0
        for i in range(3):
            a, b = corner(g, i), corner(g, (i + 1) % 3)
            p, q = dot(normal, minus(a, origin)), dot(normal, minus(b, origin))
            if abs(p) <= reach:
                n = _put(polygon, n, a, b, 0.0, normal, origin)
            for level in (reach, -reach):
                if (p - level) * (q - level) < 0.0:
                    n = _put(polygon, n, a, b, (level - p) / (q - p), normal, origin)
        longest = -1.0
        for i in range(n):
            for j in range(i, n):
                apart = minus(corner(polygon, i), corner(polygon, j))
                if dot(apart, apart) > longest:
                    longest = dot(apart, apart)
                    ends[k, 0], ends[k, 1] = polygon[i], polygon[j]
        along = minus(corner(ends[k], 1), corner(ends[k], 0))
        for i in range(n):
            away = minus(corner(polygon, i), corner(ends[k], 0))
            share = min(max(dot(away, along) / longest, 0.0), 1.0) if longest > 0.0 else 0.0
            away = (away[0] - share * along[0], away[1] - share * along[1], away[2] - share * along[2])
            radii[k] = max(radii[k], np.sqrt(dot(away, away)))
        radii[k] += 1.01 * reach
    return ends, radii


@njit
def _put(polygon, n, a, b, share, normal, origin):  # type: ignore[no-untyped-def]
    """Enter a point between a and b, put down onto a plane, as the n-th; return n + 1."""
    point = (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2]))
    height = dot(normal, minus(point, origin))
    for axis in range(3):
        polygon[n, axis] = point[axis] - height * normal[axis]
    return n + 1
