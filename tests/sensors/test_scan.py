"""Scans: closed forms, and each imperfection alone."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import ACROSS, box, stacked
from zbuf_occlude.geometry.colors import Material, SurfaceColors
from zbuf_occlude.meshes import shapes
from zbuf_occlude.sensors import Scan, look_at, make
from zbuf_occlude.sensors.noise import apply_dropout, detection_probability, quantise
from zbuf_occlude.sensors.poses import pose_of_camera
from zbuf_occlude.sensors.scenes import Placed, Scene, moved
from zbuf_occlude.sensors.scenes.scene import TYPICAL_ALBEDO


def wall(distance: float, half: float = 1.0) -> zo.Mesh:
    return stacked(ACROSS * half + [distance, 0.0, 0.0])


def flat(distance: float, **numbers: Any) -> tuple[Scan, zo.sensors.Sensor]:
    """A narrow camera's scan of a wall far wider than its picture, so every ray returns nearly at right angles."""
    sensor = make("pinhole:width=200,height=200,fov=2", axial=False, **numbers)
    return zo.scan(wall(distance, distance), sensor, method="oracle"), sensor


@pytest.mark.parametrize("name", ["vlp-16", "hdl-64e", "os1-64", "mid-40", "kinect-v1", "realsense-d435"])
@pytest.mark.parametrize("distance", [1.0, 5.0, 20.0, 60.0])
def test_the_noise_is_the_tables(name: str, distance: float) -> None:
    """Of 40,000 returns the standard deviation is known within .4 %; 3 % are allowed."""
    faults = make(name).noise_model
    numbers = {k: getattr(faults, k) for k in ("sigma", "sigma_growth", "sigma_from")}
    scan, sensor = flat(distance, **numbers)
    assert len(scan) == 40_000
    measured = float(np.std(scan.ranges - scan.clean_ranges))
    assert measured == pytest.approx(float(sensor.noise_model.range_sigma(distance)), rel=0.03)
    written = {"vlp-16": 0.03, "hdl-64e": 0.02, "mid-40": 0.02, "kinect-v1": 0.0012 + 0.0019 * (distance - 0.4) ** 2}
    written["realsense-d435"] = distance**2 * 0.1 / (424 * 0.05)
    if name in written:
        assert measured == pytest.approx(written[name], rel=0.03)


def test_the_least_range_of_a_stereo_camera_is_where_its_matcher_s_search_ends() -> None:
    """A point is 126 pixels apart in the two pictures of a RealSense D435 where it is nearest."""
    sensor = make("realsense-d435")
    (baseline,) = sensor.noise_model.baselines
    disparity = sensor.pixels * np.linalg.norm(baseline) / sensor.noise_model.range_min
    assert disparity == pytest.approx(126.0, rel=0.003)
    assert "126" in sensor.sources["range_min"]


def test_kinects_noise_grows_with_incidence() -> None:
    """Nguyen, Izadi, Lovell 2012: .0001 / sqrt(z) theta^2 / (pi/2 - theta)^2 more from 60 degrees on."""
    sigma = make("kinect-v1").noise_model.range_sigma
    theta = np.radians(75.0)
    more = 0.0001 / np.sqrt(2.0) * theta**2 / (np.pi / 2 - theta) ** 2
    assert float(sigma(2.0, theta) - sigma(2.0, 0.0)) == pytest.approx(more)
    assert float(sigma(2.0, np.radians(59.0))) == float(sigma(2.0))


def test_quantisation() -> None:
    scan, _ = flat(5.003, step=0.01)
    assert np.allclose(scan.ranges, np.round(scan.ranges / 0.01) * 0.01)
    assert np.abs(scan.ranges - scan.clean_ranges).max() <= 0.005 + 1e-12
    assert len(np.unique(scan.ranges.round(6))) < 5
    disparity = quantise(scan, make("pinhole", disparity_step=0.01).noise_model)
    steps = 1.0 / (disparity.ranges * disparity.depths_per_range * 0.01)
    assert np.allclose(steps, np.round(steps), atol=1e-6)


