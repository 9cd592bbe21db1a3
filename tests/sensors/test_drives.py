"""Drives: rigs that move through a room, closed forms of their sweeps; roads along a path; files of rigs."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import box
from zbuf_occlude.sensors import DriveSweep, Motion, Mounted, Rig, make, mount_pose, read_rig, scan_drive
from zbuf_occlude.sensors.drives import sweeps_held
from zbuf_occlude.sensors.scenes import Placed, Scene, moved
from zbuf_occlude.sensors.scenes.road import GROUND_HALF, road_along

HALF = np.array([30.0, 30.0, 3.0])
ROOM = Placed(box(tuple(2 * HALF)), "room")
LIDAR = make("vlp-16", noise=0, range_min=0, columns=180)
ARC = Motion(velocity=(8.0, 0.0, 0.0), turn=60.0, deskew=True)
TWO = Rig([
    Mounted("top", LIDAR, mount_pose((0.0, 0.0, 1.0))),
    Mounted("side", LIDAR, mount_pose((1.5, -0.8, 0.2), yaw=-90.0, pitch=10.0, roll=5.0)),
])  # fmt: skip


def driven(motion: Motion, n: int, rig: Rig = TWO, *others: Placed, **options: Any) -> list[DriveSweep]:
    return list(scan_drive(Scene.joined([ROOM, *others]), rig, motion, n, **options))


def off_the_walls(points: np.ndarray) -> np.ndarray:
    return np.abs(np.abs(points) - HALF).min(axis=1)


def rows_of(motion: Motion, times: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """A trajectory that samples a motion in the plane from a pose on."""
    rotations, places = motion.poses(times)
    yaws = np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0]) + np.arctan2(pose[1, 0], pose[0, 0])
    zero = np.zeros_like(times)
    places = places @ pose[:3, :3].T + pose[:3, 3]
    return np.column_stack([times + 5.0, places, zero, zero, np.sin(yaws / 2), np.cos(yaws / 2)])


def test_all_sweeps_of_all_sensors_lie_on_the_walls_of_the_room() -> None:
    for sweep in driven(ARC, 4):
        assert sweep.time == pytest.approx(0.1 * sweep.number)
        angle = np.radians(6.0 * sweep.number)
        assert sweep.pose[:2, 0] == pytest.approx([np.cos(angle), np.sin(angle)])
        radius = 8.0 / np.radians(60.0)
        assert sweep.pose[:3, 3] == pytest.approx([radius * np.sin(angle), radius * (1 - np.cos(angle)), 0.0])
        for scan in sweep.scans.values():
            assert len(scan) > 2000
            assert off_the_walls(scan.points).max() < 1e-9
            assert scan.times.max() < 0.1


def test_a_trajectory_is_in_the_frame_of_the_world() -> None:
    start = moved(yaw=90.0, to=(-4.0, 2.0, 0.0))
    rows = rows_of(ARC, np.linspace(0.0, 0.4, 401), start) * ([1.0] * 4 + [3.0] * 4)  # any length of quaternions
    along, by_arc = driven(Motion(trajectory=rows, deskew=True), 4), driven(ARC, 4)
    for one, other in zip(along, by_arc, strict=True):
        assert one.pose == pytest.approx(start @ other.pose, abs=1e-5)
        assert off_the_walls(one.scans["side"].points).max() < 1e-9


def test_as_reported_each_sweep_is_the_scan_of_a_moving_sensor_from_its_pose() -> None:
    """Above the origin of the rig a sensor moves as the rig does."""
    motion = replace(ARC, deskew=False)
    for sweep in driven(motion, 3, Rig(TWO[:1])):
        alone = zo.scan(Scene.joined([ROOM]), LIDAR, sweep.pose @ TWO[0].pose, motion=motion)
        assert sweep.scans["top"].points == pytest.approx(alone.points, abs=1e-9)
        assert off_the_walls(alone.points).max() > 0.1


def test_a_motion_that_has_begun_is_the_rest_of_its_trajectory() -> None:
    rows = rows_of(ARC, np.linspace(0.0, 1.0, 101), np.eye(4))
    times = np.linspace(0.0, 0.5, 23)
    for one, other in zip(
        Motion(trajectory=rows, begin=0.3).poses(times), Motion(trajectory=rows[30:]).poses(times), strict=True
    ):
        assert one == pytest.approx(other, abs=1e-12)


def test_a_motion_that_has_begun_on_a_mount_is_plain_data() -> None:
    motion = Motion(velocity=(1.0, 0.0, 0.0), begin=0.5, mount=mount_pose((1.0, 2.0, 3.0), yaw=20.0))
    again = Motion(**json.loads(json.dumps(motion.to_dict())))
    for one, other in zip(again.poses(np.array([0.3])), motion.poses(np.array([0.3])), strict=True):
        assert np.array_equal(one, other)


def test_a_sensor_ahead_of_the_centre_of_a_turn_moves_on_a_circle() -> None:
    motion = Motion(turn=90.0, mount=mount_pose((2.0, 0.0, 1.0), yaw=90.0))
    rotations, places = motion.poses(np.array([0.0, 1.0, 2.0]))
    assert places == pytest.approx(np.array([[0, 0, 0], [2, 2, 0], [0, 4, 0]]), abs=1e-9)  # x of the sensor is left
    assert rotations[1] @ [1, 0, 0] == pytest.approx([0, 1, 0])


def test_objects_move_on_from_sweep_to_sweep() -> None:
    crate = Placed(box((1.0, 4.0, 2.0)), "crate", moved(to=(20.0, 0.0, 0.0)), velocity=(-8.0, 0.0, 0.0), albedo=0.5)
    for sweep in driven(Motion(deskew=True), 3, Rig(TWO[:1]), crate):
        scan = sweep.scans["top"]
        front = scan.select((scan.instances == 1) & (np.abs(scan.normals[:, 0]) > 0.99))
        assert len(front) > 10
        assert front.points[:, 0] == pytest.approx(19.5 - 8.0 * (sweep.time + front.times), abs=1e-9)
        assert sweep.scene.albedos.tolist() == pytest.approx([0.2, 0.5])


def test_patterns_that_do_not_repeat_go_on() -> None:
    for name in ("mid-360", "mid-40"):
        sensor = make(name, noise=0, range_min=0, rate=5000)
        one, two = driven(Motion(), 2, Rig([Mounted("a", sensor, np.eye(4))]))
        assert len(one.scans["a"]) == len(two.scans["a"]) == 500
        assert np.abs(one.scans["a"].directions - two.scans["a"].directions).max(axis=1).min() > 1e-6
        whole = make(sensor, seconds=0.2).rays()
        assert two.scans["a"].directions == pytest.approx(whole.directions[500:], abs=1e-9)


def test_the_same_seed_gives_the_same_drive_and_sweeps_differ_in_noise() -> None:
    rig = Rig([Mounted("a", make(LIDAR, noise=1, sigma=0.05), np.eye(4))])
    one, other = (driven(Motion(), 2, rig, seed=4) for _ in range(2))
    for a, b in zip(one, other, strict=True):
        assert np.array_equal(a.scans["a"].ranges, b.scans["a"].ranges)
    assert not np.array_equal(one[0].scans["a"].ranges, one[1].scans["a"].ranges)


def test_a_trajectory_holds_whole_sweeps() -> None:
    rows = rows_of(ARC, np.array([0.0, 0.1, 0.299999999]), np.eye(4))
    assert len(driven(Motion(trajectory=rows), 3)) == 3
    with pytest.raises(zo.OptionError, match=r"holds 3 whole sweeps of 0\.1 s; 4 were"):
        driven(Motion(trajectory=rows), 4)
    slow = Rig([*TWO, Mounted("slow", make(LIDAR, turns=5), np.eye(4))])
    assert [sweep.time for sweep in driven(Motion(), 2, slow)] == [0.0, 0.2]
    with pytest.raises(zo.ArgumentError, match="no begin and no mount"):
        driven(Motion(begin=1.0), 1)


def test_unix_times_hold_as_many_sweeps() -> None:
    rig = Rig([Mounted("a", make(LIDAR, turns=20), np.eye(4))])
    rows = rows_of(ARC, np.linspace(0.0, 0.35, 8), np.eye(4))
    rows[:, 0] += 1.7e9
    assert sweeps_held(rig, Motion(trajectory=rows)) == 7


def test_a_rig_from_a_file(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("kind: spinning\nelevations: {from: -9, to: 9, n: 3}\ncolumns: 90\n")
    (tmp_path / "rig.yaml").write_text(
        "sensors:\n  - {sensor: mine.yaml}\n  - {name: b, sensor: vlp-16, position: [1, 2, 3], yaw: 90, pitch: 90}\n"
    )
    first, second = read_rig(tmp_path / "rig.yaml")
    assert (first.name, len(first.sensor.rays()), first.pose[2, 3]) == ("mine", 270, 1.73)
    assert second.pose[:3, 3].tolist() == [1, 2, 3]
    assert second.pose[:3, :3] == pytest.approx(np.array([[0, -1, 0], [0, 0, 1], [-1, 0, 0]]), abs=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("top: vlp-16", "no list of sensors alone"),
        ("sensors: []", "no list of sensors alone"),
        ("sensors: [vlp-16]", "sensor 1 .*must have `sensor:`"),
        ("sensors: [{sensor: vlp-17}]", "one of vlp-16"),
        ("sensors: [{sensor: vlp-16}, {sensor: vlp-16}]", "'vlp-16' is there twice. Give `name:`"),
        ("sensors: [{sensor: vlp-16, hight: 2}]", "a key of sensor 1 .*got 'hight'"),
        ("sensors: [{sensor: vlp-16, position: [1, 2]}]", "position of sensor 1 .*3 numbers"),
        ("sensors: [{sensor: vlp-16, yaw: left}]", "yaw of sensor 1 .*degrees; got 'left'"),
    ],
)
def test_a_wrong_rig(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "rig.yaml").write_text(text)
    with pytest.raises(zo.OptionError, match=words):
        read_rig(tmp_path / "rig.yaml")


def test_a_road_keeps_clear_of_its_path_and_its_objects_of_each_other() -> None:
    turns = np.linspace(0.0, 1.5 * np.pi, 100)
    path = np.stack([40.0 * np.sin(turns), 40.0 * (1 - np.cos(turns)), 0 * turns], axis=1)
    placed = road_along(path, np.random.SeedSequence(3))
    labels = [each.label for each in placed]
    assert labels[0] == "ground"
    assert np.abs(placed[0].vertices[:, :2]).min() >= GROUND_HALF
    assert {"car", "pole", "building"} <= set(labels)
    assert len(placed) > 40
    for each in placed[1:]:
        assert each.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-6)
        near = np.linalg.norm(each.vertices[:, None, :2] - path[None, ::3, :2], axis=2).min()
        assert near > 1.5, each.label  # half a car, and a bit
    again = road_along(path, np.random.SeedSequence(3))
    assert all(np.array_equal(a.pose, b.pose) for a, b in zip(placed, again, strict=True))
    assert len(road_along(np.zeros((5, 3)), np.random.SeedSequence(3))) > 10  # a rig that stands still
