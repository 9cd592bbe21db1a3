"""Where the rays go: closed forms of each kind, the table, a user's own files."""

import re
from pathlib import Path

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import DATA
from zbuf_occlude.sensors import SENSORS, NoiseModel, make
from zbuf_occlude.sensors.rays import PATTERNS, Rays

ASKED_FOR = (
    *("vlp-16", "hdl-32e", "vlp-32c", "hdl-64e", "os1-64", "vls-128", "mid-40", "kinect-v1", "azure-kinect-nfov"),
    *("realsense-d435", "pcn", "modelnet40-c", "pinhole", "mid-360", "avia", "xt32", "pandar128", "at128", "os0-128"),
    *("os1-128", "os2-128", "m1", "realsense-d455", "realsense-l515"),
)
LASERS = DATA / "lidar" / "lasers.tsv"


def angles(rays: Rays) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth and elevation in degrees."""
    x, y, z = rays.directions.T
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arcsin(z))


@pytest.mark.parametrize("name", SENSORS)
def test_every_sensor_of_the_table(name: str) -> None:
    sensor = make(name)
    rays = sensor.rays()
    assert np.allclose(np.linalg.norm(rays.directions, axis=1), 1.0)
    assert len(rays) == len(rays.rings) == len(rays.columns) > 1000
    assert len({(r, c) for r, c in zip(rays.rings.tolist(), rays.columns.tolist(), strict=True)}) == len(rays)
    for number in sensor.numbers():
        assert sensor.sources[number], f"{name}: {number} must have a source"
        assert "{" not in sensor.sources[number], f"{name}: {number} names a variable"


def test_the_sensors_asked_for_are_there() -> None:
    assert set(ASKED_FOR) <= set(SENSORS)
    assert {sensor.kind for sensor in SENSORS.values()} | {"list"} == set(PATTERNS)


@pytest.mark.skipif(not LASERS.exists(), reason=f"{LASERS} is not there; set ZBUF_OCCLUDE_DATA")
@pytest.mark.parametrize("name", ["vlp-16", "hdl-32e", "vlp-32c", "vls-128"])
def test_lasers_are_those_of_the_calibration_files(name: str) -> None:
    rows = [line.split("\t") for line in LASERS.read_text().splitlines()[1:]]
    expected = sorted((float(e), float(a)) for sensor, _, e, a in rows if sensor == name)
    assert np.allclose(make(name).pattern["lasers"], expected, atol=5e-4)


def test_a_spinning_sensor() -> None:
    rays = make("vlp-16", columns=360).rays()
    azimuth, elevation = angles(rays)
    assert len(rays) == 16 * 360
    assert np.allclose(np.unique(elevation.round(6)), np.arange(-15, 16, 2))
    assert np.allclose(elevation, -15 + 2 * rays.rings)
    assert np.allclose((azimuth - (rays.columns - 180.0) + 180) % 360, 180)


def test_lasers_beside_the_axis() -> None:
    """A laser 0.2 m up and 0.1 m left of the axis; of an HDL-64E one 0.21 m up, by range."""
    rays = make("vlp-16", lasers=[[10.0, 30.0]], offsets=[[0.2, 0.1]], columns=4).rays()
    assert np.allclose(rays.origins[:, 2], 0.2)
    assert np.allclose(np.linalg.norm(rays.origins[:, :2], axis=1), 0.1)
    left = np.cross([0.0, 0.0, 1.0], rays.directions) / np.cos(np.radians(10.0))
    assert np.allclose(rays.origins, 0.1 * left + [0.0, 0.0, 0.2])
    sensor = make("hdl-64e")
    uppermost = sensor.rays().select(sensor.rays().rings == 63)
    for distance, seen in ((5.0, 4.3), (10.0, 3.1), (100.0, 2.1)):
        x, y, z = (uppermost.origins + distance * uppermost.directions).T
        assert np.allclose(np.degrees(np.arctan2(z, np.hypot(x, y))), seen, atol=0.05)


def test_a_scan_of_lasers_beside_the_axis_is_their_first_hits() -> None:
    """Whatever is left out because it can meet no ray, and wherever a place is said to be seen from."""
    rng = np.random.default_rng(5)
    soup = zo.Mesh(rng.uniform([6, -1, -3], [12, 5, 3], (300, 3)), np.arange(300).reshape(-1, 3))
    sensor, pose = make("hdl-64e", noise=0, columns=300), zo.sensors.look_at([1, 0, 0.5], [9, 4, 1])
    rays, found = sensor.rays(), zo.scan(soup, sensor, pose, towards=soup.bounds)
    starts, directions = pose[:3, 3] + rays.origins @ pose[:3, :3].T, rays.directions @ pose[:3, :3].T
    with zo.prepare(soup, "oracle") as oracle:
        hits = oracle.first_hits(starts, directions)
    met = (hits.face_ids >= 0) & (hits.distances >= 0.9)
    assert met.sum() == len(found) > 500
    assert (found.face_ids == hits.face_ids[met]).all()
    assert np.allclose(found.positions, (starts + hits.distances[:, None] * directions)[met])
    local = (found.positions - pose[:3, 3]) @ pose[:3, :3]
    assert sensor.covers(local).all()
    beside = np.linalg.norm(sensor.ray_starts(local) - found.offsets @ pose[:3, :3], axis=1)
    assert (beside < 0.004).all()  # 0.026 m sideways turn an azimuth by some degrees at 1 m
    assert not sensor.covers(np.array([[5.0, 0.0, 0.45], [5.0, 0.0, -2.3]])).any()


def test_a_pinhole_camera() -> None:
    rays = make("pinhole:width=4,height=2,fov=90").rays()
    at_depth_1 = rays.directions / rays.directions[:, :1]
    assert np.allclose(at_depth_1[:, 1].reshape(2, 4), [[0.75, 0.25, -0.25, -0.75]] * 2)  # y is to the left
    assert np.allclose(at_depth_1[:, 2].reshape(2, 4), [[0.25] * 4, [-0.25] * 4])  # row 0 is the uppermost
    assert rays.rings.tolist() == [0] * 4 + [1] * 4
    assert rays.columns.tolist() == [0, 1, 2, 3] * 2


def test_a_risley_sensor_fills_a_cone() -> None:
    """The Mid-40's field of view is a circle of 38.4 degrees (its data sheet), which the two prisms must give."""
    rays = make("mid-40", seconds=0.5).rays()
    off_axis = np.degrees(np.arccos(rays.directions[:, 0]))
    assert off_axis.max() == pytest.approx(19.2, abs=0.05)
    assert off_axis.min() < 0.1
    azimuth, elevation = angles(rays)
    cells = np.histogram2d(azimuth, elevation, bins=12, range=[[-13, 13], [-13, 13]])[0]
    assert (cells > 0).all()  # no hole anywhere


