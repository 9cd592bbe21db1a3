"""Faces and points inside other solids, against closed forms and the oracle."""

import numpy as np
import pytest

from tests.scenes import box, together
from zbuf_occlude import Mesh, SurfacePoints, prepare, sample_surface, views
from zbuf_occlude.image_space.backs import make_solids
from zbuf_occlude.image_space.packets import make_packets
from zbuf_occlude.image_space.scene import make_scene
from zbuf_occlude.image_space.surface import make_surface
from zbuf_occlude.meshes import shapes
from zbuf_occlude.solids.buried import WHOLE
from zbuf_occlude.visibility import exact

BALL = shapes.solids.icosphere(3)
SMALL = BALL.transformed(0.3, [0.1, 0.0, 0.2])
ROD = shapes.refined(box((0.4, 0.4, 4.0)), 600)
CUBE = box((2.0, 2.0, 1.9))
EYES = views.fibonacci(12, distance=9.0).eyes


def turned(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices, mesh.faces[:, ::-1])


def buried_points(mesh: Mesh, points: SurfacePoints) -> np.ndarray:
    """(n,) bool, in the order of the points."""
    scene, solids = make_scene(mesh, 1e-5 * mesh.diagonal), make_solids(mesh, 1e-5)
    rows = np.full(len(mesh.faces) + 1, -1, dtype=np.int32)
    rows[scene.face_ids[scene.face_ids >= 0]] = np.flatnonzero(scene.face_ids.reshape(-1) >= 0)
    packets = make_packets(points, scene, rows, solids, make_surface(scene, rows, solids).records)
    found = np.zeros(len(points), dtype=bool)
    bits = (packets.buried[:, None] >> np.arange(64)) & 1
    found[packets.order[: len(points)]] = bits.reshape(-1)[: len(points)] != 0
    return found


@pytest.mark.parametrize("inner", [SMALL, turned(SMALL), Mesh(SMALL.vertices, SMALL.faces[:300])])
@pytest.mark.parametrize("outer", [BALL, turned(BALL)])
def test_what_is_inside_a_closed_surface_is_buried(inner: Mesh, outer: Mesh) -> None:
    solids = make_solids(together(outer, inner), 1e-5)
    assert (solids.buried[: len(outer.faces)] == 0).all()
    inside, clear = solids.buried[len(outer.faces) :] == WHOLE, solids.clear[len(outer.faces) :]
    assert (inside == clear).all()
    assert clear.mean() > 0.8


@pytest.mark.parametrize(
    "mesh",
    [
        together(BALL, SMALL.transformed(1.0, [3.0, 0.0, 0.0])),  # beside
        together(Mesh(BALL.vertices, BALL.faces[1:]), SMALL),  # in an open one
        BALL,
        Mesh(ROD.vertices, ROD.faces[:100]),
    ],
)
def test_what_is_not_inside_of_a_closed_surface_is_not(mesh: Mesh) -> None:
    assert (make_solids(mesh, 1e-5).buried == 0).all()


def test_points_of_faces_that_run_through_a_solid_are_buried_inside_of_it_only() -> None:
    mesh = together(CUBE, ROD)
    points = sample_surface(mesh, n_points=40_000, seed=0)
    found, of_rod = buried_points(mesh, points), points.face_ids >= len(CUBE.faces)
    height = np.abs(points.positions[:, 2])
    assert not found[~of_rod].any()
    assert not found[of_rod & (height >= 0.95)].any()
    assert found[of_rod & (height < 0.949)].mean() > 0.95
    crossing = np.isin(points.face_ids, np.unique(points.face_ids[of_rod & (height >= 0.95)]))
    assert found[crossing & (height < 0.94)].mean() > 0.5
    off = SurfacePoints(points.positions + 1e-7 * points.normals, points.face_ids, points.normals)
    assert not buried_points(mesh, off).any()


@pytest.mark.parametrize("n_points", [300, 20_000])
def test_eyes_outside_and_inside_are_answered_as_by_the_oracle(n_points: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exact, "WORTH", 0)
    mesh = together(BALL, SMALL, SMALL.transformed(1.5, [0.6, 0.5, 0.4]), ROD.transformed(0.8, [-0.2, 0.1, 0.3]))
    points = sample_surface(mesh, n_points=n_points, seed=1)
    eyes = np.concatenate([EYES, [[0.0, -0.5, 0.0], [-0.5, 0.4, -0.3]]])  # the last two inside the ball
    some = np.arange(0, n_points, max(1, n_points // 600))
    with prepare(mesh, "exact") as occluder, prepare(mesh, "oracle") as oracle:
        truth = oracle.visible(points.select(some), eyes)
        assert (occluder.visible(points, eyes)[:, some] == truth).all()
    buried = buried_points(mesh, points)[some]
    assert buried.mean() > 0.1
    assert not truth[:12, buried].any()
    assert truth[12:, buried].any()
