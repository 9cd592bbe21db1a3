"""Documents that users write, sensors, scenes, poses, labels: of hostile ones one line, soon; nothing is misread."""

import json
import struct
import tracemalloc
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.cli.conftest import write_off
from zbuf_occlude.base.documents import Number, parse_bool, parse_document, parse_line
from zbuf_occlude.base.errors import OccludeError, OptionError
from zbuf_occlude.meshes.labels import read_labels
from zbuf_occlude.sensors.rays import numbers_of
from zbuf_occlude.sensors.scenes.contents import read_scene
from zbuf_occlude.sensors.sensor import NUMBERS, Sensor

LIDAR = "kind: spinning\nlasers: [-2, 0, 2]\ncolumns: 90\n"
RISLEY = "kind: risley\nfrequencies: [-77.7, 121.6]\nwedge: 18\nindex: 1.51\n"
WALL = zo.Mesh([[5, -9, -9], [5, 9, -9], [5, 9, 9], [5, -9, 9]], [[0, 1, 2], [0, 2, 3]])
MANY = "9" * 401
SMALL = (
    zo.sensors.make("kinect-v1", width=20, height=20),
    zo.sensors.make("vlp-16", columns=90),
    zo.sensors.make("mid-40", rate=1000),
    Sensor("mine", "list", {"directions": [[1, 0, 0], [1, 0.1, 0]]}),
)
"""A sensor of each kind."""


@pytest.fixture(autouse=True)
def _no_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        yield


def read(tmp_path: Path, name: str, content: str | bytes) -> Any:
    """Read a file as what its name says it is."""
    path = tmp_path / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    if name.startswith("sensor"):
        return zo.sensors.make(str(path))
    if name.startswith("labels"):
        return read_labels(path)
    return read_scene(path) if name.startswith("scene") else zo.views.parse(str(path))


def camera(**changed: Any) -> str:
    item = {"R": np.eye(3).tolist(), "t": [0, 0, 5], "K": [[50, 0, 50], [0, 50, 50], [0, 0, 1]]}
    return json.dumps([{**item, "width": 100, "height": 100, **changed}]).replace(f'"{MANY}"', MANY)


def nerf(**changed: Any) -> str:
    frame = {"transform_matrix": np.eye(4).tolist()}
    return json.dumps({"w": 100, "h": 100, "fl_x": 50, "frames": [frame], **changed}).replace(f'"{MANY}"', MANY)


