"""The witness test in plain NumPy: the twin to which the shaders are held."""

import numpy as np
from numba import njit

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.base.jit.vec3 import cross, dot, minus
from zbuf_occlude.engines.gl.point_pass import MAX_HIDDEN
from zbuf_occlude.geometry.camera import Frusta
from zbuf_occlude.geometry.predicates import blocks
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.visibility.methods.pyrender import window_coordinates


def votes(
    depths: FloatArray, view: FloatArray, frustum: Frusta, points: SurfacePoints, low: IntArray, *, tolerance: float
) -> BoolArray:
    """Let the four pixels around each point say whether it is hidden: (n, 2, 2) by row and column.

    Hidden: the image is nearer to the eye at the pixel's centre than the point's own plane there, by more than the
    tolerance. Inverse eye depths are compared: a plane's is linear in window space. The tolerance is worth what it is
    at the point's own depth. `low` (n, 2) are column and row of the lower left of each point's four pixels.
    """
    size = depths.shape[1], depths.shape[0]
    x, y, depth = window_coordinates(view, frustum, points.positions, size)
    normals = points.normals @ view[:3, :3].T
    positions = points.positions @ view[:3, :3].T + view[:3, 3]
    plane = (normals * positions).sum(axis=1)
    pixel = np.array([(frustum.right - frustum.left) / size[0], (frustum.top - frustum.bottom) / size[1]])
    most = ((frustum.far - frustum.near) / depth**2)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        gains = np.where(plane[:, None] == 0.0, 0.0, normals[:, :2] * pixel / plane[:, None])
    gains = np.clip(gains, -most, most)
    columns, rows = low[:, 0, None, None] + np.array([[0, 1], [0, 1]]), low[:, 1, None, None] + np.array([[0], [1]])
    own = (
        1.0 / depth[:, None, None]
        + gains[:, 0, None, None] * (columns + 0.5 - x[:, None, None])
        + gains[:, 1, None, None] * (rows + 0.5 - y[:, None, None])
    )
    nearest = 1.0 / depths[np.clip(rows, 0, size[1] - 1), np.clip(columns, 0, size[0] - 1)]
    return np.asarray(nearest > np.maximum(own, 1.0 / frustum.far) + (tolerance / depth**2)[:, None, None])


def witness_test(
    depths: FloatArray,
    seen: IntArray,
    view: FloatArray,
    frustum: Frusta,
    points: SurfacePoints,
    corners: FloatArray,
    *,
    tolerance: float,
    contact: float,
) -> BoolArray:
    """Answer which points are visible, (n,): by the votes of four pixels, and where they differ by a witness.

    A witness is a face that blocks the line of sight by `predicates.blocks`, among those seen in the 6 x 6 pixels
    around the point. Without one, a point whose own face is seen in one of the four nearest pixels is visible; else
    their votes are weighed by nearness against `MAX_HIDDEN`. The image is as in `pyrender.depth_test`; `seen` are its
    faces, -1 for none.
    """
    height, width = depths.shape
    x, y, _ = window_coordinates(view, frustum, points.positions, (width, height))
    low = np.floor(np.stack([x, y], axis=1) - 0.5).astype(np.int32)
    nearest = votes(depths, view, frustum, points, low, tolerance=tolerance)
    visible = np.asarray(~nearest.any(axis=(1, 2)))
    doubtful = np.flatnonzero(~visible & ~nearest.all(axis=(1, 2)))
    doubted = SurfacePoints(points.positions[doubtful], points.face_ids[doubtful], points.normals[doubtful])
    rows = np.clip(low[doubtful, 1, None] + np.arange(-2, 4), 0, height - 1)
    columns = np.clip(low[doubtful, 0, None] + np.arange(-2, 4), 0, width - 1)
    faces = seen[rows[:, :, None], columns[:, None, :]]
    eye = -view[:3, 3] @ view[:3, :3]
    crossed, own_seen = _witnesses(
        faces, faces[:, 2:4, 2:4], doubted.positions, doubted.face_ids, eye, corners, contact
    )
    high = np.stack([x, y], axis=1)[doubtful] - 0.5 - low[doubtful]
    weights = np.stack([1.0 - high, high], axis=2)  # of the lower and the upper pixel, by axis
    weighed = np.einsum("nr,nc,nrc->n", weights[:, 1], weights[:, 0], nearest[doubtful].astype(float))
    visible[doubtful] = ~crossed & (own_seen | (weighed <= MAX_HIDDEN))
    return visible


@njit(cache=True)
def _witnesses(candidates, nearest, positions, own, eye, corners, contact):  # type: ignore[no-untyped-def]
    """Say for which points a candidate blocks, and for which a nearest pixel shows the own face; (n,) bool each."""
    n = len(positions)
    crossed, own_seen = np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_)
    for i in range(n):
        for face in candidates[i].flat:
            if face >= 0 and face != own[i] and not crossed[i]:
                crossed[i] = blocks(eye, positions[i], corners[face, 0], corners[face, 1], corners[face, 2], contact)
        for face in nearest[i].flat:
            if face >= 0 and own[i] >= 0:
                own_seen[i] |= face == own[i]
            elif face >= 0:  # a free point has no own face; those whose planes it touches are taken for it
                a, b, c = corners[face, 0], corners[face, 1], corners[face, 2]
                normal = cross(minus(b, a), minus(c, a))
                off = dot(minus(positions[i], a), normal)
                own_seen[i] |= off * off <= contact * contact * dot(normal, normal)
    return crossed, own_seen
