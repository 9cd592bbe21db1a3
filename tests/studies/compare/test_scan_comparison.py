"""compare_scans on simulated scans, whose measures are known; all formats of files and poses."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("PIL", reason="Pillow is not installed: pip install 'zbuf-occlude[report]'")

from PIL import Image

import zbuf_occlude as zo
from tests.scenes import box, sphere, together
from zbuf_occlude.sensors import look_at, make
from zbuf_occlude.sensors.scenes import Placed, moved
from zbuf_occlude.studies.compare.scan_comparison import BOTH, NOT_SCANNED, write_scan_report
from zbuf_occlude.studies.compare.scan_files import read_scan_file

pytestmark = pytest.mark.needs("open3d")

CAMERA = make("pinhole:width=320,height=240,fov=40,noise=0")
STANDS = look_at([3.0, 1.0, 0.7], [0.0, 0.0, 0.0])


def finely(mesh: zo.Mesh, n: int) -> zo.Mesh:
    """Halve all edges n times, for a dense set of vertices."""
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
    """Return the points of a scan in the sensor's frame."""
    return (zo.scan(mesh, sensor, pose).points - pose[:3, 3]) @ pose[:3, :3]


def test_a_scan_of_the_sensor_itself_agrees(thing: zo.Mesh) -> None:
    (found,) = zo.compare_scans(thing, [seen_by(thing, CAMERA)], CAMERA, poses=[STANDS])
    assert found.false_hidden == 0.0
    assert found.agreement > 0.85
    assert found.n_real == found.n_simulated > 5_000
    assert abs(found.residual) < 1e-12
    assert found.sigma < 1e-12
    assert sum(span["real"] for span in found.by_range) == found.n_real
    assert all(span["real"] == span["simulated"] for span in found.by_incidence)


def test_what_a_second_eye_misses_is_found(thing: zo.Mesh) -> None:
    two = CAMERA.with_numbers(baseline=[0.0, -0.6, 0.0])
    real = seen_by(thing, two)
    (by_one,), (by_two,) = (zo.compare_scans(thing, [real], sensor, poses=[STANDS]) for sensor in (CAMERA, two))
    assert by_two.agreement > 0.85
    assert by_one.agreement < by_two.agreement - 0.02
    assert by_one.share(NOT_SCANNED) > by_two.share(NOT_SCANNED) + 0.02
    assert (by_one.cases == BOTH).mean() == pytest.approx((by_two.cases == BOTH).mean(), abs=0.01)


def test_points_behind_the_surface_are_hidden(thing: zo.Mesh) -> None:
    real = seen_by(thing, CAMERA)
    moved = np.array(real)
    moved[::4] *= 1.05  # 15 cm behind
    (found,) = zo.compare_scans(thing, [moved], CAMERA, poses=[STANDS], slack=0.05, tolerance=0.02)
    assert found.false_hidden == pytest.approx(0.25, abs=0.01)
    half = real[real[:, 1] > np.median(real[:, 1])]
    (found,) = zo.compare_scans(thing, [half], CAMERA, poses=[STANDS])
    (whole,) = zo.compare_scans(thing, [real], CAMERA, poses=[STANDS])
    assert (found.cases == NOT_SCANNED).mean() == pytest.approx((whole.cases == BOTH).mean() / 2, abs=0.1)
    assert found.agreement == pytest.approx(whole.agreement / 2, abs=0.2)


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
    """The scans have a frame of their own."""
    frame = look_at([0.3, -2.0, 1.0], [1.0, 1.0, 1.0])
    points = zo.scan(thing, CAMERA, STANDS).points
    local = (points - frame[:3, 3]) @ frame[:3, :3]
    mounted = np.linalg.inv(frame) @ STANDS
    (found,) = zo.compare_scans(thing, [local], CAMERA, poses=[frame], sensor_pose=mounted)
    assert found.false_hidden == 0.0
    assert found.agreement > 0.85


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
    millimetres = (-1000.0 * to_camera @ STANDS[:3, 3]).tolist()
    row = {"cam_R_m2c": to_camera.ravel().tolist(), "cam_t_m2c": millimetres, "obj_id": 1}
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
        ([np.eye(3)], {"poses": [np.diag([1.0, 1.0, 1.0, 5.0])]}, "last row"),
        ([np.eye(3)], {"poses": [np.full((4, 4), np.nan)]}, "finite"),
        ([np.eye(3)], {"sensor_pose": np.diag([2.0, 2.0, 2.0, 1.0])}, "rigid"),
        ([np.eye(3) * 1e155], {}, "at most"),
    ],
)
def test_scans_that_are_none(thing: zo.Mesh, scans: list[Any], given: dict[str, Any], words: str) -> None:
    with pytest.raises(zo.ArgumentError, match=words):
        zo.compare_scans(thing, scans, CAMERA, **given)