def scene(**changed: Any) -> str:
    return json.dumps({"objects": [{"mesh": "a.off", "position": [0, 0, 0], **changed}]}).replace(f'"{MANY}"', MANY)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("sensor.csv", "azimuth,elevation\n" + "1" * 140_000 + ",1\n", "must be CSV; .*field larger"),
        ("sensor.csv", "azimuth,elevation\n1,1000\n", r"elevation .* from -90 to 90 degrees; got 1000"),
        ("sensor.csv", "x,y,z,X\n1,2,3,4\n", "x occurs 2 times"),
        ("sensor.csv", "x,y,z" + ",a" * 1_000 + "\n1,2,3\n", "at most 1,000 columns"),
        ("sensor.yaml", LIDAR + "columns: 9\n", "columns occurs 2 times"),
        ("sensor.csv", '"a\nerror: b",c\n1,2\n', r"found: a\\nerror: b, c"),
        ("sensor.csv", "x,y,z\n1,2\n", "z in .* must be numbers, finite; got ''"),
        ("sensor.csv", "azimuth,elevation\n1e300,1\n", r"azimuth .* degrees; got 1e\+300"),
        ("sensor.csv", "azimuth,elevation,ring\n1,1,1.5\n", r"rings .* whole numbers.*; got 1\.5"),
        ("sensor.yaml", LIDAR + "sigma: [[50, 0.1], [0, 0.2]]\n", r"sigma .* growing ranges; got 50\.0, 0\.0"),
        ("sensor.yaml", LIDAR + "sigma: [[0, 0.1], [0, 0.2]]\n", "sigma .* growing ranges"),
        ("sensor.yaml", LIDAR + "sigma: [[[0, 0.1]], [[5, 0.2]]]\n", "sigma .* a number or rows of 2 numbers"),
        ("sensor.yaml", LIDAR + "sigma: [0, 0.1, 5, 0.2]\n", "sigma .* a number or rows of 2 numbers"),
        ("sensor.yaml", LIDAR + "sigma: 1e308\n", r"sigma .* metres; got 1e\+308"),
        ("sensor.yaml", LIDAR + "step: 1e-320\n", "step .* metres; got"),
        ("sensor.yaml", LIDAR + 'axial: "no"\n', "axial of a sensor must be true or false; got 'no'"),
        ("sensor.yaml", "kind: spinning\nlasers: [1]\ncolumns: true\n", "columns .* whole number.*; got 'true'"),
        ("sensor.yaml", "kind: spinning\nlasers: [.nan]\ncolumns: 3\n", "lasers .* degrees; got '.nan'"),
        ("sensor.yaml", "kind: pinhole\nwidth: 9\nheight: 9\nf: 1e-300\n", "f of .* must be .* pixels; got 1e-300"),
        ("sensor.yaml", RISLEY + "rate: 1e12\nseconds: 1\n", "rate .* shots a second; got 1000000000000"),
        ("sensor.yaml", LIDAR + 'name: "a\\nerror: b"\n', r"name in .* must be a line .*; got 'a\\nerror: b'"),
        ("sensor.yaml", "kind: [spinning]\n", "kind in .* must be a line"),
        ("sensor.yaml", LIDAR + "#" * 300_000, "must be YAML of at most 200,000 bytes"),
        ("scene.json", scene(mesh="a.off\nerror: b"), r"object 0: mesh must be a line .*; got 'a.off\\nerror: b'"),
        ("scene.json", scene(position=[0, MANY, 0]), "object 0: position must be 3 numbers"),
        ("scene.json", scene(size=MANY), "size must be a number, .* metres"),
        ("scene.json", scene(yaw=1e300), r"yaw must be a number, .* degrees; got 1e\+300"),
        ("scene.json", scene(albedo=MANY), "albedo must be a number, from 0 to 1"),
        ("scene.json", scene(albedo=True), "albedo must be a number, from 0 to 1; got True"),
        ("scene.json", scene(up="x"), "up must be one of z, y; got 'x'"),
        ("cameras.json", camera(R=[[MANY, 0, 0]] * 3), "number 0 .*R must be 3 x 3 numbers"),
        ("cameras.json", camera(t=[MANY, 0, 0]), "number 0 .*t must be 3 numbers, finite"),
        ("cameras.json", camera(K=[[MANY, 0, 0]] * 3), "number 0 .*K must be 3 x 3 numbers"),
        ("cameras.json", camera(K=[[50, 9, 50], [0, 50, 50], [0, 0, 1]]), "K must be .* without skew"),
        ("cameras.json", camera(K=[[50, 0, 50], [0, 50, 50], [0, 0, 2]]), "K must be fx 0 cx"),
        ("cameras.json", camera()[:-2] + ', "t": [0, 0, 6]}]', "t occurs 2 times"),
        ("cameras.json", camera(width=MANY), "number 0 .*width must be a number, .* pixels"),
        ("cameras.json", camera(R=[[1e200, 0, 0], [0, 1, 0], [0, 0, 1]]), "R must be 3 x 3 numbers, from -2 to 2"),
        ("transforms.json", nerf(w=MANY), "number 0 .*w must be a number"),
        ("transforms.json", nerf(fl_x=None, camera_angle_x=MANY), "camera_angle_x must be a number"),
        ("transforms.json", nerf(fl_x=None, camera_angle_x=0), "camera_angle_x must be .* radians; got 0"),
        ("transforms.json", nerf(camera_model="OPENCV_FISHEYE"), "camera_model OPENCV_FISHEYE is no pinhole"),
        ("transforms.json", nerf(is_fisheye=True), "is no pinhole"),
        (
            "transforms.json",
            nerf(frames=[{"transform_matrix": np.zeros((4, 4)).tolist()}]),
            "last row .* must be 0 0 0 1",
        ),
        ("transforms.json", nerf(k1="no"), "k1 must be a number"),
        ("views.csv", "azimuth,elevation\n1e300,1\n", r"azimuth in .* degrees; got 1e\+300"),
        ("views.csv", "azimuth,elevation,roll\n1,1,1e300\n", r"roll in .* degrees; got 1e\+300"),
        ("images.txt", "1 0 0 0 0 0 0 1 1 x.png\n\n", "a quaternion must be finite and not zero"),
        ("images.txt", "1 nan 0 0 0 0 0 1 1 x.png\n\n", "the quaternion must be 4 numbers"),
        ("images.txt", "1 1e400 1 0 0 0 0 1 1 x.png\n\n", "the quaternion must be 4 numbers"),
        ("labels.json", '{"one": {"a": 1}}', "it is JSON of another form"),
        ("labels.json", '{"one": ["a"], "one": ["b"]}', "one occurs 2 times"),
        ("labels.csv", "key,class,split\n\n\na,b,best\n", r"line 4 must name the splits .* 'best'"),
        ("labels.json", '{"one": true}', "it is JSON of another form"),
    ],
)
def test_what_a_document_may_not_hold_is_one_line(tmp_path: Path, name: str, content: str, message: str) -> None:
    write_off(tmp_path / "a.off", np.eye(3), np.array([[0, 1, 2]]))
    with pytest.raises(OptionError, match=message) as caught:
        read(tmp_path, name, content)
    said = str(caught.value)
    assert "\n" not in said
    assert "ufunc" not in said
    assert len(said) < 1000
    assert name in said


