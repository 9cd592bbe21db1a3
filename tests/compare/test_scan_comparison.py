"""compare-scans: scans that are known are found as they were made; files and poses of all kinds."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import box, sphere, together
from zbuf_occlude.compare.scan_comparison import BOTH, NOT_SCANNED
from zbuf_occlude.sensors import look_at, make

pytestmark = pytest.mark.needs("open3d")

CAMERA = make("pinhole:width=320,height=240,fov=40,noise=0")
STANDS = look_at([3.0, 1.0, 0.7], [0.0, 0.0, 0.0])


def finely(mesh: zo.Mesh, n: int) -> zo.Mesh:
    """Halve all edges n times, so that there are vertices everywhere."""
    for _ in range(n):
        a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        corners = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
        mesh = zo.Mesh(corners, np.arange(len(corners)).reshape(-1, 3))
    return mesh


@pytest.fixture(scope="module")
def thing() -> zo.Mesh:
    return finely(together(box((1.0, 0.6, 0.4)), sphere(12).transformed(0.5, [0.3, 0.5, 0.4])), 3)


def seen_by(mesh: zo.Mesh, sensor: zo.sensors.Sensor, pose: np.ndarray = STANDS) -> np.ndarray:
    """A scan's points in the sensor's own frame."""
    return (zo.scan(mesh, sensor, pose).points - pose[:3, 3]) @ pose[:3, :3]


def test_a_scan_of_the_sensor_itself_agrees(thing: zo.Mesh) -> None:
    (found,) = zo.compare_scans(thing, [seen_by(thing, CAMERA)], CAMERA, poses=[STANDS])
    assert found.false_hidden == 0.0
    assert found.agreement > 0.95
    assert found.n_real == found.n_simulated > 5_000
    assert abs(found.residual) < 1e-12
    assert found.sigma < 1e-12
    assert sum(span["real"] for span in found.by_range) == found.n_real
    assert all(span["real"] == span["simulated"] for span in found.by_incidence)


def test_what_a_second_eye_misses_is_found(thing: zo.Mesh) -> None:
    two = CAMERA.with_numbers(baseline=[0.0, -0.6, 0.0])
    real = seen_by(thing, two)
    (by_one,), (by_two,) = (zo.compare_scans(thing, [real], sensor, poses=[STANDS]) for sensor in (CAMERA, two))
    assert by_two.agreement > 0.95
    assert by_one.agreement < by_two.agreement - 0.02
    assert by_one.share(NOT_SCANNED) > by_two.share(NOT_SCANNED) + 0.02
    assert by_one.share(BOTH) == pytest.approx(by_two.share(BOTH), abs=0.01)


def test_points_behind_the_surface_are_hidden(thing: zo.Mesh) -> None:
    real = seen_by(thing, CAMERA)
    moved = np.array(real)
    moved[::4] *= 1.05  # 15 cm behind
    (found,) = zo.compare_scans(thing, [moved], CAMERA, poses=[STANDS], slack=0.05, tolerance=0.02)
    assert found.false_hidden == pytest.approx(0.25, abs=0.01)
    half = real[real[:, 1] > np.median(real[:, 1])]
    (found,) = zo.compare_scans(thing, [half], CAMERA, poses=[STANDS])
    (whole,) = zo.compare_scans(thing, [real], CAMERA, poses=[STANDS])
    assert found.share(NOT_SCANNED) == pytest.approx(whole.share(BOTH) / 2, abs=0.1)


def test_noise_is_measured_along_the_ray(thing: zo.Mesh) -> None:
    real = seen_by(thing, CAMERA)
    ranges = np.linalg.norm(real, axis=1, keepdims=True)
    noisy = real * (1.0 + (0.004 + 0.01 * np.random.default_rng(1).normal(size=ranges.shape)) / ranges)
    (found,) = zo.compare_scans(thing, [noisy], CAMERA, poses=[STANDS], slack=0.06)
    assert found.residual == pytest.approx(0.004, abs=0.0005)
    assert found.sigma == pytest.approx(0.01, rel=0.05)


def test_a_pose_a_little_off_is_refined(thing: zo.Mesh) -> None:
    real, off = seen_by(thing, CAMERA), np.array(STANDS)
    off[:3, 3] += [0.01, -0.008, 0.006]
    (found,) = zo.compare_scans(thing, [real], CAMERA, poses=[off], refine=True, slack=0.05)
    assert found.pose[:3, 3] == pytest.approx(STANDS[:3, 3], abs=4e-3)
    assert found.sigma < 2e-3


def test_scans_in_a_frame_of_their_own(thing: zo.Mesh) -> None:
    """The scan's frame is neither the sensor's nor the mesh's."""
    frame = look_at([0.3, -2.0, 1.0], [1.0, 1.0, 1.0])
    points = zo.scan(thing, CAMERA, STANDS).points
    local = (points - frame[:3, 3]) @ frame[:3, :3]
    mounted = np.linalg.inv(frame) @ STANDS
    (found,) = zo.compare_scans(thing, [local], CAMERA, poses=[frame], sensor_pose=mounted)
    assert found.false_hidden == 0.0
    assert found.agreement > 0.95