def test_dropout_is_of_the_share_and_of_weak_signals() -> None:
    whole, _ = flat(5.0)
    rng = np.random.default_rng(0)
    some = apply_dropout(whole, make("pinhole", drop=0.3).noise_model, rng)
    assert len(some) / len(whole) == pytest.approx(0.7, abs=0.01)
    faults = make("pinhole", attenuation=0.1, drop_limit=1.0, drop_zero=0.5).noise_model
    weak = apply_dropout(whole, faults, rng)
    assert len(weak) / len(whole) == pytest.approx(1 - 0.5 * (1 - TYPICAL_ALBEDO * np.exp(-0.5)), abs=0.01)
    assert set(weak.face_ids) <= set(whole.face_ids)


def test_detection_goes_by_albedo_incidence_and_range() -> None:
    """White, at right angles, at the reach: once in e pulses; a quarter of the albedo is as twice the range."""
    assert detection_probability(1.0, 1.0, 50.0, 50.0) == pytest.approx(np.exp(-1.0))
    assert detection_probability(0.25, 1.0, 10.0, 50.0) == pytest.approx(detection_probability(1.0, 1.0, 20.0, 50.0))
    steep = detection_probability(0.2, np.cos(np.radians([0.0, 40.0, 70.0, 89.9])), 30.0, 140.0)
    assert (np.diff(steep) < 0.0).all()
    # as Oren and Nayar 1994 have it, seen from where the light comes: A cos + B sin tan cos, of which A is 1 here
    a, b = 1 - 0.5 * 0.25 / (0.25 + 0.33), 0.45 * 0.25 / (0.25 + 0.09)
    angle = np.radians(70.0)
    back = np.cos(angle) * (a + b * np.sin(angle) * np.tan(angle)) / a
    assert steep[2] == pytest.approx(np.exp(-((30.0 / 140.0) ** 2) / (0.2 * back)))
    assert detection_probability(0.0, 1.0, 30.0, 140.0) == 0.0


@pytest.mark.parametrize("albedo", [0.05, 0.5, 1.0])
def test_a_scan_loses_what_is_not_detected(albedo: float) -> None:
    sensor = make("pinhole:width=200,height=200,fov=2", axial=False, detection_range=40.0)
    scene = Scene.joined([Placed(wall(20.0, 20.0), "wall", albedo=albedo)])
    scan = zo.scan(scene, sensor, method="oracle")
    assert len(scan) / 40_000 == pytest.approx(np.exp(-0.25 / albedo), abs=0.01)
    assert np.allclose(scan.intensities * scan.ranges**2, albedo, rtol=1e-3)
    assert len(zo.scan(scene, sensor.with_numbers(noise=0), method="oracle")) == 40_000
    assert len(zo.scan(scene, sensor.with_numbers(detection_range=0.0), method="oracle")) == 40_000


def test_limits_of_range() -> None:
    assert len(flat(5.0, range_max=4.9)[0]) == 0
    assert len(flat(5.0, range_min=5.1)[0]) == 0
    assert len(flat(5.0, range_min=4.9, range_max=5.1)[0]) == 40_000
    assert len(flat(5.0, range_max=4.9, noise=0)[0]) == 0  # no imperfection, but a limit


def plate_before_a_wall(**numbers: Any) -> np.ndarray:
    """Ranges along x of a small plate at 10 and a wall at 10.8 m, seen by a fine camera with wide beams."""
    mesh = stacked(ACROSS * 0.3 + [10.0, 0, 0], ACROSS * 9 + [10.8, 0, 0])
    sensor = make("pinhole:width=120,height=120,fov=6", axial=False, **numbers)
    return np.asarray(zo.scan(mesh, sensor, method="oracle").positions[:, 0])


def test_divergence_gives_points_between_a_plate_and_a_wall() -> None:
    def between(x: np.ndarray) -> float:
        return float(((x > 10.05) & (x < 10.75)).mean())

    assert between(plate_before_a_wall(divergence=0.003)) > 0.005
    assert between(plate_before_a_wall(divergence=0.0)) == 0.0
    assert between(plate_before_a_wall(divergence=0.003, noise=0)) == 0.0
    apart = plate_before_a_wall(divergence=0.003, echo_separation=0.5)  # two returns, told apart
    assert between(apart) == 0.0


