"""Extents of points in camera space, to which frusta are fitted."""

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.jit.threads import n_blocks, next_task, parallel_for, parallel_kernel

PAIRS_PER_TASK = 20_000
"""Minimum pairs of camera and point per extra thread; below this, waking it costs more."""


def extents(views: FloatArray, positions: FloatArray) -> FloatArray:
    """Return the least and largest depth, least tangents and largest tangents of points for each camera; (k, 6).

    The tangents are undefined if a point is not in front of the camera.
    """
    bounds = np.empty((len(views), 6))
    n_tasks = min(len(views), n_blocks(len(views) * len(positions), PAIRS_PER_TASK))
    parallel_for(_measure, n_tasks, views, positions, bounds)
    return bounds


@parallel_kernel
def _measure(tasks, views, positions, bounds):
    """Compute the extents of one camera after another."""
    k = next_task(tasks)
    while k < len(views):
        view = views[k]
        nearest, farthest = np.inf, -np.inf
        left, right, bottom, top = np.inf, -np.inf, np.inf, -np.inf
        for i in range(len(positions)):
            x, y, z = positions[i, 0], positions[i, 1], positions[i, 2]
            depth = -(view[2, 0] * x + view[2, 1] * y + view[2, 2] * z + view[2, 3])
            nearest, farthest = min(nearest, depth), max(farthest, depth)
            if depth > 0.0:
                inverse = 1.0 / depth
                across = (view[0, 0] * x + view[0, 1] * y + view[0, 2] * z + view[0, 3]) * inverse
                upward = (view[1, 0] * x + view[1, 1] * y + view[1, 2] * z + view[1, 3]) * inverse
                left, right = min(left, across), max(right, across)
                bottom, top = min(bottom, upward), max(top, upward)
        if nearest <= 0.0:
            left = right = bottom = top = 0.0
        row = bounds[k]
        row[0], row[1], row[2], row[3], row[4], row[5] = nearest, farthest, left, bottom, right, top
        k = next_task(tasks)