def test_files_of_all_kinds_hold_the_same_scan(thing: zo.Mesh, tmp_path: Path) -> None:
    import open3d
    from PIL import Image

    scan = zo.scan(thing, CAMERA, STANDS)
    local = seen_by(thing, CAMERA)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(local))
    open3d.io.write_point_cloud(str(tmp_path / "a.pcd"), cloud)
    open3d.io.write_point_cloud(str(tmp_path / "b.ply"), cloud)
    np.save(tmp_path / "c.npy", local)
    np.savez(tmp_path / "d.npz", points=local)
    np.column_stack([local, np.ones(len(local))]).astype("<f4").tofile(tmp_path / "e.bin")
    np.column_stack([local, np.ones(len(local)), np.ones(len(local))]).astype("<f4").tofile(tmp_path / "f.pcd.bin")
    depth = np.zeros((240, 320), np.uint16)
    depth[scan.rings, scan.columns] = np.round(local[:, 0] * 5000)
    Image.fromarray(depth).save(tmp_path / "g.png")
    files = sorted(tmp_path.iterdir())
    assert len(files) == 7
    found = zo.compare_scans(thing, files, CAMERA, poses=[STANDS] * 7, depth_unit=1 / 5000, tolerance=0.02, slack=0.04)
    for each in found:
        assert each.n_real == len(local)
        assert each.false_hidden == 0.0
        assert each.agreement == pytest.approx(found[0].agreement, abs=1e-3)


def test_poses_of_all_kinds(thing: zo.Mesh, tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", seen_by(thing, CAMERA))
    np.savetxt(tmp_path / "square.txt", STANDS)
    np.savetxt(tmp_path / "row.txt", STANDS[:3].reshape(1, 12))
    axes = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # a sensor's frame to a camera's
    to_camera = axes @ STANDS[:3, :3].T
    row = {"cam_R_m2c": to_camera.ravel().tolist(), "cam_t_m2c": (-to_camera @ STANDS[:3, 3]).tolist(), "obj_id": 1}
    (tmp_path / "scene_gt.json").write_text(json.dumps({"0": [row]}))
    w = np.sqrt(1.0 + np.trace(STANDS[:3, :3])) / 2.0
    r = STANDS[:3, :3]
    vector = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / (4.0 * w)
    numbers = [*STANDS[:3, 3], *vector, -w]
    (tmp_path / "a.conf").write_text(
        "camera 0 0 0 0 0 0 1\nbmesh a.npy " + " ".join(f"{x:.9f}" for x in numbers) + "\n"
    )
    for name in ("square.txt", "row.txt", "scene_gt.json", "a.conf"):
        (found,) = zo.compare_scans(thing, [tmp_path / "a.npy"], CAMERA, poses=tmp_path / name)
        assert found.pose == pytest.approx(STANDS, abs=1e-6)
        assert found.false_hidden == 0.0


@pytest.mark.parametrize(
    ("scans", "given", "words"),
    [
        ([np.empty((0, 3))], {}, "must have points"),
        ([[[1.0, 0.0, 0.0]]], {}, "apart from each other"),
        ([[[1.0, 0.0, 0.0]] * 9], {"slack": 0.1}, "apart from each other"),
        ([[[0.0, 0.0, 0.0]] * 9], {}, "must have points"),  # in the sensor itself
        ([np.eye(3)], {"tolerance": -1.0}, "tolerance must be"),
        ([np.eye(3)], {"slack": np.nan}, "slack must be"),
        ([np.eye(3)], {"poses": []}, "poses must be one per scan"),
        ([], {}, "one or more"),
    ],
)
def test_scans_that_are_none(thing: zo.Mesh, scans: list[Any], given: dict[str, Any], words: str) -> None:
    with pytest.raises(zo.ArgumentError, match=words):
        zo.compare_scans(thing, scans, CAMERA, **given)


def test_a_files_own_axes_are_the_meshs(thing: zo.Mesh, tmp_path: Path) -> None:
    """glTF has y up, and `load_mesh` turns it; poses lead to the axes that are in the file."""
    import trimesh

    trimesh.Trimesh(thing.vertices, thing.faces, process=False).export(tmp_path / "thing.glb")
    (found,) = zo.compare_scans(tmp_path / "thing.glb", [seen_by(thing, CAMERA)], CAMERA, poses=[STANDS], slack=0.01)
    assert found.false_hidden == 0.0
    assert found.agreement > 0.95
