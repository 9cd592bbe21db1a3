"""SemanticKITTI's layout: files read back by its own formulas, labels of classes, instances and moving objects."""

from pathlib import Path

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import box
from zbuf_occlude.datasets.sequences import semantickitti
from zbuf_occlude.meshes.shapes import road_user
from zbuf_occlude.sensors import Motion, Mounted, Rig, make, mount_pose, scan_drive
from zbuf_occlude.sensors.scenes import Placed, Scene, moved

LIDAR = make("vlp-16", noise=0, range_min=0, columns=180)
RIG = Rig([
    Mounted("top", LIDAR, mount_pose((0.3, 0.0, 1.8), yaw=5.0)),
    Mounted("side", LIDAR, mount_pose((0.0, -0.9, 0.7), yaw=-90.0)),
])  # fmt: skip
GROUND = Placed(box((200.0, 200.0, 2.0)), "ground", moved(to=(0.0, 0.0, -1.0)), albedo=0.4, is_background=True)
CAR = Placed(box((4.0, 1.8, 1.5)), "van", moved(to=(10.0, 3.0, 0.75)), albedo=0.3)
BUS = Placed(box((10.0, 2.5, 3.0)), "bus", moved(to=(14.0, -6.0, 1.5)), albedo=0.3, velocity=(-9.0, 0.0, 0.0))


def matrices(path: Path) -> np.ndarray:
    """Rows of 12 numbers as (n, 4, 4)."""
    rows = np.loadtxt([line.rpartition(":")[2] for line in path.read_text().splitlines()], ndmin=2).reshape(-1, 3, 4)
    return np.concatenate([rows, np.broadcast_to([[[0.0, 0.0, 0.0, 1.0]]], (len(rows), 1, 4))], axis=1)


def test_a_sequence_read_by_the_formulas_of_its_authors(tmp_path: Path) -> None:
    motion = Motion(velocity=(12.0, 0.0, 0.0), turn=40.0, deskew=True)
    scene = Scene.joined([GROUND, CAR, BUS])
    sweeps = list(semantickitti.write(tmp_path, 7, RIG, scan_drive(scene, RIG, motion, 4)))
    folder = tmp_path / "sequences/07"
    assert sorted(path.name for path in folder.iterdir()) == [
        "calib.txt",
        "labels",
        "poses.txt",
        "times.txt",
        "velodyne",
    ]
    assert np.loadtxt(folder / "times.txt") == pytest.approx([0.0, 0.1, 0.2, 0.3])
    *_, to_camera = matrices(folder / "calib.txt")
    poses = np.linalg.inv(to_camera) @ matrices(folder / "poses.txt") @ to_camera
    assert poses[0] == pytest.approx(np.eye(4), abs=1e-9)
    first = sweeps[0].pose @ RIG[0].pose
    for sweep, pose in zip(sweeps, poses, strict=True):
        cloud = np.fromfile(folder / f"velodyne/{sweep.number:06d}.bin", "<f4").reshape(-1, 4)
        labels = np.fromfile(folder / f"labels/{sweep.number:06d}.label", "<u4")
        whole = first @ pose
        points = cloud[:, :3] @ whole[:3, :3].T + whole[:3, 3]
        assert len(labels) == len(points) == sum(len(scan) for scan in sweep.scans.values())
        kinds, instances = labels & 0xFFFF, labels >> 16
        assert set(kinds.tolist()) == {40, 10, 257}  # road, car, moving-bus
        assert set(instances[kinds == 40].tolist()) == {0}
        assert {len(set(instances[kinds == kind].tolist())) for kind in (10, 257)} == {1}
        assert np.abs(points[kinds == 40, 2]).max() < 1e-4
        off = np.abs(np.abs(points[kinds == 10] - [10.0, 3.0, 0.75]) - [2.0, 0.9, 0.75]).min(axis=1)
        assert off.max() < 1e-4
        assert cloud[kinds == 40, 3].max() <= 0.4
        times = np.concatenate([scan.times for scan in sweep.scans.values()]) + sweep.time
        along = points[kinds == 257, 0] - (14.0 - 9.0 * times[kinds == 257])
        assert np.abs(along).max() < 5.001


def test_classes_and_instances() -> None:
    names = ("Car", "pedestrian", "tractor", "building", "vegetation", "gnome")
    parked = road_user("bicycle", (1.8, 0.6, 1.1))
    placed = [Placed(box(), name) for name in names]
    placed += [Placed(road_user("bicycle"), "bicycle"), Placed(parked, "bicycle")]
    placed += [Placed(road_user("motorcycle"), "motorcycle", turn=3.0)]
    labels = semantickitti.labels_of(Scene.joined(placed))
    assert (labels & 0xFFFF).tolist() == [10, 30, 20, 50, 70, 99, 31, 11, 255]
    assert (labels >> 16).tolist() == [1, 2, 3, 0, 0, 0, 7, 8, 9]
    assert semantickitti.labels_of(Scene.from_mesh(box(), "car")).tolist() == [10 | 1 << 16]


def test_a_sequence_that_is_there_stays_and_one_that_was_broken_off_does_not(tmp_path: Path) -> None:
    broken = semantickitti.write(tmp_path, 0, RIG, scan_drive(Scene.joined([GROUND]), RIG, Motion(), 3))
    next(broken)
    broken.close()
    semantickitti.check(tmp_path, 0, RIG)
    for _ in semantickitti.write(tmp_path, 0, RIG, scan_drive(Scene.joined([GROUND]), RIG, Motion(), 1)):
        pass
    assert [path.name for path in (tmp_path / "sequences").iterdir()] == ["00"]
    assert len(list((tmp_path / "sequences/00/velodyne").iterdir())) == 1
    with pytest.raises(zo.DatasetError, match="is there already"):
        semantickitti.check(tmp_path, 0, RIG)
