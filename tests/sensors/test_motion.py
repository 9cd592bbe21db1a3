"""Sensors that move while they scan, against closed forms and against scans at rest."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import ACROSS, box, stacked
from zbuf_occlude.geometry.camera import rotations_of, unit_quaternions
from zbuf_occlude.sensors import Motion, look_at, make, read_trajectory
from zbuf_occlude.sensors.scan_config import ScanConfig

ROOM = box((20.0, 16.0, 6.0))


def lidar(**numbers: Any) -> zo.sensors.Sensor:
    return make("vlp-16", noise=0, range_min=0, columns=360, **numbers)


def test_a_turning_lidar_closes_its_sweep_early_or_late() -> None:
    """Turned by 36 degrees a second, ten sweeps a second: the ends of a sweep are 3.6 degrees apart."""
    scan = zo.scan(ROOM, lidar(), motion=Motion(turn=36.0, deskew=True))
    azimuth = np.degrees(np.unwrap(np.arctan2(scan.directions[:, 1], scan.directions[:, 0])[scan.rings == 8]))
    assert len(azimuth) == 360
    assert azimuth[-1] - azimuth[0] == pytest.approx(359.0 + 3.6 * 359 / 360, abs=1e-9)
    assert scan.times[scan.rings == 8] == pytest.approx(np.arange(360) / 3600.0)
    twice = zo.scan(ROOM, lidar(turns=20.0), motion=Motion(turn=36.0, deskew=True))
    other = np.degrees(np.unwrap(np.arctan2(twice.directions[:, 1], twice.directions[:, 0])[twice.rings == 8]))
    assert other[-1] - other[0] == pytest.approx(359.0 + 1.8 * 359 / 360, abs=1e-9)


def test_a_lidar_that_drives_at_a_wall_measures_it_nearer_and_nearer() -> None:
    wall = stacked(ACROSS * 50.0 + np.array([20.0, 0, 0]))
    scan = zo.scan(wall, lidar(), motion=Motion(velocity=(30.0, 0.0, 0.0)))
    depth = scan.points[:, 0]
    assert depth == pytest.approx(20.0 - 30.0 * scan.times, rel=1e-12)
    assert (scan.offsets == 0).all()
    undone = zo.scan(wall, lidar(), motion=Motion(velocity=(30.0, 0.0, 0.0), deskew=True))
    assert undone.points[:, 0] == pytest.approx(20.0)
    assert np.array_equal(undone.ranges, scan.ranges)
    assert undone.offsets[:, 0] == pytest.approx(30.0 * undone.times)


def test_deskewed_points_lie_where_a_scan_at_rest_has_the_surface() -> None:
    """Each wall of a room keeps its plane, whatever the motion; as reported, the walls are bent."""
    motion = Motion(velocity=(15.0, -4.0, 0.5), turn=90.0)
    pose = look_at([2.0, 1.0, 0.3], [5.0, 3.0, 0.3])
    undone = zo.scan(ROOM, lidar(), pose, motion=replace(motion, deskew=True))
    half = np.array([10.0, 8.0, 3.0])
    off = np.abs(np.abs(undone.points - ROOM.centre) - half).min(axis=1)
    assert off.max() < 1e-9
    bent = zo.scan(ROOM, lidar(), pose, motion=motion)
    assert np.abs(np.abs(bent.points - ROOM.centre) - half).min(axis=1).max() > 0.2
    assert np.einsum("ij,ij->i", bent.normals, bent.directions) == pytest.approx(
        np.einsum("ij,ij->i", undone.normals, undone.directions)
    )


def test_an_arc_is_that_of_a_car() -> None:
    """At 10 m/s and 90 degrees a second a car drives a circle of radius 10 / (pi / 2)."""
    rotations, places = Motion(velocity=(10.0, 0.0, 0.0), turn=90.0).poses(np.array([0.0, 1.0, 2.0, 4.0]))
    radius = 10.0 / (np.pi / 2)
    assert places == pytest.approx(np.array([[0, 0, 0], [radius, radius, 0], [0, 2 * radius, 0], [0, 0, 0]]), abs=1e-9)
    assert rotations[1] @ [1, 0, 0] == pytest.approx([0, 1, 0])


def test_a_trajectory_of_many_poses_is_the_arc_that_it_was_taken_from() -> None:
    motion = Motion(velocity=(10.0, 0.0, 0.0), turn=90.0)
    times = np.linspace(0.0, 0.1, 201)
    rotations, places = motion.poses(times)
    frame = look_at([5.0, -3.0, 2.0], [0.0, 0.0, 0.0])
    rows = []
    for time, rotation, place in zip(
        times, frame[:3, :3] @ rotations, places @ frame[:3, :3].T + frame[:3, 3], strict=True
    ):
        w = np.sqrt(max(1.0 + np.trace(rotation), 1e-12)) / 2.0
        vector = [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
        rows.append([time + 17.0, *place, *(np.array(vector) / (4 * w)), w])
    signs = np.where(np.arange(201) % 2, -1.0, 1.0)[:, None]  # a quaternion and its negative are one rotation
    along = Motion(trajectory=np.array(rows) * np.hstack([np.ones((201, 4)), np.tile(signs, 4)]))
    some = np.linspace(0.0, 0.1, 77)
    for one, other in zip(along.poses(some), motion.poses(some), strict=True):
        assert one == pytest.approx(other, abs=2e-5)
    scans = [zo.scan(ROOM, lidar(), motion=each) for each in (along, motion)]
    assert np.array_equal(scans[0].columns, scans[1].columns)
    assert scans[0].points == pytest.approx(scans[1].points, abs=1e-3)


def test_a_rolling_shutter_leans_what_it_passes() -> None:
    """A camera that moves to the left sees a wall's upright line lean: each row later, by velocity times its time."""
    plate = stacked(ACROSS * np.array([1.0, 0.5, 3.0]) + np.array([5.0, 0, 0]))
    camera = make("pinhole:width=400,height=300,fov=60,noise=0,readout=0.03")
    scan = zo.scan(plate, camera, motion=Motion(velocity=(0.0, 8.0, 0.0)))
    leftmost = np.array([scan.points[scan.rings == row, 1].max() for row in range(300)])
    expected = 0.5 - 8.0 * 0.03 * np.arange(300) / 300
    pixel = 5.0 * 2 * np.tan(np.radians(30)) / 400
    assert np.abs(leftmost - expected).max() <= pixel
    assert leftmost[0] - leftmost[-1] == pytest.approx(0.24, abs=2 * pixel)


