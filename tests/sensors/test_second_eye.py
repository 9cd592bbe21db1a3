"""Sensors of two eyes, and a line scanner: closed forms, and the oracle's answers about random scenes."""

from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.random_scenes import wrong_returns_of
from tests.scenes import ACROSS, sphere, stacked
from zbuf_occlude.sensors import Rays, Scan, look_at, make

BASELINE = 0.3


def camera(**numbers: Any) -> zo.sensors.Sensor:
    return make("pinhole:width=160,height=120,fov=60", noise=0, **numbers)


def wall_behind_a_plate() -> zo.Mesh:
    return stacked(ACROSS * 4.0 + [4.0, 0, 0], ACROSS * 0.25 + [2.0, 0, 0])


def places(scan: Scan) -> set[tuple[int, int]]:
    return set(zip(scan.rings.tolist(), scan.columns.tolist(), strict=True))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_shadow_of_a_second_eye_is_where_similar_triangles_have_it(side: float) -> None:
    baseline = np.array([0.0, side * BASELINE, 0.0])
    mesh = wall_behind_a_plate()
    one, two = zo.scan(mesh, camera()), zo.scan(mesh, camera(baseline=baseline.tolist()))
    on_wall = np.abs(one.points[:, 0] - 4.0) < 1e-9
    crossing = baseline + (one.points - baseline) / 2.0  # halfway to the wall is where the plate is
    shadow = on_wall & (np.abs(crossing[:, 1:]) < 0.25).all(axis=1)
    seen = one.points - baseline
    column = 80.0 - seen[:, 1] / seen[:, 0] * 80.0 / np.tan(np.radians(30.0))
    in_picture = (column >= 0) & (column < 160)
    assert shadow.sum() > 100
    assert (~in_picture).sum() > 100
    assert places(two) == places(one.select(~shadow & in_picture))
    assert np.array_equal(two.ranges, one.select(~shadow & in_picture).ranges)


def test_of_several_second_eyes_one_is_enough() -> None:
    mesh = wall_behind_a_plate()
    left, right = [0.0, BASELINE, 0.0], [0.0, -BASELINE, 0.0]
    found = [places(zo.scan(mesh, camera(baseline=baseline))) for baseline in (left, right, [left, right])]
    assert found[2] == found[0] | found[1]
    assert found[2] > found[0]


def test_both_eyes_are_on_one_side_of_a_sheet() -> None:
    sheet = stacked(ACROSS + np.array([2.0, 0, 0]))
    assert len(zo.scan(sheet, camera(baseline=[1.5, 0.0, 0.1]))) > 1000
    assert len(zo.scan(sheet, make("vlp-16", noise=0, baseline=[3.5, 0.0, 0.1]))) == 0


def test_steep_light_of_the_second_eye_returns_nothing() -> None:
    mesh = stacked(ACROSS * 4.0 + [4.0, 0, 0])
    scan = zo.scan(mesh, make("vlp-16", noise=0, baseline=[0.0, 1.0, 0.0]))
    numbers = {"noise": 1, "sigma": 0, "divergence": 0, "detection_range": 0, "step": 0, "baseline": [0.0, 1.0, 0.0]}
    limited = zo.scan(mesh, make("vlp-16", **numbers, baseline_incidence_max=40.0))
    away = scan.points - [0.0, 1.0, 0.0]
    steep = np.degrees(np.arccos(away[:, 0] / np.linalg.norm(away, axis=1))) > 40.0
    assert 0 < steep.sum() < len(scan)
    assert places(limited) == places(scan.select(~steep))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_stereo_loses_its_shadow_and_half_a_window_about_what_is_nearer(side: float) -> None:
    """A strip 2 m before a wall 4 m away: f B (1/2 - 1/4) pixels of shadow at one side, 4 more at both."""
    mesh = stacked(ACROSS * 8.0 + [4.0, 0, 0], ACROSS * [1, 0.25, 8] + [2.0, 0, 0])
    numbers = {"baseline": [0.0, side * BASELINE, 0.0], "match_window": 9}
    sensor = make("pinhole:width=160,height=120,fov=60", **numbers)
    found, exact = zo.scan(mesh, sensor), zo.scan(mesh, sensor.with_numbers(noise=0))
    assert places(exact) == places(zo.scan(mesh, sensor.with_numbers(match_window=0)))
    focal = 80.0 / np.tan(np.radians(30.0))
    for row in range(5, 115):
        columns, whole = (np.sort(each.columns[each.rings == row]) for each in (found, exact))
        strip = exact.columns[(exact.rings == row) & (exact.points[:, 0] < 3.0)]
        gaps = strip.min() - columns[columns < strip.min()].max(), columns[columns > strip.max()].min() - strip.max()
        shadow = gaps[1] - 5 if side > 0 else gaps[0] - 5
        assert abs(shadow - focal * BASELINE / 4.0) <= 1.0
        assert (gaps[0] if side > 0 else gaps[1]) == 5
        assert set(strip) < set(columns) < set(whole)


