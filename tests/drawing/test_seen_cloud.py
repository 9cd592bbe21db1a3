"""The cloud of a moving camera: what the definition says at each of its places, and the scans of a sensor there."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

import zbuf_occlude as zo
from tests.scenes import box
from zbuf_occlude.base.errors import ArgumentError
from zbuf_occlude.drawing.seen_cloud import MovingCamera, spacing
from zbuf_occlude.meshes import shapes
from zbuf_occlude.sensors import SENSORS, look_at

N = 1500


@pytest.fixture(scope="module")
def chair() -> zo.Mesh:
    return shapes.make("chair", 3)


def test_at_each_place_the_mask_is_that_of_the_definition(chair: zo.Mesh) -> None:
    """Visible and hidden points together are the same sample everywhere; the oracle says which are which."""
    samples = zo.sample_surface(chair, n_points=N, seed=0)
    eyes = zo.views.ring(6, elevation=25.0, distance=2.0).around(chair.centre, chair.longest_side).eyes
    masks = zo.prepare(chair, "oracle").visible(samples, eyes)
    assert len(np.unique(masks.sum(axis=1))) > 3, "places that see different numbers of points"
    with MovingCamera(chair) as camera:
        for eye, mask in zip(eyes, masks, strict=True):
            seen = camera.see(look_at(eye, chair.centre), N)
            assert np.array_equal(seen.cloud.points, samples.positions[mask])
            assert np.array_equal(seen.hidden, samples.positions[~mask])
            towards = eye - seen.cloud.points
            assert (np.einsum("na,na->n", seen.cloud.normals, towards) > 0).all()


def test_without_a_sensor_turning_changes_nothing(chair: zo.Mesh) -> None:
    pose = look_at(chair.centre + np.array([2.0 * chair.longest_side, 0.3, 0.2]), chair.centre)
    away = pose.copy()
    away[:3, :2] *= -1.0
    with MovingCamera(chair) as camera:
        assert np.array_equal(camera.see(pose, N).cloud.points, camera.see(away, N).cloud.points)


def test_of_a_box_from_afar_the_sides_in_front_are_seen() -> None:
    """From far on the diagonal three sides of a cube are seen: half of the points."""
    cube = box((1.0, 1.0, 1.0))
    with MovingCamera(cube) as camera:
        seen = camera.see(look_at(cube.centre + 1000.0, cube.centre), 6000)
    assert len(seen.cloud) == pytest.approx(3000, abs=200)
    assert seen.n_sampled == 6000
    assert spacing(cube, 6000) == pytest.approx(np.sqrt(6 / 6000))


@pytest.mark.parametrize("noise", [True, False])
def test_with_a_sensor_the_cloud_is_its_scan(chair: zo.Mesh, noise: bool) -> None:
    sensor = SENSORS["realsense-d435"]
    mesh = chair.transformed(1.0 / chair.longest_side)
    pose = look_at(mesh.centre + np.array([1.4, 0.3, 0.5]), mesh.centre)
    expected = zo.scan(mesh, sensor if noise else sensor.with_numbers(noise=0.0), pose, seed=0)
    with MovingCamera(mesh) as camera:
        seen = camera.see(pose, N, sensor, has_noise=noise)
        turned = camera.see(look_at(pose[:3, 3], 2 * pose[:3, 3] - mesh.centre), N, sensor, has_noise=noise)
    assert len(expected) > 100
    assert np.allclose(seen.cloud.points, expected.points, rtol=0.0, atol=1e-9)
    assert 0 < len(seen.hidden) < N
    assert len(turned.cloud) == 0, "it looks away"


def test_the_cloud_is_saved_and_read_again(chair: zo.Mesh, tmp_path: Path) -> None:
    with MovingCamera(chair) as camera:
        seen = camera.see(look_at(chair.centre + np.array([2.0, 1.0, 1.0]), chair.centre), N)
    seen.cloud.save(tmp_path / "cloud.ply")
    assert np.allclose(trimesh.load(tmp_path / "cloud.ply").vertices, seen.cloud.points)


def test_a_place_out_of_bounds_is_refused(chair: zo.Mesh) -> None:
    pose = np.eye(4)
    pose[:3, 3] = 1e20
    with MovingCamera(chair) as camera, pytest.raises(ArgumentError, match="diagonals"):
        camera.see(pose, N)
