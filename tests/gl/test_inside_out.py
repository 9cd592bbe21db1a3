"""Closed surfaces that turn inside out: found by looking, and then drawn from both sides."""

import numpy as np
import pytest

from zbuf_occlude import Mesh, prepare, sample_surface, views
from zbuf_occlude.closed import closed_surfaces
from zbuf_occlude.gl.context import GlContext
from zbuf_occlude.gl.depth_pass import mesh_buffers
from zbuf_occlude.gl.exact_data import Unit
from zbuf_occlude.gl.inside_out import directions, inside_out
from zbuf_occlude.gl.mesh_data import arrange_mesh
from zbuf_occlude.meshes import shapes

BALL = shapes.solids.icosphere(3)
# mirrored below z = 0.3, where the map's determinant is negative: a closed surface that crosses itself
CROSSED = Mesh(BALL.vertices * np.where([True, False, False], BALL.vertices[:, 2:] - 0.3, 1.0), BALL.faces)


def wrong(gl: GlContext, mesh: Mesh) -> list[bool]:
    unit = Unit.of(mesh.centre, mesh.diagonal)
    arrays = arrange_mesh(mesh, unit, closed_surfaces(mesh))
    with mesh_buffers(gl, arrays.positions, arrays.faces) as buffers:
        return list(inside_out(gl, arrays, buffers))


def test_directions_are_unit_vectors_all_round() -> None:
    found = directions()
    assert np.allclose(np.linalg.norm(found, axis=1), 1.0)
    assert np.allclose(found.sum(axis=0), 0.0)
    assert np.linalg.matrix_rank(found) == 3


def test_a_crossed_surface_is_found_and_sound_ones_are_not(gl: GlContext) -> None:
    assert wrong(gl, BALL) == [False]
    assert wrong(gl, CROSSED) == [True]
    apart = CROSSED.transformed(1.0, [4.0, 0.0, 0.0])
    both = Mesh(
        np.concatenate([BALL.vertices, apart.vertices]), np.concatenate([BALL.faces, apart.faces + len(BALL.vertices)])
    )
    assert wrong(gl, both) == [False, True]


def test_a_surface_within_another_is_sound(gl: GlContext) -> None:
    inner = BALL.transformed(0.5)
    nested = Mesh(
        np.concatenate([BALL.vertices, inner.vertices]),
        np.concatenate([BALL.faces, inner.faces[:, ::-1] + len(BALL.vertices)]),
    )
    assert wrong(gl, nested) == [False, False]


@pytest.mark.parametrize("refine", ["none", "witness"])
def test_a_crossed_surface_is_answered_like_any_other(gl: GlContext, refine: str) -> None:
    points, eyes = sample_surface(CROSSED, n_points=3000, seed=4), views.fibonacci(9, distance=6.0).eyes
    with prepare(CROSSED, "oracle") as oracle, prepare(CROSSED, "depth_buffer", gl=gl, refine=refine) as occluder:
        agreement = (oracle.visible(points, eyes) == occluder.visible(points, eyes)).mean()
    assert agreement > (0.99 if refine == "witness" else 0.95)


def test_faces_are_drawn_closed_ones_first_and_counterclockwise_from_outside() -> None:
    holed = Mesh(BALL.vertices + 3.0, BALL.faces[:-1])
    mesh = Mesh(
        np.concatenate([holed.vertices, BALL.vertices]),
        np.concatenate([holed.faces, BALL.faces[:, ::-1] + len(holed.vertices)]),
    )
    arrays = arrange_mesh(mesh, Unit.of(np.zeros(3), 1.0), closed_surfaces(mesh))
    assert arrays.n_closed == len(BALL.faces)
    assert (arrays.closed == (np.arange(len(mesh.faces)) >= len(holed.faces))).all()
    a, b, c = (arrays.positions[arrays.faces[: arrays.n_closed, i]] for i in range(3))
    assert ((np.cross(b - a, c - a) * a).sum(axis=1) > 0.0).all()
    assert (arrays.places[len(holed.faces) :] < arrays.n_closed).all()
    assert sorted(arrays.places) == list(range(len(mesh.faces)))
    centres = mesh.corners.mean(axis=1)
    assert ((arrays.normals * centres).sum(axis=1)[len(holed.faces) :] > 0.0).all()