def test_without_a_baseline_scans_are_first_hits() -> None:
    mesh, sensor = wall_behind_a_plate(), make("kinect-v1", noise=0, baseline=0, width=80, height=60, f=72.0)
    scan = zo.scan(mesh, sensor, method="exact")
    with zo.prepare(mesh, "oracle") as oracle:
        hits = oracle.first_hits([[0, 0, 0]], sensor.rays().directions)
    depths = hits.distances * sensor.rays().directions[:, 0]
    returned = np.flatnonzero((hits.face_ids >= 0) & (depths >= 0.8) & (depths <= 4.0))
    assert np.array_equal(scan.rings * 80 + scan.columns, returned)
    assert scan.ranges == pytest.approx(hits.distances[returned], rel=1e-12)


def test_random_scenes_of_two_eyes_are_the_oracles() -> None:
    found = np.array([wrong_returns_of("exact", 33, index) for index in range(120)])
    assert found[:, 0].sum() == 0
    assert found[:, 1].sum() > 2_000


def test_a_line_scanner_sees_each_column_from_beside_it() -> None:
    sensor = make("cyberware-3030", noise=0, baseline=0, columns=21, spacing=0.01, rows=11, slopes=[-0.1, 0.1])
    rays = sensor.rays()
    assert isinstance(rays, Rays)
    assert rays.origins is not None
    scan = zo.scan(stacked(ACROSS + np.array([1.25, 0, 0])), sensor, look_at([0, 0, 0], [1, 0, 0]))
    assert len(scan) == 231
    assert np.unique(scan.points[:, 1].round(9)) == pytest.approx(np.arange(-10, 11) * 0.01)
    assert np.unique(scan.points[:, 2].round(9)) == pytest.approx(1.25 * np.linspace(-0.1, 0.1, 11))
    assert scan.points == pytest.approx(scan.starts + scan.ranges[:, None] * scan.directions)
    assert scan.offsets[:, 1] == pytest.approx(scan.points[:, 1])
    turned = zo.scan(stacked(ACROSS + np.array([1.25, 0, 0])), sensor, look_at([0, 0, 0], [1, 0, 0], up=[0, 1, 0]))
    assert np.unique(turned.points[:, 2].round(9)) == pytest.approx(np.arange(-10, 11) * 0.01)


def test_a_sphere_by_a_line_scanner_is_lit_as_circles_are() -> None:
    """From an eye in its plane at distance d a circle of radius r is seen up to the tangent."""
    ball = sphere(64)
    radius = float(np.ptp(ball.vertices[:, 0]) / 2)
    sensor = make("cyberware-3030", noise=0, baseline=0, columns=41, spacing=radius / 25, rows=4001, slopes=[-1, 1])
    scan = zo.scan(ball, sensor, look_at(ball.centre - [3 * radius, 0, 0], ball.centre))
    across = np.abs(scan.points[:, 1] - ball.centre[1])
    highest = np.array([scan.points[scan.columns == c, 2].max() - ball.centre[2] for c in range(41)])
    offset = np.abs((20 - np.arange(41)) * radius / 25)
    circle = np.sqrt(radius**2 - offset**2)
    assert across.max() == pytest.approx(0.8 * radius, rel=1e-6)
    assert highest == pytest.approx(circle * np.sqrt(1 - (circle / (3 * radius)) ** 2), rel=0.02)