def test_at_rest_nothing_changes() -> None:
    plain = zo.scan(ROOM, "vlp-16", seed=3)
    still = zo.scan(ROOM, "vlp-16", seed=3, motion=Motion())
    assert still.points == pytest.approx(plain.points, abs=1e-9)
    assert np.array_equal(still.columns, plain.columns)


def test_trajectories_from_files(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_text("# t x y z qx qy qz qw\n0 0 0 0 0 0 0 1\n\n1 2 0 0 0 0 0 2\n")
    rotations, places = Motion(trajectory=read_trajectory(tmp_path / "t.txt")).poses(np.array([0.5, 9.0]))
    assert places.tolist() == [[1, 0, 0], [2, 0, 0]]
    assert rotations[0].tolist() == np.eye(3).tolist()
    (tmp_path / "w.txt").write_text("0 0 0 0 0 0 1\n")
    with pytest.raises(zo.DatasetError, match="t x y z qx qy qz qw"):
        read_trajectory(tmp_path / "w.txt")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"velocity": [1.0, 2.0]}, "velocity"),
        ({"turn": float("nan")}, "turn"),
        ({"trajectory": [[0, 0, 0, 0, 0, 0, 0, 0]]}, "row 1 .*quaternion"),
        ({"turn": 1.0, "deskew": "no"}, "deskew must be True or False"),
        ({"trajectory": [[1, 0, 0, 0, 0, 0, 0, 1], [0, 0, 0, 0, 0, 0, 0, 1]]}, "row 2 .*later"),
        ({"trajectory": [[0, 0, 0]]}, "trajectory must be"),
        ({"trajectory": [[0], [1, 2]]}, "trajectory must be"),
        ({"trajectory": [[0, 0, 0, 0, 0, 0, 0, 1]], "turn": 3.0}, "not both"),
    ],
)
def test_motions_that_are_none(given: dict[str, Any], words: str) -> None:
    with pytest.raises((zo.ArgumentError, zo.OptionError), match=words):
        Motion(**given)


