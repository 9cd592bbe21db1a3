"""Closed surfaces let no line through: towards corners and edges, and where a picture or a scan was meshed again."""

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import DATA
from tests.watertight import eyes_inside, is_closed, meshed, pinhole, rays_outwards, surrounded_vertices, turning
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.shapes import solids

METHODS = ("exact", "oracle")


def turned(mesh: zo.Mesh, seed: int) -> zo.Mesh:
    """Turn and shift a mesh, so that no coordinate is round."""
    rng = np.random.default_rng(seed)
    return mesh.rotated(np.linalg.qr(rng.normal(size=(3, 3)))[0]).transformed(rng.uniform(0.5, 2.0), rng.normal(size=3))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("level", [0, 1, 2, 3])
def test_no_ray_escapes_from_a_ball(level: int, method: str) -> None:
    ball, rng = turned(solids.icosphere(level), level), np.random.default_rng(level)
    assert is_closed(ball)
    eyes = eyes_inside(ball, rng, 6)
    assert len(eyes) == 6
    with zo.prepare(ball, method) as occluder:
        for eye in eyes:
            assert (occluder.first_hits(eye[None], rays_outwards(ball, eye, rng, 500)).face_ids >= 0).all()


@pytest.mark.filterwarnings("ignore:eyes lie inside")
@pytest.mark.parametrize("method", METHODS)
def test_nothing_is_seen_through_a_closed_surface(method: str) -> None:
    """Points behind each corner and behind each edge, as an eye inside sees them."""
    ball, rng = turned(solids.icosphere(2), 7), np.random.default_rng(8)
    with zo.prepare(ball, method) as occluder:
        for eye in eyes_inside(ball, rng, 4):
            behind = eye + 3.0 * rays_outwards(ball, eye, rng, 0)
            assert not occluder.visible(zo.SurfacePoints.free(behind), eye[None]).any()


@pytest.mark.parametrize("name", ["chair", "car", "table", "bottle"])
def test_a_picture_meshed_again_has_no_hole(name: str) -> None:
    mesh, width = shapes.make(name, 1).normalized(), 120
    eye = np.array([1.3, 1.1, 0.9])
    directions = pinhole(width, 90, -eye)
    with zo.prepare(mesh, "exact") as occluder:
        distances = occluder.first_hits(eye[None], directions).distances
    again, around = meshed(eye, directions, distances, width)
    assert around.sum() > 300
    with zo.prepare(again, "exact") as occluder:
        assert (occluder.first_hits(eye[None], directions).face_ids[around] >= 0).all()


def test_a_scan_of_a_room_meshed_again_loses_no_return() -> None:
    room, eye = turned(solids.box(), 3), np.array([0.1, 0.2, 0.05])
    eye = room.centre + 0.1 * room.longest_side * eye
    directions = turning(300, np.radians(np.linspace(-25.0, 25.0, 24)))
    with zo.prepare(room, "exact") as occluder:
        distances = occluder.first_hits(eye[None], directions).distances
    assert np.isfinite(distances).all()
    again, around = meshed(eye, directions, distances, 300)
    with zo.prepare(again, "exact") as occluder:
        found = occluder.first_hits(eye[None], directions)
        single = occluder.first_hits(np.tile(eye, (len(directions), 1)), directions)
    assert (found.face_ids[around] >= 0).all()
    assert (found.face_ids == single.face_ids).all()


@pytest.mark.skipif(not (DATA / "scans" / "bunny").is_dir(), reason=f"no scans/bunny in {DATA}")
def test_the_bunny_is_met_at_every_vertex_that_faces_the_eye() -> None:
    bunny = zo.load_mesh(DATA / "scans" / "bunny" / "bun_zipper.ply")
    eye = bunny.centre + np.array([0.03, 0.1, 0.3])
    vertices = surrounded_vertices(bunny, eye)
    assert len(vertices) > 5_000
    with zo.prepare(bunny, "exact") as occluder:
        distances = occluder.first_hits(eye[None], vertices - eye).distances
    assert (distances <= np.linalg.norm(vertices - eye, axis=1) * (1.0 + 1e-9)).all()