def test_beams_of_a_fan_leave_the_prisms_side_by_side() -> None:
    """Six rings that shoot at once; one beam along the axis goes as if alone, and a slight prism hardly turns a fan."""
    numbers = make("avia").pattern | {"seconds": 0.01}
    alone = PATTERNS["risley"](**numbers | {"fan": (0.0,), "rate": numbers["rate"] / 3})
    three = PATTERNS["risley"](**numbers | {"fan": (-2.0, 0.0, 1.0)})
    middle = three.select(three.rings == 1)
    assert np.allclose(middle.directions, alone.directions, rtol=0, atol=1e-12)
    assert np.allclose(middle.times, alone.times, rtol=0, atol=1e-12)
    assert (three.times.reshape(-1, 3) == three.times[::3, None]).all()
    slight = PATTERNS["risley"](**numbers | {"fan": (-2.0, 0.0, 1.0), "wedge": 1e-3})
    assert np.allclose(angles(slight)[1].reshape(-1, 3), [-2.0, 0.0, 1.0], atol=2e-3)


@pytest.mark.parametrize(
    ("name", "across", "upwards", "n"),
    [
        ("mid-360", 360.0, (-7.0, 52.0), 20_000),
        ("avia", 70.4, (-38.6, 38.6), 24_000),
        ("xt32", 360.0, (-16.0, 15.0), 64_000),
        ("pandar128", 360.0, (-25.0, 15.0), 230_400),
        ("at128", 120.0, (-12.5, 12.9), 153_600),
        ("os0-128", 360.0, (-45.0, 45.0), 131_072),
        ("os1-128", 360.0, (-22.5, 22.5), 131_072),
        ("os2-128", 360.0, (-11.25, 11.25), 131_072),
        ("m1", 120.0, (-12.5, 12.5), 75_000),
    ],
)
def test_fields_of_view_and_points_are_those_of_the_data_sheets(
    name: str, across: float, upwards: tuple[float, float], n: int
) -> None:
    rays = make(name).rays()
    azimuth, elevation = angles(rays)
    assert len(rays) == n  # points a second over ten turns or frames
    assert np.allclose((elevation.min(), elevation.max()), upwards, atol=0.65)  # in a tenth of a second
    assert np.ptp(azimuth) == pytest.approx(across, abs=5.5)  # lasers are up to 4.7 degrees to the side