def test_first_strongest_last() -> None:
    mesh = stacked(ACROSS * 0.3 + [10.0, 0, 0], ACROSS * 20 + [15.0, 0, 0])
    sensor = make("pinhole:width=120,height=120,fov=6", axial=False, divergence=0.003)
    counts = {}
    for returns in ("first", "strongest", "last"):
        scan = zo.scan(mesh, sensor.with_numbers(returns=returns), method="oracle")
        counts[returns] = int((scan.positions[:, 0] < 12).sum())
        assert len(scan) == 120 * 120
        assert set(scan.n_returns.tolist()) == {1, 2}
    assert counts["first"] > counts["strongest"] > counts["last"]


def test_all_returns_are_what_the_beams_split_into() -> None:
    """Two plates before a wall: each beam's five rays are told apart by where they cross the plates' planes."""
    places = {10.0: ([0.0, 0.3], [-0.2, 0.2]), 12.0: ([0.1, 0.4], [-0.3, 0.3])}  # y and z of the plates' corners
    corners = ((0, 0), (1, 0), (1, 1), (0, 1))
    plates = [np.array([[x, y[i], z[j]] for i, j in corners]) for x, (y, z) in places.items()]
    mesh = stacked(*plates, ACROSS * 20 + [15.0, 0, 0])
    beam = 0.01
    sensor = make("pinhole:width=60,height=60,fov=6", axial=False, divergence=beam, returns="all")
    scan = zo.scan(mesh, sensor, method="exact")
    axis = sensor.rays().directions
    least = np.eye(3)[np.abs(axis).argmin(axis=1)]
    across = np.cross(axis, least)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    upwards = np.cross(axis, across)
    offsets = [(0, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)]
    rays = np.stack([axis + 0.25 * beam * (x * across + y * upwards) for x, y in offsets], axis=1)
    inside = []
    for x, sides in places.items():
        at, (low, high) = rays[..., 1:] / rays[..., :1] * x, np.transpose(sides)
        inside.append(((at > low) & (at < high)).all(axis=-1))
    surface = np.where(inside[0], 0, np.where(inside[1], 1, 2))
    shares = np.stack([(surface == each).mean(axis=1) for each in range(3)], axis=1)
    counted, pixels = (shares > 0).sum(axis=1), scan.rings * 60 + scan.columns
    assert set(counted.tolist()) == {1, 2, 3}
    assert len(scan) == counted.sum()
    assert np.array_equal(scan.n_returns, counted[pixels])
    assert np.array_equal(scan.shares, shares[shares > 0])
    assert (np.diff(scan.ranges)[np.diff(pixels) == 0] > 1.0).all()
    first, last = (zo.scan(mesh, sensor.with_numbers(returns=each)) for each in ("first", "last"))
    assert np.array_equal(first.ranges, scan.ranges[scan.return_numbers == 1])
    assert np.array_equal(last.ranges, scan.ranges[scan.return_numbers == scan.n_returns])


def test_lost_pixels_at_edges() -> None:
    mesh = stacked(ACROSS * 0.3 + [10.0, 0, 0], ACROSS * 9 + [15.0, 0, 0])
    sensor = make("pinhole:width=60,height=60,fov=6")
    whole = zo.scan(mesh, sensor, method="oracle")
    without = zo.scan(mesh, sensor.with_numbers(edge_loss=1.0), method="oracle")
    assert len(whole) == 3600
    lost = {(r, c) for r, c in zip(whole.rings, whole.columns, strict=True)}
    lost -= {(r, c) for r, c in zip(without.rings, without.columns, strict=True)}
    border = {(r, c) for r, c in lost if r in (0, 59) or c in (0, 59)}
    plate = int((whole.positions[:, 0] < 12).sum())
    assert len(border) == 4 * 60 - 4  # nothing returns outside the picture
    assert 7 * np.sqrt(plate) < len(lost - border) < 9 * np.sqrt(plate)  # one row on either side of the plate's edge


def test_lateral_noise_is_in_pixels() -> None:
    sensor = make("pinhole:width=100,height=100,fov=10", lateral=0.8)
    scan = zo.scan(wall(5.0, 5.0), sensor, method="oracle")
    clean = zo.scan(wall(5.0, 5.0), sensor.with_numbers(noise=0), method="oracle")
    pixel = 1.0 / sensor.pixels
    shift = scan.directions / scan.directions[:, :1] - clean.directions / clean.directions[:, :1]
    assert np.std(shift[:, 1:], axis=0) == pytest.approx([0.8 * pixel] * 2, rel=0.03)