@pytest.mark.parametrize("size", [1e-200, 1e200])
def test_a_quaternion_of_any_length_is_the_same_rotation(size: float) -> None:
    """A quarter to the left, whose square over- or underflows."""
    rows = [[0, 0, 0, 0, 0, 0, 0, size], [1, 0, 0, 0, 0, 0, size, size]]
    if size > 1.0:
        rotations, _ = Motion(trajectory=rows).poses(np.array([1.0]))
        assert rotations[0] == pytest.approx(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), abs=1e-12)
    turned = rotations_of(unit_quaternions([0.0, 0.0, size, size]))
    assert turned == pytest.approx(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), abs=1e-12)
    with pytest.raises(zo.ArgumentError, match="not zero"):
        unit_quaternions([0.0, 0.0, np.inf, 1.0])


def test_a_pose_with_another_last_row_is_refused() -> None:
    with pytest.raises(zo.ArgumentError, match="last row 0 0 0 1"):
        zo.scan(ROOM, lidar(), np.diag([1.0, 1.0, 1.0, 5.0]))


def test_faults_of_files_have_their_rows(tmp_path: Path) -> None:
    good = "0 0 0 0 0 0 0 1\n"
    for bad in (good, "1 0 0 0 0 0 0 0\n", "nan 0 0 0 0 0 0 1\n"):
        (tmp_path / "t.txt").write_text(good + bad)
        with pytest.raises(zo.DatasetError, match=r"t\.txt.* row 2 must"):
            read_trajectory(tmp_path / "t.txt")
    for bad in ("time x y z qx qy qz qw\n", "1,0,0,0,0,0,0,1\n", "1 2 3\n"):
        (tmp_path / "t.txt").write_text(good + bad)
        with pytest.raises(zo.DatasetError, match=f"must be t x y z qx qy qz qw.*{bad.strip()}"):
            read_trajectory(tmp_path / "t.txt")


def test_a_camera_that_looks_once_cannot_move() -> None:
    for sensor in ("pinhole:width=20,height=10,fov=60", "azure-kinect-nfov"):
        with pytest.raises(zo.OptionError, match="at once; give --set-sensor readout"):
            zo.scan(ROOM, sensor, motion=Motion(turn=1.0))
        with pytest.raises(zo.OptionError, match="at once; give --set-sensor readout"):
            ScanConfig(make(sensor), motion=Motion(turn=1.0))
    with pytest.raises(zo.ArgumentError, match="motion must be a sensors"):
        ScanConfig(make("vlp-16"), motion="left")  # type: ignore[arg-type]
    with pytest.raises(zo.ArgumentError, match="transparent must be a mapping"):
        ScanConfig(make("vlp-16"), transparent=["glass"])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "motion",
    [
        Motion((20, 0, 1), 30, deskew=True),
        Motion(trajectory=[[0, 2, 0.1, 0.3, 0.3, 0.1, 0.7, 3], [1, 5, 0, 0, 0.1, 0, 0.9, 7.1]]),
    ],
)
def test_scans_read_back_are_the_same(motion: Motion) -> None:
    """Quaternions too, which are not of length 1: a plan is known by its numbers."""
    given = ScanConfig(make("vlp-16", sigma=0.1), range="3..7@area", size=2, motion=motion)
    written = json.loads(json.dumps(given.to_dict()))
    assert json.loads(json.dumps(ScanConfig.from_dict(written).to_dict())) == written
    moved = ScanConfig.from_dict(written).motion
    assert moved is not None
    times = np.linspace(0.0, 1.0, 5)
    assert all(map(np.array_equal, moved.poses(times), motion.poses(times)))


def test_a_second_eye_stands_still() -> None:
    with pytest.raises(zo.ArgumentError, match="second camera"):
        zo.scan(ROOM, "kinect-v1", motion=Motion(turn=1.0))
    with pytest.raises(zo.ArgumentError, match="motion must be"):
        zo.scan(ROOM, "vlp-16", motion=(1.0, 0.0, 0.0))  # type: ignore[arg-type]