def test_shots_of_a_non_repetitive_sensor_are_even_and_never_repeat() -> None:
    """Equal solid angles get equal numbers of shots, in any part of the time; the next scan falls between the last."""
    sensor = make("mid-360")
    first, second = sensor.rays(), make(sensor, begin=0.1).rays()
    low, high = np.sin(np.radians([-7.0, 52.0]))
    bounds = [[-np.pi, np.pi], [low, high]]
    for some in (first.directions, first.directions[:5000], second.directions):
        azimuth = np.arctan2(some[:, 1], some[:, 0])
        cells = np.histogram2d(azimuth, some[:, 2], bins=10, range=bounds)[0]
        assert np.allclose(cells, len(some) / 100, atol=6)
    both = np.concatenate([first.directions, second.directions])
    assert len(np.unique(both.round(9), axis=0)) == len(both)
    assert first.times is not None
    assert first.times[-1] == pytest.approx(0.1, abs=1e-5)
    assert sensor.covers(both).all()
    assert not sensor.covers(np.array([[1.0, 0.0, 2.0], [1.0, 0.0, -0.2]])).any()
    sphere = 2 * np.pi * (high - low) * 5.0**2
    assert sensor.ray_density(5.0 * both[:1]) == pytest.approx(20_000 / sphere)


