"""The depth image of one view against closed forms."""

import numpy as np
import pytest

from zbuf_occlude import ArgumentError, Mesh, Views
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.engines.gl.depth_pass import render_depth

# a large plate through the origin, tilted: z = x / 2
TILTED = Mesh(
    np.array([[-2, -1, -1], [2, -1, 1], [2, 1, 1], [-2, 1, -1]], dtype=float), np.array([[0, 1, 2], [0, 2, 3]])
)
ABOVE = Views(np.array([0.0]), np.array([np.pi / 2]), np.array([10.0]))


def test_depth_is_that_of_the_plane_at_pixel_centres(gl: GlContext) -> None:
    depths = render_depth(gl, TILTED, ABOVE, 200)
    seen = np.isfinite(depths)
    assert 0.3 < seen.mean() < 0.6
    # from above, up is -x: rows run along x, and a pixel's tangents are symmetric about the axis
    row = np.flatnonzero(seen.any(axis=1))
    columns = np.flatnonzero(seen.any(axis=0))
    assert abs((columns[0] + columns[-1]) / 2 - 99.5) < 1
    # along the middle column the ray (t, 0, -1) meets z = x / 2 where 10 - depth = t depth / 2
    middle = depths[row[2] : row[-2], 100]
    tangent = 2 * (10 - middle) / middle
    steps = np.diff(tangent)
    # equal steps of the tangent from pixel to pixel: the depth is that at the centre of each
    assert np.allclose(steps, steps.mean(), atol=2e-5 * abs(steps.mean() * len(steps)))
    assert depths[seen].min() == pytest.approx(9, abs=0.05)
    assert depths[seen].max() == pytest.approx(11, abs=0.05)


def test_scale_does_not_matter(gl: GlContext) -> None:
    near, far = (render_depth(gl, TILTED.transformed(s), ABOVE.around(np.zeros(3), s), 64) / s for s in (1.0, 1024.0))
    assert np.array_equal(near, far)


def test_an_eye_within_the_mesh_is_refused(gl: GlContext) -> None:
    with pytest.raises(ArgumentError, match="the mesh must lie in front of the camera"):
        render_depth(gl, TILTED, Views(np.zeros(1), np.array([0.3]), np.array([0.5])), 64)