def test_the_fields_of_a_scan() -> None:
    """A tilted plate on the axis: range, incidence, intensity, normal in closed form."""
    tilt = np.radians(30.0)
    turn = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    plate = stacked(ACROSS @ turn.T)
    scene = Scene.joined(
        [Placed(plate, "plate", moved(to=(8.0, 0, 0)), albedo=0.5), Placed(box(), "crate", moved(to=(0, 5.0, 0)))]
    )
    scan = zo.scan(scene, make("vlp-16", noise=0), method="oracle")
    mine = scan.instances == 0
    assert {scene.labels[i] for i in set(scan.instances.tolist())} == {"plate", "crate"}
    normal = turn @ [-1.0, 0, 0]
    assert np.allclose(scan.normals[mine], normal)
    cosine = -scan.directions[mine] @ normal
    assert np.allclose(np.cos(scan.incidences[mine]), cosine)
    assert np.allclose(scan.intensities[mine], 0.5 * cosine / scan.ranges[mine] ** 2)
    assert np.allclose((scan.positions[mine] - [8, 0, 0]) @ normal, 0, atol=1e-9)
    assert (scan.n_returns == 1).all()
    assert np.allclose(scan.ranges, scan.clean_ranges)


def test_a_pose_moves_sensor_not_scene() -> None:
    sensor = make("pinhole:width=40,height=30,fov=60")
    pose = look_at([3.0, 4.0, 2.0], [0, 0, 0])
    scan = zo.scan(box(), sensor, pose, method="oracle")
    assert len(scan) > 50
    outside = np.abs(scan.positions).max(axis=1)
    assert np.allclose(outside, 0.5, atol=1e-9)  # on the box
    assert np.allclose(np.linalg.norm(scan.positions - [3, 4, 2], axis=1), scan.ranges)
    assert np.allclose(pose[:3, 0], -np.array([3, 4, 2]) / np.sqrt(29))
    assert pose[2, 2] > 0.9  # z stays up


@pytest.mark.parametrize("numbers", [{"noise": 0}, {"sigma": 0.0, "detection_range": 0.0}], ids=["rays", "beams"])
def test_towards_a_box_changes_nothing_within_it(numbers: dict[str, Any]) -> None:
    car = shapes.make("car", 1).normalized().transformed(4.5, (12.0, 3.0, 0.0))
    sensor, pose = make("vlp-32c", **numbers), look_at([0.0, -1.0, 2.0], [9.0, 9.0, 0.0])
    with zo.prepare(car, "embree") as alone:
        whole = zo.scan(car, sensor, pose, occluder=alone)
        part = zo.scan(car, sensor, pose, occluder=alone, towards=car.bounds)
        met = zo.scan(car, sensor, pose, occluder=alone, target=alone)
    assert len(whole) > 100
    for other in (part, met):
        assert (whole.rings == other.rings).all()
        assert (whole.columns == other.columns).all()
        assert np.allclose(whole.positions, other.positions, rtol=0.0, atol=1e-9)


def test_of_a_target_all_returns_are_there() -> None:
    """Of a car behind a post and before a wall: beams that would meet the car alone, and no others."""
    car = shapes.make("car", 1).normalized().transformed(4.5, (12.0, 0.0, 0.0))
    post, wall = box().transformed(0.4, (5.0, 0.1, 0.0)), box().transformed(30.0, (31.0, 0.0, 0.0))
    scene = Scene.joined([Placed(mesh, name) for mesh, name in ((car, "car"), (post, "post"), (wall, "wall"))])
    sensor = make("vlp-32c", sigma=0.0, detection_range=0.0)
    with zo.prepare(car, "embree") as alone, zo.prepare(scene.mesh, "embree") as all_of_it:
        whole = zo.scan(scene, sensor, occluder=all_of_it)
        part = zo.scan(scene, sensor, occluder=all_of_it, towards=car.bounds, target=alone)
    mine, of_part = whole.select(whole.instances == 0), part.select(part.instances == 0)
    assert len(mine) > 100
    assert np.allclose(mine.positions, of_part.positions, rtol=0.0, atol=1e-9)
    assert (mine.n_returns == of_part.n_returns).all()
    assert 0 < len(part) - len(of_part) < len(whole) / 10  # the post, and the wall in beams at the car's edge