def test_coordinates_beyond_all_measure_are_refused(thing: zo.Mesh, tmp_path: Path) -> None:
    np.save(tmp_path / "far.npy", np.array([[1e155, 0, 0], [0.5, 0, 0], [0.5, 0.1, 0]]))
    with pytest.raises(zo.DatasetError, match=r"coordinates must be below 1e\+70; one is 1e\+155"):
        zo.compare_scans(thing, [tmp_path / "far.npy"], CAMERA)


def test_a_scan_with_lines_of_another_kind_is_read(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    header = "ply\nformat ascii 1.0\nbye\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
    (tmp_path / "a.ply").write_text(header + "end_header\n1 2 3\n4 5 6\n")
    assert read_scan_file(tmp_path / "a.ply", CAMERA, 0.001).tolist() == [[1, 2, 3], [4, 5, 6]]
    assert "1 lines of its header are not PLY" in caplog.text


def test_a_files_own_axes_are_the_meshs(thing: zo.Mesh, tmp_path: Path) -> None:
    """glTF has y up, which `load_mesh` turns; poses refer to the axes in the file."""
    import trimesh

    trimesh.Trimesh(thing.vertices, thing.faces, process=False).export(tmp_path / "thing.glb")
    (found,) = zo.compare_scans(tmp_path / "thing.glb", [seen_by(thing, CAMERA)], CAMERA, poses=[STANDS], slack=0.01)
    assert found.false_hidden == 0.0
    assert found.agreement > 0.85


def test_what_is_nowhere_near_is_refused(thing: zo.Mesh) -> None:
    """Wrong unit or missing pose: the message has both sizes and their ratio."""
    real = seen_by(thing, CAMERA)
    with pytest.raises(zo.ArgumentError, match=r"near the mesh.*1,000 times as large.*Scale it by 0\.001"):
        zo.compare_scans(thing.transformed(1000.0), [real], CAMERA, poses=[STANDS])
    with pytest.raises(zo.ArgumentError, match=r"1,000 times smaller.*Scale it by 1000"):
        zo.compare_scans(thing.transformed(0.001), [real], CAMERA, poses=[STANDS])
    with pytest.raises(zo.ArgumentError, match=r"points are .* apart.*100 times smaller"):
        zo.compare_scans(thing, [real[::40] * 100.0], CAMERA, poses=[STANDS])
    with pytest.raises(zo.ArgumentError, match=r"near the mesh.*pose"):
        zo.compare_scans(thing, [real], CAMERA)


def test_figures_without_data_are_absent(thing: zo.Mesh, tmp_path: Path) -> None:
    """Incidences on a wall before a camera are below 30 degrees; a sensor that looks away predicts nothing."""
    wall = finely(zo.Mesh([[0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]], [[0, 1, 2], [0, 2, 3]]), 3)
    before = look_at([5.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    (found,) = zo.compare_scans(wall, [seen_by(wall, CAMERA, before)], CAMERA, poses=[before])
    spreads = [span["sigma"] for span in found.by_incidence]
    assert np.isnan(spreads).tolist() == [False, False, True, True, True, True]
    assert [span["sigma"] for span in found.to_dict()["by_incidence"]][2:] == [None] * 4
    away = look_at([5.0, 0.0, 0.0], [9.0, 0.0, 0.0])
    vertices = (wall.vertices - away[:3, 3]) @ away[:3, :3]
    (found,) = zo.compare_scans(wall, [vertices], CAMERA, poses=[away], tolerance=1e-6, slack=1e-6)
    assert found.n_simulated == 0
    assert found.agreement == 0.0, "what was scanned was not predicted"
    behind = seen_by(thing, CAMERA) * 1.05
    (found,) = zo.compare_scans(thing, [behind], CAMERA, poses=[STANDS], slack=1e-3, tolerance=0.3)
    assert found.false_hidden > 0.99
    lone = replace(found, cases=np.full_like(found.cases, 3), residual=np.nan, sigma=np.nan, sensor_sigma=np.nan)
    assert np.isnan(lone.agreement)
    assert "\N{EN DASH} of vertices agree" in repr(lone)
    write_scan_report(tmp_path, [lone], CAMERA)
    text = (tmp_path / "scans.json").read_text()
    assert "NaN" not in text
    document = json.loads(text)["scans"][0]
    assert document["agreement"] is document["residual"]["median"] is document["residual"]["sigma"] is None
    row = next(line for line in (tmp_path / "scans.md").read_text().splitlines() if line.startswith("| scan 0"))
    assert row.count("\N{EN DASH}") == 5


def test_folders_of_bop_are_read_as_they_are(thing: zo.Mesh, tmp_path: Path) -> None:
    """BOP: millimetres, K from the first pixel's centre, other depth units; each object with its model."""
    small = box((0.3, 0.2, 0.1))
    scene = zo.Scene.joined([Placed(thing, "thing"), Placed(small, "crate", moved(yaw=20.0, to=(0.0, 1.2, 0.1)))])
    views = zo.views.for_mesh(scene.mesh, "ring:2@30")
    zo.write_bop(tmp_path, scene, views, width=200, height=150, fov=45)
    train = tmp_path / "train" / "000000"
    cameras = json.loads((train / "scene_camera.json").read_text())
    for number in cameras:  # as another tool may have scaled them
        with Image.open(train / "depth" / f"{int(number):06d}.png") as image:
            half = np.asarray(image) // 2
        Image.fromarray(half.astype(np.uint16)).save(train / "depth" / f"{int(number):06d}.png")
        cameras[number]["depth_scale"] *= 2.0
    (train / "scene_camera.json").write_text(json.dumps(cameras))
    images = sorted((train / "depth").iterdir())
    models = [tmp_path / "models" / f"obj_00000{i}.ply" for i in (1, 2)]
    step = cameras["0"]["depth_scale"] / 1000.0
    for model, n_pixels in ((models[0], 1000), (models[1], 50)):
        given = {"poses": train / "scene_gt.json", "slack": 4 * step}
        for found in zo.compare_scans(model, images[::-1], "pinhole:noise=0", **given):
            assert found.false_hidden == 0.0
            assert abs(found.residual) < step
            assert n_pixels < found.n_simulated < found.n_real
    first, second = zo.compare_scans(models[0], images, "pinhole", poses=train / "scene_gt.json", tolerance=0.03)
    assert min(first.agreement, second.agreement) > 0.75
    with pytest.raises(zo.DatasetError, match=r"objects 1, 2.*models"):
        zo.compare_scans(thing, images, "pinhole", poses=train / "scene_gt.json")
    with pytest.raises(zo.OptionError, match="pinhole"):
        zo.compare_scans(models[0], images, "vlp-16", poses=train / "scene_gt.json")
    (train / "scene_camera.json").write_text('{"0": {}}')
    with pytest.raises(zo.DatasetError, match=r"scene_camera\.json.*cam_K"):
        zo.compare_scans(models[0], images[:1], "pinhole", poses=train / "scene_gt.json")
