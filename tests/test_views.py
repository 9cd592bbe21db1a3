"""Views: the paper's positions computed by hand, the other sets' properties, every spec and every error."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zbuf_occlude import ArgumentError, OptionError, Views, views


def spherical(azimuth: float, elevation: float, distance: float) -> list[float]:
    """A position from degrees, written out."""
    a, e = np.radians(azimuth), np.radians(elevation)
    return [distance * np.cos(e) * np.cos(a), distance * np.cos(e) * np.sin(a), distance * np.sin(e)]


def test_paper100_is_equations_11_and_12() -> None:
    expected = [
        spherical((j - 1) * 360.0 / n, (i - 1) * 10 - 90, 4.0)
        for i, n in zip(range(1, 20), [*range(1, 11), *range(9, 0, -1)], strict=True)
        for j in range(1, n + 1)
    ]
    made = views.paper100()
    assert len(made) == 100
    assert np.allclose(made.eyes, expected, atol=1e-12)
    elevations, counts = np.unique(np.degrees(made.elevation).round(6), return_counts=True)
    assert elevations.tolist() == list(range(-90, 91, 10))
    assert counts.tolist() == [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1]


def test_the_poles_are_exactly_on_the_axis() -> None:
    eyes = views.paper100(distance=3.0).eyes
    assert eyes[0].tolist() == [0.0, 0.0, -3.0]
    assert eyes[-1].tolist() == [0.0, 0.0, 3.0]


def test_modelnet8_is_section_4_3() -> None:
    expected = [spherical(a, e, 4.0) for e in (-80, -40, 0, 40, 80) for a in (0, 72, 144, 216, 288)]
    assert np.allclose(views.modelnet8().eyes, expected, atol=1e-12)


def test_angles_by_hand() -> None:
    made = Views(
        np.radians([0.0, 90.0, 0.0]), np.radians([0.0, 0.0, 90.0]), np.array([1.0, 2.0, 3.0]), (10.0, 0.0, 0.0)
    )
    assert np.allclose(made.eyes, [[11, 0, 0], [10, 2, 0], [10, 0, 3]], atol=1e-12)
    assert np.allclose(made.ups, [[0, 0, 1], [0, 0, 1], [-1, 0, 0]], atol=1e-12)


def test_around_turns_longest_sides_into_world_units() -> None:
    moved = views.ring(4, elevation=0, distance=2.0).around((1.0, 2.0, 3.0), 10.0)
    assert np.allclose(moved.eyes[0], [21, 2, 3])
    assert np.allclose(np.linalg.norm(moved.eyes - [1, 2, 3], axis=1), 20.0)


def test_fibonacci_is_spread_evenly() -> None:
    eyes = views.fibonacci(500, distance=1.0).eyes
    assert np.allclose(np.linalg.norm(eyes, axis=1), 1.0)
    assert np.linalg.norm(eyes.mean(axis=0)) < 0.01
    apart = np.arccos(np.clip(eyes @ eyes.T - 2 * np.eye(500), -1, 1)).min(axis=1)
    ideal = np.sqrt(4 * np.pi / 500)  # the side of a square cell of one point's share
    assert apart.min() > 0.7 * ideal
    assert apart.max() < 1.3 * ideal


def test_random_is_uniform_on_its_band_and_of_its_seed() -> None:
    made = views.random(20_000, elevation=(0, 30), seed=1)
    assert made.elevation.min() >= 0
    assert made.elevation.max() <= np.radians(30.0)
    # uniform on the sphere is uniform in sin(elevation): mean 1/4, standard deviation 0.5 / sqrt(12)
    assert abs(np.sin(made.elevation).mean() - 0.25) < 4 * 0.5 / np.sqrt(12 * 20_000)
    assert np.array_equal(made.eyes, views.random(20_000, elevation=(0, 30), seed=1).eyes)
    assert not np.array_equal(made.eyes, views.random(20_000, elevation=(0, 30), seed=2).eyes)


@pytest.mark.parametrize(
    ("spec", "expected"),
    [
        ("paper100", views.paper100(2.5)),
        ("modelnet8", views.modelnet8(2.5)),
        ("ring:12@20", views.ring(12, elevation=20, distance=2.5)),
        ("ring:1@-7.5", views.ring(1, elevation=-7.5, distance=2.5)),
        ("grid:3x4", views.grid(3, 4, distance=2.5)),
        ("grid:2x3@0..50", views.grid(2, 3, elevation=(0, 50), distance=2.5)),
        ("grid:2x3@-10..-5", views.grid(2, 3, elevation=(-10, -5), distance=2.5)),
        ("fibonacci:10", views.fibonacci(10, 2.5)),
        ("random:7", views.random(7, distance=2.5, seed=9)),
        ("random:7@0..50", views.random(7, elevation=(0, 50), distance=2.5, seed=9)),
        ("ring:5@20,az=-30..30", views.ring(5, elevation=20, azimuth=(-30, 30), distance=2.5)),
        ("ring:5@0..15", views.ring(5, elevation=(0, 15), distance=2.5, seed=9)),
        ("ring:5@0..15,az=-30..30", views.ring(5, elevation=(0, 15), azimuth=(-30, 30), distance=2.5, seed=9)),
        ("grid:2x3,az=0..90", views.grid(2, 3, azimuth=(0, 90), distance=2.5)),
        ("grid:2x3@0..50,az=0..90", views.grid(2, 3, elevation=(0, 50), azimuth=(0, 90), distance=2.5)),
        ("random:7,az=10..20", views.random(7, azimuth=(10, 20), distance=2.5, seed=9)),
        ("random:7@0..50,az=10..20", views.random(7, elevation=(0, 50), azimuth=(10, 20), distance=2.5, seed=9)),
        ("drive:7", views.drive(7, distance=2.5, seed=9)),
        ("drive:7@0..9", views.drive(7, elevation=(0, 9), distance=2.5, seed=9)),
    ],
)
def test_specs(spec: str, expected: Views) -> None:
    made = views.parse(spec, distance=2.5, seed=9)
    assert np.array_equal(made.eyes, expected.eyes)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("paper", f"views must be {views.forms()}; got 'paper'."),
        ("ring:12", "got 'ring:12'."),
        ("ring:x@20", "got 'ring:x@20'."),
        ("grid:3", "got 'grid:3'."),
        ("", "got ''."),
        ("ring:0@20", "n_azimuths must be a positive int; got 0."),
        ("grid:0x4", "n_elevations must be a positive int; got 0."),
        ("fibonacci:0", "n_views must be a positive int; got 0."),
        ("random:0", "n_views must be a positive int; got 0."),
        ("ring:1000000000@3", "n_azimuths must be at most 1,000,000; got 1000000000."),
        (f"grid:{10**17}x3", f"n_elevations must be at most 1,000,000; got {10**17}."),
        ("ring:8@100", "elevations must run upwards within -90..90 degrees; got 100..100."),
        ("random:5@50..0", "elevations must run upwards within -90..90 degrees; got 50..0."),
        ("ring:8@0,az=30", "After ring: must come N@EL[,az=AZ0..AZ1] or N@EL0..EL1[,az=AZ0..AZ1]; got '8@0,az=30'."),
        ("ring:8@0,az=30..-30", "azimuths must run upwards by at most 360 degrees, within -360..360; got 30..-30."),
        ("random:8,az=-20..341", "got -20..341."),
        ("drive:0", "n_views must be a positive int; got 0."),
        ("drive:8@20", "After drive: must come N[@EL0..EL1]; got '8@20'."),
        ("grid:2x3@0..91", "elevations must run upwards within -90..90 degrees; got 0..91."),
        ("no/such/file.csv", "a file must be readable; no/such/file.csv: "),
    ],
)
def test_bad_specs(spec: str, message: str) -> None:
    with pytest.raises(OptionError, match=re.escape(message)):
        views.parse(spec)


def test_bands_of_azimuth() -> None:
    assert np.allclose(np.degrees(views.parse("ring:5@20,az=-30..30").azimuth), [-30, -15, 0, 15, 30])
    assert np.allclose(np.degrees(views.parse("ring:1@20,az=10..30").azimuth), [20])
    assert np.allclose(np.degrees(views.parse("ring:4@20,az=-180..180").azimuth), [-180, -90, 0, 90])
    drawn = views.parse("random:20000@0..0,az=-10..20", seed=2).azimuth
    assert (np.degrees([-drawn.min(), drawn.max()]) > [9.9, 19.9]).all()
    assert (np.degrees([-drawn.min(), drawn.max()]) <= [10, 20]).all()
    assert abs(np.degrees(drawn).mean() - 5) < 4 * 30 / np.sqrt(12 * 20_000)
    spread = views.parse("ring:20000@0..30", seed=1)
    assert abs(np.sin(spread.elevation).mean() - 0.25) < 4 * 0.5 / np.sqrt(12 * 20_000)
    assert np.array_equal(spread.azimuth, views.ring(20_000, elevation=0).azimuth)
    assert views.is_random("ring:8@0..15,az=-30..30")
    assert not views.is_random("ring:8@0,az=-30..30")


def smirnov(drawn: np.ndarray, law: Any) -> float:
    """Kolmogorov's and Smirnov's distance times the root of the number: above 2.23 in one of 10,000 samples."""
    drawn, n = np.sort(drawn), len(drawn)
    expected = law(drawn)
    return float(max((np.arange(1, n + 1) / n - expected).max(), (expected - np.arange(n) / n).max()) * np.sqrt(n))


@pytest.mark.parametrize("half_within", [15.0, 40.0])
def test_drive_is_its_law(half_within: float) -> None:
    """F(d) = 2 / pi atan(tan(d) / tan(half_within)) of the angle d to the y axis; sides and ends equally likely."""
    made = views.drive(20_000, half_within=half_within, elevation=(0, 12), seed=4)
    x, y = made.eyes[:, 0], made.eyes[:, 1]
    angles = np.degrees(np.arctan2(np.abs(x), np.abs(y)))
    narrow = np.tan(np.radians(half_within))
    assert smirnov(angles, lambda d: 2 / np.pi * np.arctan(np.tan(np.radians(d)) / narrow)) < 2.23
    assert abs((angles < half_within).mean() - 0.5) < 4 * 0.5 / np.sqrt(20_000)
    for half in (x > 0, y > 0, (x > 0) == (y > 0)):
        assert abs(half.mean() - 0.5) < 4 * 0.5 / np.sqrt(20_000)
    assert smirnov(np.sin(made.elevation) / np.sin(np.radians(12)), lambda s: s) < 2.23
    assert views.is_random("drive:3")
    assert not views.parse("drive:3").elevation.any()
    with pytest.raises(ArgumentError, match=r"half_within must be degrees in \(0, 90\)"):
        views.drive(3, half_within=90.0)


def test_csv(tmp_path: Path) -> None:
    file = tmp_path / "views.csv"
    file.write_text("\ufeffname, azimuth, elevation, distance\na, 90, 0, 2\nb, 0, -90,\n", encoding="utf-8")
    made = views.parse(str(file))
    assert np.allclose(made.eyes, [[0, 2, 0], [0, 0, -4]], atol=1e-12)  # no distance: the paper's 4
    file.write_text("elevation,azimuth\n0,180\n")
    assert np.allclose(views.from_csv(file).eyes, [[-4, 0, 0]], atol=1e-12)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "must have a row of names and 1 to 1,000,000 below it"),
        (b"azimuth,elevation\n", "must have a row of names and 1 to"),
        (b"az,el\n1,2\n", "columns azimuth,elevation[,distance]; found: az, el."),
        (b"azimuth,elevation\n1,east\n", "degrees; got 'east'."),
        (b"azimuth,elevation\n1\n", "degrees; got ''."),
        (b"azimuth,elevation\n1,9\n1,-91\n", "from -90 to 90 degrees; got -91.0."),
        (b"azimuth,elevation\nnan,5\n", "degrees; got nan."),
        (b"azimuth,elevation,distance\n1,5,-2\n", "longest sides; got -2.0."),
        (b"azimuth,elevation\n\xff\xfe,1\n", "must be CSV"),
    ],
)
def test_bad_csv(tmp_path: Path, content: bytes, words: str) -> None:
    file = tmp_path / "views.csv"
    file.write_bytes(content)
    with pytest.raises(OptionError, match=re.escape(words)) as caught:
        views.from_csv(file)
    assert str(file) in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([0, 1], [0, 0, 0], 4.0), "one length; got 2, 3 and 1."),
        (([[0.0]], [0.0], 4.0), "got (1, 1) and (3,)."),
        (([0.0], [0.0], 4.0, (0, 0)), "got (1,) and (2,)."),
        (([0.0], [np.nan], 4.0), "elevation must be finite and below 1e+70; got nan."),
        (([0.0], [45.0], 4.0), "got 2578.31 degrees. Give radians."),
        (([0.0], [0.0], 0.0), "distance must be positive; got 0."),
        ((["east"], [0.0], 4.0), "must be numbers"),
    ],
)
def test_bad_views(arguments: Any, words: str) -> None:
    with pytest.raises(ArgumentError, match=re.escape(words)):
        Views(*arguments)


def test_views_cannot_be_changed() -> None:
    made = views.paper100()
    assert len(made) == 100
    assert repr(made) == "Views(100 views about (0, 0, 0))"
    with pytest.raises(ValueError, match="read-only"):
        made.azimuth[0] = 1.0


def test_roll_turns_the_top_to_the_right() -> None:
    made = Views(np.radians([0.0]), np.radians([0.0]), np.array([2.0]), roll=np.radians([90.0]))
    # from +x the camera's right is +y; what was up, +z, now points there
    assert np.allclose(made.ups, [[0, 1, 0]], atol=1e-12)
    plain, rolled = views.ring(1, elevation=np.degrees(0.3)).poses[0], Views([0.0], [0.3], 4.0, roll=np.pi / 3).poses[0]
    turn = rolled[:3, :3] @ plain[:3, :3].T
    assert np.allclose(turn[2], [0, 0, 1], atol=1e-12), "about the axis"
    assert np.isclose(np.trace(turn), 1 + 2 * np.cos(np.pi / 3))


def test_random_so3_is_uniform_over_rotations() -> None:
    made = views.random_so3(20_000, seed=3)
    rotations = made.poses[:, :3, :3]
    # the mean of a uniform rotation is 0, and its angle t has the density (1 - cos t) / pi: mean pi / 2 + 2 / pi
    assert np.abs(rotations.mean(axis=0)).max() < 4 * np.sqrt(1 / 3 / 20_000)
    angles = np.arccos(np.clip((np.trace(rotations, axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert abs(angles.mean() - (np.pi / 2 + 2 / np.pi)) < 4 * 0.65 / np.sqrt(20_000)


def test_distances_are_drawn_between_two() -> None:
    made = views.parse("ring:5000@20", distance=2.0, farthest=4.0, seed=1)
    lengths = made.distance
    assert (lengths.min() >= 2.0, lengths.max() <= 4.0) == (True, True)
    assert abs(lengths.mean() - 3.0) < 0.05
    assert np.array_equal(made.azimuth, views.ring(5000, elevation=20).azimuth)
    with pytest.raises(OptionError, match=r"distances must run upwards; got 4\.\.2"):
        views.parse("ring:5@20", distance=4.0, farthest=2.0)


def test_a_generator_is_a_seed_and_is_drawn_from() -> None:
    rng = np.random.default_rng(3)
    first, second = (views.parse("random:9", distance=2.0, farthest=5.0, seed=rng) for _ in range(2))
    for found in (first, second):
        assert ((found.distance >= 2.0) & (found.distance <= 5.0)).all()
    assert not np.isin(first.distance, second.distance).any()
    again = views.parse("random:9", distance=2.0, farthest=5.0, seed=np.random.default_rng(3))
    assert np.array_equal(again.to_rows(), first.to_rows())


def test_a_look_at_point_and_a_field_of_view() -> None:
    made = views.ring(4, elevation=20, distance=3.0).looking([0.5, 0.0, 0.2], np.radians(60))
    point = np.array([[0.5, 0.0, 0.2]])
    for pose in made.poses:
        x, y, z = pose[:3, :3] @ point[0] + pose[:3, 3]
        assert np.allclose([x, y], 0, atol=1e-12)
        assert z < 0
    assert made.in_frustum(point).all()
    right = (
        made.eyes[0] - 2 * made.poses[0, 2, :3] + np.tan(np.radians([29.0, 31.0]))[:, None] * 2 * made.poses[0, 0, :3]
    )
    assert made.in_frustum(right)[0].tolist() == [True, False]
    assert not made.in_frustum(made.eyes + made.poses[:, 2, :3])[np.arange(4), np.arange(4)].any(), "behind the camera"


@pytest.mark.parametrize("columns", [3, 4, 13, 17])
def test_a_table_holds_all_that_is_known(columns: int) -> None:
    made = {
        3: views.ring(3, elevation=12),
        4: views.random_so3(3),
        13: views.ring(3, elevation=12).looking([0.1, 0, 0]),
        17: views.ring(3, elevation=12).looking([0.1, 0, 0], 0.5),
    }[columns]
    assert made.to_rows().shape == (3, columns)
    back = Views.from_rows(made.to_rows().tolist())
    assert np.allclose(back.poses, made.poses, atol=1e-15)
    assert (back.fov_bounds is None) == (columns < 17)
    with pytest.raises(ArgumentError, match="rows of views must have"):
        Views.from_rows(np.zeros((2, 5)))


@pytest.mark.parametrize("turn", [np.diag([1.0, 1.0, -1.0]), np.eye(3) * 2.0, np.zeros((3, 3))])
def test_what_is_no_rotation_is_refused(turn: np.ndarray) -> None:
    with pytest.raises(ArgumentError, match="rotations must be rotations"):
        Views.from_cameras(np.array([[3.0, 0.0, 0.0]]), turn[None])


def test_a_tables_own_distances_stay_where_others_are_drawn(tmp_path: Path) -> None:
    path = tmp_path / "views.csv"
    path.write_text("azimuth,elevation,distance\n0,0,2\n10,20,\n20,30,7\n")
    found = views.parse(str(path), distance=3.0, farthest=5.0).distance
    assert found[[0, 2]].tolist() == [2.0, 7.0]
    assert 3.0 < found[1] < 5.0


@pytest.mark.parametrize("index", [1, -2, np.int64(1), np.array(1)])
def test_an_index_gives_views_of_one(index: Any) -> None:
    three = views.ring(3, elevation=0.0)
    assert three[index].azimuth.tolist() == [three.azimuth[1]]