def test_a_sensor_in_a_cameras_place() -> None:
    views = zo.views.random(20, distance=3.0, seed=1)
    for matrix, eye in zip(views.poses, views.eyes, strict=True):
        assert np.allclose(pose_of_camera(matrix), look_at(eye, [0, 0, 0]))
    rolled = zo.Views([0.3], [0.2], [3.0], roll=0.5)
    ahead, left, up = pose_of_camera(rolled.poses[0])[:3, :3].T
    assert np.allclose(np.cross(ahead, left), up)
    assert np.allclose(up, rolled.ups[0])


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: zo.scan(wall(3.0), make("vlp-16"), np.diag([2.0, 2, 2, 1])), zo.ArgumentError, "rigid motion"),
        (lambda: zo.scan(wall(3.0), make("vlp-16"), np.eye(3)), zo.ArgumentError, r"\(4, 4\); got \(3, 3\)"),
        (lambda: zo.scan(wall(3.0), make("vlp-16"), "a"), zo.ArgumentError, r"\(4, 4\); got \(\) <U1"),
        (lambda: zo.scan(wall(3.0), make("vlp-16"), method="vertex_hsr"), zo.OptionError, "cast rays; vertex_hsr"),
        (lambda: zo.scan(wall(3.0), make("vlp-16"), seed=-1), zo.OptionError, "seed"),
        (lambda: zo.scan(wall(3.0), 3), zo.ArgumentError, "sensor must be .*; got int"),
        (lambda: zo.scan(3, "vlp-16"), zo.ArgumentError, "scene must be .*; got int"),
        (lambda: make(3), zo.ArgumentError, "a name or a file; got int"),
        (lambda: look_at([1, 1, 1], [1, 1, 1]), zo.ArgumentError, "coincides with its target"),
        (lambda: look_at([0, 0, 0], [0, 1, 0], up=[0, 2, 0]), zo.ArgumentError, "up must not"),
    ],
)
def test_bad_arguments(call: Callable[[], object], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        call()


def test_the_seed_alone_decides_and_detection_has_ends() -> None:
    scans = [zo.scan(box(), make("vlp-16"), look_at([3, 0, 0], [0, 0, 0]), method="oracle", seed=s) for s in (5, 5, 6)]
    assert scans[0].positions.tobytes() == scans[1].positions.tobytes() != scans[2].positions.tobytes()
    with np.errstate(all="raise", under="ignore"):
        ends = detection_probability([0.2, 0.2, 0.0, 1e-320], [1.0, 0.0, 1.0, 1.0], [1e-300, np.inf, 1.0, 500.0], 130.0)
    assert ends.tolist() == [1.0, 0.0, 0.0, 0.0]  # no path no loss; what is black or far is never detected


def test_paint_is_the_albedo() -> None:
    """A wall, black on the left, white in the middle, mid grey (sRGB 188, half the light) on the right."""
    plain = stacked(*(ACROSS * [1.0, 0.5, 1.0] + [5.0, 1.0 - k, 0.0] for k in range(3)))
    paints = tuple(Material((tint / 255,) * 3) for tint in (0, 255, 188))
    painted = replace(plain, colors=SurfaceColors(paints, np.arange(6, dtype=np.int32) // 2))
    scan, unpainted = (zo.scan(mesh, "pinhole:width=90,height=30,fov=30,noise=0") for mesh in (painted, plain))
    part = np.clip(np.floor(1.5 - scan.points[:, 1]), 0, 2).astype(int)
    albedos = scan.intensities * scan.ranges**2 / np.cos(scan.incidences)
    assert albedos == pytest.approx(np.array([0.0, 1.0, 0.503])[part], abs=0.002)
    assert unpainted.intensities * unpainted.ranges**2 / np.cos(unpainted.incidences) == pytest.approx(TYPICAL_ALBEDO)
