"""A mesh's arrays for drawing: an order of faces, and the way back to it."""

import numpy as np

from zbuf_occlude import shapes
from zbuf_occlude.gl.exact_data import Unit
from zbuf_occlude.gl.mesh_data import arrange_mesh

BALL = shapes.solids.icosphere(3)


def test_faces_are_drawn_along_a_curve_and_places_lead_back() -> None:
    arrays = arrange_mesh(BALL, Unit.of(np.zeros(3), 1.0))
    assert sorted(arrays.places) == list(range(len(BALL.faces)))
    assert np.array_equal(arrays.positions[arrays.faces[arrays.places]], 0.5 * BALL.corners), "unit space"
    centres = arrays.positions[arrays.faces].mean(axis=1)
    assert np.linalg.norm(np.diff(centres, axis=0), axis=1).mean() < 0.1, "neighbours in the order are near in space"
    assert np.allclose(np.linalg.norm(arrays.normals, axis=1), 1.0)
    assert ((arrays.normals * BALL.corners.mean(axis=1)).sum(axis=1) > 0.0).all()
