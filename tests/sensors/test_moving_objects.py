"""Objects that move while a LiDAR sweeps: closed forms, and scans at rest of where each is by then."""

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import box, soup
from zbuf_occlude.sensors import Motion, Scan, make
from zbuf_occlude.sensors.scenes import Placed, Scene, moved

ROOM, VAN = Placed(box((60.0, 60.0, 6.0)), "room"), box((1.0, 4.0, 2.0))
LIDAR = make("vlp-16", noise=0, range_min=0, columns=3600)
AZIMUTHS = np.radians(np.arange(3600) * 0.1 - 180.0)
TIMES = np.arange(3600) / 36_000.0


def van_from(velocity: tuple[float, float, float], turn: float = 0.0) -> Scan:
    scene = Scene.joined([ROOM, Placed(VAN, "van", moved(to=(10.0, 0.0, 0.0)), velocity=velocity, turn=turn)])
    found = zo.scan(scene, LIDAR)
    return found.select(found.instances == 1)


@pytest.mark.parametrize("speed", [30.0, -30.0, 0.0])
def test_a_van_across_the_sweep_is_longer_with_it_and_shorter_against_it(speed: float) -> None:
    """Its front, 9.5 m away and 4 m wide, is met by the firings that find it there: stretched by speed x time."""
    found = van_from((0.0, speed, 0.0))
    front = found.select((np.abs(found.points[:, 0] - 9.5) < 1e-9) & (found.rings == 8))
    expected = np.flatnonzero((np.abs(9.5 * np.tan(AZIMUTHS) - speed * TIMES) <= 2.0) & (np.abs(AZIMUTHS) < 1.0))
    assert np.array_equal(front.columns, expected)
    length, seconds = np.ptp(front.points[:, 1]), np.ptp(front.times)
    assert length == pytest.approx(4.0 + speed * seconds, abs=0.04)  # two firings are 0.02 m apart


def test_a_van_that_drives_away_is_met_where_it_is_by_then() -> None:
    found = van_from((20.0, 0.0, 1.0))
    front = found.select(np.abs(np.abs(found.normals[:, 0]) - 1.0) < 1e-9)
    assert len(front) > 1000
    assert front.points[:, 0] == pytest.approx(9.5 + 20.0 * front.times, rel=1e-12)


def test_each_firing_is_a_scan_at_rest_of_the_scene_by_then() -> None:
    """Objects that drive, turn and hide each other, and a sensor that moves: by the oracle, mesh by mesh."""
    motion = Motion(velocity=(5.0, 2.0, 0.0), turn=20.0, deskew=True)
    drives = [((0.0, 25.0, 0.0), 0.0, (8.0, -2.0, 0.0)), ((-12.0, 3.0, 0.5), -400.0, (11.0, 0.5, 0.3))]
    parts = [box((0.5, 3.0, 2.0)), soup(30, 0.5, seed=3).transformed(3.0)]
    placed = [
        Placed(mesh, "object", moved(to=to), velocity=velocity, turn=turn)
        for mesh, (velocity, turn, to) in zip(parts, drives, strict=True)
    ]
    sensor = make("vlp-16", noise=0, range_min=0, columns=300, azimuths=[-40, 40])
    found = zo.scan(Scene.joined([ROOM, *placed]), sensor, motion=motion)
    assert set(found.instances) == {0, 1, 2}
    rays = sensor.rays()
    for firing in range(0, 300, 12):
        time = firing / 3000.0
        there = [ROOM]
        for mesh, (velocity, turn, to) in zip(parts, drives, strict=True):
            angle, rate, (vx, vy, vz) = np.radians(turn) * time, np.radians(turn), velocity
            along, across = (np.sin(angle) / rate, (1 - np.cos(angle)) / rate) if turn else (time, 0.0)
            way = np.array([vx * along - vy * across, vx * across + vy * along, vz * time])
            there.append(Placed(mesh, "object", moved(yaw=np.degrees(angle), to=np.array(to) + way)))
        rotation, place = motion.poses(np.array([time]))
        mine = rays.columns == firing
        now, scene = found.select(found.columns == firing), Scene.joined(there)
        with zo.prepare(scene.mesh, "oracle") as oracle:
            hits = oracle.first_hits(place, rays.directions[mine] @ rotation[0].T)
        assert np.array_equal(now.face_ids, hits.face_ids[hits.face_ids >= 0])
        assert now.ranges == pytest.approx(hits.distances[hits.face_ids >= 0], rel=1e-9)
        normals = scene.mesh.face_normals[now.face_ids]
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        assert np.abs(np.einsum("ij,ij->i", normals, now.normals)) == pytest.approx(1.0)


def test_a_camera_that_looks_once_sees_them_at_the_start() -> None:
    camera = make("pinhole:width=60,height=40,fov=60,noise=0")
    scenes = [Scene.joined([ROOM, Placed(VAN, "van", moved(to=(10.0, 0.0, 0.0)), velocity=(v, 0, 0))]) for v in (0, 9)]
    still = zo.scan(scenes[0], camera)
    with pytest.warns(UserWarning, match="readout"):
        driving = zo.scan(scenes[1], camera)
    assert np.array_equal(still.face_ids, driving.face_ids)
    assert np.array_equal(still.ranges, driving.ranges)


def test_moving_objects_are_refused_where_they_mean_nothing() -> None:
    with pytest.raises(zo.ArgumentError, match="velocity of van"):
        Placed(VAN, "van", velocity=(1.0, np.nan, 0.0))
    with pytest.raises(zo.ArgumentError, match="turn of van"):
        Placed(VAN, "van", turn=np.inf)
    for bad in ({"albedo": "x"}, {"pose": "x"}):
        with pytest.raises(zo.ArgumentError, match=rf"{next(iter(bad))} of van must"):
            Placed(VAN, "van", **bad)
    scene = Scene.joined([Placed(VAN, "van", velocity=(1.0, 0.0, 0.0))])
    with pytest.raises(zo.ArgumentError, match="second camera"):
        zo.scan(scene, make("vlp-16", baseline=[0, 0.1, 0]))
    with zo.prepare(scene.mesh, "exact") as occluder, pytest.raises(zo.ArgumentError, match="prepare_scene"):
        zo.scan(scene, "vlp-16", occluder=occluder)
