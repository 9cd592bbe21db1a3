"""A mesh's arrays for drawing: solids first, wound counterclockwise from outside."""

import numpy as np

from zbuf_occlude import Mesh
from zbuf_occlude.gl.exact_data import Unit
from zbuf_occlude.gl.mesh_data import arrange_mesh
from zbuf_occlude.meshes import shapes
from zbuf_occlude.solids import find_solids

BALL = shapes.solids.icosphere(3)


def test_faces_are_drawn_closed_ones_first_and_counterclockwise_from_outside() -> None:
    holed = Mesh(BALL.vertices + 3.0, BALL.faces[:-1])
    mesh = Mesh(
        np.concatenate([holed.vertices, BALL.vertices]),
        np.concatenate([holed.faces, BALL.faces[:, ::-1] + len(holed.vertices)]),
    )
    arrays = arrange_mesh(mesh, Unit.of(np.zeros(3), 1.0), find_solids(mesh)[0])
    assert arrays.n_closed == len(BALL.faces)
    assert (arrays.closed == (np.arange(len(mesh.faces)) >= len(holed.faces))).all()
    a, b, c = (arrays.positions[arrays.faces[: arrays.n_closed, i]] for i in range(3))
    assert ((np.cross(b - a, c - a) * a).sum(axis=1) > 0.0).all()
    assert (arrays.places[len(holed.faces) :] < arrays.n_closed).all()
    assert sorted(arrays.places) == list(range(len(mesh.faces)))
    centres = mesh.corners.mean(axis=1)
    assert ((arrays.normals * centres).sum(axis=1)[len(holed.faces) :] > 0.0).all()
