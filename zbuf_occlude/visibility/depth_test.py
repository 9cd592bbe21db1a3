"""The plain depth test in NumPy: points against one depth image. depth_test.comp's twin, and all pyrender needs."""

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.geometry.camera import Frusta
from zbuf_occlude.geometry.sampling import SurfacePoints


def depth_test(
    depths: FloatArray, view: FloatArray, frustum: Frusta, points: SurfacePoints, *, tolerance: float, slope_bias: float
) -> BoolArray:
    """Answer which points are not behind a depth image by more than the tolerance.

    Parameters
    ----------
    depths : (height, width) float
        Eye depth (distance along the camera's axis) at each pixel's centre, world units; infinite where nothing is.
        Row 0 is the *lowest*, as in OpenGL's window space; flip an image that starts at the top.
    view : (4, 4) float
        World to eye space (`camera.view_matrices`).
    frustum : Frusta
        Of this one camera: six numbers.
    points : SurfacePoints
        n points, world space.
    tolerance : float
        A point may be this much deeper than the image and is still visible; world units.
    slope_bias : float
        Added to it: this many times the depth that the point's own plane gains from one pixel to the next.

    Returns
    -------
    (n,) bool, True = visible. A point outside the image is visible: nothing was drawn there.

    Notes
    -----
    This is shadow mapping (Williams 1978) with a slope-scaled bias. Not exact: the image knows one depth a pixel, and
    a pixel times a slope is far more than any depth resolution.
    """
    x, y, depth = project(view, frustum, points.positions, (depths.shape[1], depths.shape[0]))
    allowed = tolerance + slope_bias * depth_slopes(view, frustum, points, (depths.shape[1], depths.shape[0]))
    inside = (depth > 0) & (x >= 0) & (x < depths.shape[1]) & (y >= 0) & (y < depths.shape[0])
    visible = np.ones(len(points), dtype=bool)
    column, row = x[inside].astype(np.intp), y[inside].astype(np.intp)
    visible[inside] = depth[inside] <= depths[row, column] + allowed[inside]
    return visible


def project(
    view: FloatArray, frustum: Frusta, positions: FloatArray, size: tuple[int, int]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return window x, y (pixels) and eye depth of positions (n, 3); behind the eye x and y mean nothing."""
    eye_space = positions @ view[:3, :3].T + view[:3, 3]
    depth = -eye_space[:, 2]
    in_front = np.where(depth > 0, depth, np.inf)
    x = (eye_space[:, 0] / in_front - frustum.left) / (frustum.right - frustum.left) * size[0]
    y = (eye_space[:, 1] / in_front - frustum.bottom) / (frustum.top - frustum.bottom) * size[1]
    return x, y, depth


def depth_slopes(view: FloatArray, frustum: Frusta, points: SurfacePoints, size: tuple[int, int]) -> FloatArray:
    """Return what the eye depth of each point's own plane gains from a pixel to the next, (n,), in world units.

    The larger of both directions, as glPolygonOffset takes it, and no more than the depth of the frustum (a plane seen
    edge on has no slope); 0 for a free point, which has no plane.
    """
    normals = points.normals @ view[:3, :3].T
    positions = points.positions @ view[:3, :3].T + view[:3, 3]
    # the plane n . q = c meets the ray (s, t, -1) at depth c / (n_x s + n_y t - n_z); its derivatives by s and t:
    plane = np.abs((normals * positions).sum(axis=1))
    pixel = [(frustum.right - frustum.left) / size[0], (frustum.top - frustum.bottom) / size[1]]
    rise = (np.abs(normals[:, :2]) * pixel).max(axis=1) * positions[:, 2] ** 2
    most = frustum.far - frustum.near
    return np.asarray(
        np.where(rise < most * plane, rise / np.where(plane > 0, plane, 1.0), np.where(rise > 0, most, 0.0))
    )