def test_evenly_spaced_lasers_in_short(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("kind: spinning\ncolumns: 36\nelevations: {from: 15, to: -25, n: 5}\n")
    assert make(path).pattern["lasers"] == [[-25, 0], [-15, 0], [-5, 0], [5, 0], [15, 0]]
    path.write_text("kind: spinning\ncolumns: 36\nelevations: {from: 3, to: 9, n: 1}\n")
    assert make(path).pattern["lasers"] == [[3, 0]]


@pytest.mark.parametrize("angle", [0.0, 1e-3, 0.2, 2.0, 4.0])
@pytest.mark.parametrize("name", ["hdl-64e", "mid-40", "kinect-v1"])
def test_the_rays_near_a_direction_are_those_a_cosine_finds(name: str, angle: float) -> None:
    rays = make(name).rays()
    for direction in (rays.directions[len(rays) // 3], *np.eye(3), -np.eye(3)[0]):
        found = rays.near(direction, angle)
        cosines = rays.directions @ direction
        # a dot product of another length may be rounded in another way
        sure = np.flatnonzero(cosines > np.cos(min(angle, np.pi)) + 1e-15)
        maybe = np.flatnonzero(cosines >= np.cos(min(angle, np.pi)) - 1e-15)
        assert np.all(np.diff(found) > 0)
        assert np.isin(sure, found).all()
        assert np.isin(found, maybe).all()
    assert len(rays.select(np.zeros(0, dtype=int)).near(np.eye(3)[0], angle)) == 0


def test_a_list_of_directions(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("azimuth,elevation,ring\n0,0,3\n90,0,4\n0,-90,5\n")
    rays = make(str(path)).rays()
    assert np.allclose(rays.directions, [[1, 0, 0], [0, 1, 0], [0, 0, -1]], atol=1e-12)
    assert rays.rings.tolist() == [3, 4, 5]
    path.write_text("x,y,z\n0,0,-2\n")
    assert np.allclose(make(str(path)).rays().directions, [[0, 0, -1]])


def test_docs_show_in_ten_lines_how_to_add_a_sensor(tmp_path: Path) -> None:
    """The YAML on the page is a sensor, and it scans."""
    page = (Path(__file__).parents[2] / "docs" / "sensors.md").read_text(encoding="utf-8")
    found = re.search(r"```yaml\n(.*?)```", page, re.DOTALL)
    assert found is not None
    assert len(found[1].splitlines()) <= 10
    path = tmp_path / "my-lidar.yaml"
    path.write_text(found[1])
    sensor = make(str(path), noise=0)
    wall = zo.Mesh([[5, -9, -9], [5, 9, -9], [5, 9, 9], [5, -9, 9]], [[0, 1, 2], [0, 2, 3]])
    scan = zo.scan(wall, sensor, method="oracle")
    assert len(scan) > 100
    assert np.allclose(scan.positions[:, 0], 5.0)
    assert sensor.sources["columns"]


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.yaml", "kind: spinning\nlasers: [1, 2]\ncolums: 3\n", "one of lasers, columns, .*; got 'colums'"),
        ("a.yaml", "kind: spinning\ncolumns: 3\n", "must have lasers"),
        (
            "a.yaml",
            "kind: rotating\n",
            "one of pinhole, spinning, risley, non_repetitive, linear, list; got 'rotating'",
        ),
        ("a.yaml", "lasers: [1, 2]\n", "must have a line `kind:`"),
        ("a.yaml", "kind: [", "must be YAML"),
        ("a.yaml", "[" * 5000, "must be YAML"),
        ("a.yaml", "kind: spinning\nlasers: [1]\ncolumns: 2026-13-45\n", "whole number.*2026-13-45"),
        ("a.yaml", "kind: spinning\nlasers: [a, b]\ncolumns: 3\n", "lasers .* degrees; got 'a'"),
        ("a.yaml", "kind: spinning\nlasers: [1]\ncolumns: 3\nsigma: -1\n", "sigma of a sensor .*; got '?-1"),
        ("a.yaml", "kind: spinning\nelevations: {from: 1, n: 3}\ncolumns: 3\n", "from: DEGREES.*got {'from': '1'"),
        ("a.yaml", "kind: spinning\nelevations: 5\ncolumns: 3\n", "from: DEGREES.*got '5'"),
        ("a.yaml", "kind: spinning\nelevations: {from: 1, to: 99, n: 3}\ncolumns: 3\n", "to of elevations.*got 99"),
        ("a.yaml", "kind: spinning\nelevations: {from: 1, to: 9, n: 1.5}\ncolumns: 3\n", "n of elevations.*got 1.5"),
        ("a.yaml", "kind: spinning\nlasers: [1]\nelevations: {from: 1, to: 9, n: 2}\ncolumns: 3\n", "not both"),
        ("a.yaml", "kind: spinning\nlasers: [1, 5, [-5, 2], 3]\ncolumns: 3\n", "a.yaml: lasers .* 1 has 5 .* 2 has -5"),
        ("a.yaml", "kind: pinhole\nwidth: 3\nheight: 3\n", "fov or f, and not both"),
        ("a.csv", "azimuth,elevatoin\n1,2\n", r"azimuth,elevation or x,y,z\[,ring\]; found: azimuth, elev"),
        ("a.csv", "azimuth,elevation\n1,north\n", "degrees; got 'north'"),
        ("a.csv", "x,y,z\n0,0,0\n", "row 0 is zero"),
        ("a.csv", "", "must have a row of names"),
    ],
)
def test_a_wrong_file(tmp_path: Path, name: str, text: str, words: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(zo.OptionError, match=words):
        make(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "numbers", "words"),
    [
        ("vlp-17", {}, "one of vlp-16, .*; got 'vlp-17'"),
        ("vlp-16", {"colums": 3}, ".*columns.*; got 'colums'"),
        ("vlp-16", {"columns": 0}, "columns .* whole number.*; got 0"),
        ("vlp-16", {"drop": 1.5}, r"drop .* from 0 to 1; got 1\.5"),
        ("vlp-16", {"sigma": [[1, 1e300]]}, r"sigma .* from 0 to 10000 metres; got 1e\+300"),
        ("vlp-16", {"lasers": 3}, "lasers .* rows of 2 numbers.*; got 3"),
        ("vlp-16", {"lasers": [[1, 2, 3]]}, "lasers .* rows of 2 numbers"),
        ("vlp-16", {"offsets": [[0.1, 0.0]]}, "offsets must be one per laser .16.; got 1"),
        ("vlp-16", {"returns": "best"}, "one of first, strongest, last, all; got 'best'"),
        ("vlp-16", {"range_min": 200}, r"range_min must be less than range_max; got 200\.0 and 100\.0"),
        ("vls-128", {"columns": 10**6}, "1 to 8,500,000 rays; it has 128,000,000"),
        ("mid-40", {"frequencies": 3}, "frequencies .* 2 numbers"),
        ("avia", {"fan": [1, 0]}, "fan must have the lowest elevation first; 0 has 1 degrees and 1 has 0"),
        ("mid-40", {"rate": float("nan")}, "rate .*; got nan"),
        ("mid-40", {"seconds": float("inf")}, "seconds .*; got inf"),
        ("pinhole:width", {}, "name=value; got 'width'"),
        ("pinhole:width=wide", {}, "width .* whole number.*; got 'wide'"),
        ("pinhole", {"fov": 200.0}, r"fov .* degrees; got 200\.0"),
        ("pinhole", {"fov": 60.0, "f": 100.0}, "fov or f, not both"),
        ("kinect-v1", {"baseline": 0.075}, "baseline.*vector"),
        ("kinect-v1", {"baseline": [1.0, 2.0]}, "baseline"),
        ("kinect-v1", {"baseline": [[0, 0, "x"]]}, "baseline"),
        ("kinect-v1", {"baseline_incidence_max": 91}, "baseline_incidence_max"),
    ],
)
def test_wrong_numbers(name: str, numbers: dict[str, object], words: str) -> None:
    with pytest.raises(zo.OptionError, match=words):
        make(name, **numbers).rays()


def test_numbers_can_be_changed_and_the_table_stays() -> None:
    changed = make("vlp-32c", columns=900, sigma=0.5)
    assert (changed.pattern["columns"], changed.noise_model.sigma) == (900, 0.5)
    assert changed.sources["columns"] == "given by the user"
    assert make("vlp-32c").pattern["columns"] == 1800
    assert make("pinhole", f=500.0).pixels == 500.0
    assert NoiseModel().sigma == 0.0


@pytest.mark.parametrize(
    ("ends", "last"), [((-135.0, 135.0), 135.0), ((135.0, -135.0), -135.0), ((0.0, 360.0), 359.75), ((5.0, 5.0), 5.0)]
)
def test_the_last_firing_is_at_the_end_of_a_part_of_a_turn(ends: tuple[float, float], last: float) -> None:
    """1,081 firings over 270 degrees are a quarter of a degree apart; a whole turn ends where it began."""
    columns = 1440 if ends[1] == 360.0 else 1081
    rays = zo.sensors.Sensor("line", "spinning", {"lasers": [0.0], "columns": columns, "azimuths": ends}).rays()
    azimuths = np.degrees(np.unwrap(np.arctan2(rays.directions[:, 1], rays.directions[:, 0])))
    assert azimuths[0] == pytest.approx(ends[0])
    assert azimuths[-1] == pytest.approx(last)
    assert np.diff(azimuths) == pytest.approx((last - ends[0]) / (columns - 1))