@pytest.mark.parametrize("levels", [4, 8, 20])
def test_aliases_of_yaml_do_not_multiply(tmp_path: Path, levels: int) -> None:
    text = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
    for level in range(levels):
        text += f"a{level + 1}: &a{level + 1} [{', '.join([f'*a{level}'] * 9)}]\n"
    tracemalloc.start()
    with pytest.raises(OptionError, match=r"aliases .+ are not supported"):
        read(tmp_path, "sensor.yaml", text + LIDAR)
    assert tracemalloc.get_traced_memory()[1] < 100e6
    tracemalloc.stop()


def test_words_of_yaml_that_are_numbers_are_numbers(tmp_path: Path) -> None:
    """PyYAML takes 1e5 for a word, 010 for 8 and no for a flag."""
    sensor = read(tmp_path, "sensor.yaml", RISLEY + "rate: 1e5\nseconds: 010e-3\naxial: TRUE\n")
    assert (len(sensor.rays()), sensor.noise_model.axial, sensor.pattern["rate"]) == (1000, True, 1e5)


@pytest.mark.parametrize("more", ["", "sigma: [[0, 0.1], [50, 0.2]]\n", f"lateral: [0.8, 0.035]\nrange_max: {MANY}\n"])
def test_what_sensors_accepts_scans(tmp_path: Path, more: str) -> None:
    sensor = read(tmp_path, "sensor.yaml", LIDAR + more)
    scan = zo.scan(WALL, sensor, method="oracle")
    assert len(scan) > 20
    assert np.isfinite(scan.positions).all()
    assert sensor.noise_model.range_sigma(20.0) == pytest.approx(0.14 if "sigma" in more else 0.0)


def test_a_quaternion_of_any_size_is_the_same_rotation(tmp_path: Path) -> None:
    expected = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])  # a quarter about x
    for size in ("1", "1e200", "1e-200", "1e308"):
        made = read(tmp_path, "images.txt", f"1 {size} {size} 0 0 0 0 1 1 x.png\n\n")
        assert np.allclose(made.rotations[0], np.diag([1, -1, -1]) @ expected), size


def images_bin(n: int = 1, points: int = 0, name: bytes = b"x.png\0") -> bytes:
    return struct.pack("<Q", n) + struct.pack("<I7dI", 1, 1, 0, 0, 0, 0, 0, 5, 1) + name + struct.pack("<Q", points)


@pytest.mark.parametrize(
    ("images", "cameras", "message"),
    [
        (b"", b"", "cannot read the COLMAP file"),
        (images_bin()[:40], None, "it ends too early"),
        (images_bin(n=2**63), None, "it ends too early"),
        (images_bin(n=2, points=2**62), None, "cannot read the COLMAP file"),
        (images_bin(n=2, name=b"x.png"), None, "it ends too early"),
        (images_bin(points=2), None, "it ends too early"),
        (images_bin(name=b"x.png")[: 8 + 64 + 3], None, "it ends too early"),
        (images_bin(), struct.pack("<QiiQQ", 1, 1, 77, 9, 9), "model 77"),
        (images_bin(), struct.pack("<QiiQQ4d", 1, 1, 2, 9, 9, 5, 4, 4, 0.1), "SIMPLE_RADIAL with distortion"),
        (images_bin(), struct.pack("<QiiQQ4d", 1, 2, 1, 9, 9, 5, 5, 4, 4), "no 'camera 1'"),
    ],
)
def test_damaged_binary_files_of_colmap(tmp_path: Path, images: bytes, cameras: bytes | None, message: str) -> None:
    if cameras is not None:
        (tmp_path / "cameras.bin").write_bytes(cameras)
    with pytest.raises(OptionError, match=message):
        read(tmp_path, "images.bin", images)


@pytest.mark.parametrize(
    ("form", "data"),
    [
        ("JSON", b"[" + b"[]," * 9_000_000 + b"[]]"),
        ("CSV", b"a\n" + b"1\n" * 1_000_001),
        ("CSV", b",".join(b"c%d" % i for i in range(900)) + b"\n" + b"2,2\n" * 10_000),
        ("CSV", b"," * 20_000_000 + b"\n1\n"),
        ("YAML", b"[" + b"1," * 100_001 + b"]"),
    ],
)
def test_documents_too_large_to_be_any_are_refused(form: str, data: bytes) -> None:
    with pytest.raises(OptionError, match=f"a.file must be {form}.*(at most|below it)"):
        parse_document(form, data, "a.file")


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: Number().read("a", "1e5"), 1e5),
        (lambda: Number(whole=True).read("a", "3.0"), 3),
        (lambda: Number(0, 5, least=0.1).read("a", 0), 0.0),
        (lambda: Number(shapes=((3,),)).read("a", [["1"], [2], [3.0]]), [1.0, 2.0, 3.0]),
        (lambda: Number(shapes=((2, 2),)).read("a", (1, 2, 3, 4)), [[1.0, 2.0], [3.0, 4.0]]),
        (lambda: Number(shapes=((), (-1, 2))).read("a", np.ones((1, 2))), [[1.0, 1.0]]),
        (lambda: parse_bool("a", np.True_), True),
        (lambda: parse_bool("a", "False"), False),
        (lambda: parse_line("a", "é"), "é"),
    ],
)
def test_numbers_flags_and_lines(call: Callable[[], object], expected: object) -> None:
    assert call() == expected


@pytest.mark.parametrize(
    ("kind", "value", "said"),
    [
        (Number(0, 5, "metres"), 6, "a must be a number, from 0 to 5 metres; got 6.0."),
        (Number(0, 5, least=0.1), 0.01, "a must be a number, from 0 to 5; got 0.01."),
        (Number(whole=True), 1.5, "a must be a whole number, finite; got 1.5."),
        (Number(), True, "a must be a number, finite; got True."),
        (Number(), None, "a must be a number, finite; got None."),
        (Number(), [1], "a must be a number, finite; got [1]."),
        (Number(shapes=((3,), (2, 2))), [1, 2], "a must be 3 numbers or 2 x 2 numbers, finite; got [1, 2]."),
        (Number(shapes=((2, 3),)), [[1, 2], [3, 4], [5, 6]], "a must be 2 x 3 numbers, finite; got [[1, 2], [3, 4"),
        (Number(shapes=((-1, 2),)), [[1, 2], [3]], "a must be rows of 2 numbers, finite; got [[1, 2], [3]]."),
        (Number(shapes=((-1,),)), ["1", "east"], "a must be numbers, finite; got 'east'."),
    ],
)
def test_what_is_no_such_number(kind: Number, value: object, said: str) -> None:
    with pytest.raises(OptionError) as caught:
        kind.read("a", value)
    assert str(caught.value).startswith(said)


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("sensor", SMALL, ids=lambda sensor: sensor.kind)
def test_a_sensor_at_the_bounds_of_each_number_scans_or_is_refused(sensor: Sensor, name: str) -> None:
    if name in numbers_of(sensor.kind) or name in vars(sensor.noise_model):
        kind = NUMBERS[name]
        for value in (kind.low, kind.high, kind.least, max(kind.low, 0.0) + 1e-9):
            for shape in kind.shapes:
                given = np.full([1 if n == -1 else n for n in shape], value)
                with suppress(OccludeError):
                    changed = sensor.with_numbers(**{name: given})
                    if len(changed.rays()) < 100_000:
                        assert np.isfinite(zo.scan(WALL, changed, method="oracle").positions).all()
