"""Odd values at the public border: what is valid is understood, what is not is one clear error, never a traceback."""

import pickle
import signal
import threading
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from trimesh.creation import box

import zbuf_occlude as zo
from zbuf_occlude.base.errors import ArgumentError, MeshError, OccludeError, OptionError, shown
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.sensors.scan_config import ScanConfig
from zbuf_occlude.sensors.scenes import Placed, moved

CUBE = zo.Mesh.from_trimesh(box())
VIEWS = zo.views.for_mesh(CUBE, "ring:2@30")
SENSOR = zo.sensors.make("vlp-16")
SCAN = zo.scan(CUBE, SENSOR, zo.sensors.look_at([3, 0, 0], [0, 0, 0]))
PLY = (
    "ply\nformat {} 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\n"
)
TEXTS = {
    "a.off": "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    "a.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "a.ply": PLY.format("ascii") + "end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    "a.stl": "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
    "endfacet\nendsolid\n",
}
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()


@pytest.mark.parametrize("name", TEXTS)
def test_a_byte_order_mark_is_no_part_of_a_mesh(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"\xef\xbb\xbf" + TEXTS[name].encode())
    assert len(zo.load_mesh(tmp_path / name).faces) == 1


@pytest.mark.parametrize("ending", [b"\n", b"\r\n", b"\r"])
@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
def test_the_last_line_of_a_header_may_end_in_its_own_way(tmp_path: Path, encoding: str, ending: bytes) -> None:
    text = b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    body = text if encoding == "ascii" else TRIANGLE + b"\x03" + np.array([0, 1, 2], "<i4").tobytes()
    (tmp_path / "a.ply").write_bytes(PLY.format(encoding).encode() + b"end_header" + ending + body)
    assert zo.load_mesh(tmp_path / "a.ply").areas.tolist() == [0.5]


@pytest.fixture
def free_alarm() -> Iterator[None]:
    """The alarm as a program has it that does not use it; pytest's plugins may."""
    handler, timer = signal.getsignal(signal.SIGALRM), signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGALRM, handler)
    signal.setitimer(signal.ITIMER_REAL, *timer)


def _grow(limits: Limits) -> None:
    with limits.watch():
        kept = np.ones(30_000_000)  # 0.24 GB, touched
        threading.Event().wait(20)
        assert kept.all()


@pytest.mark.usefixtures("free_alarm")
def test_a_mesh_that_takes_too_long_or_too_much_is_an_error() -> None:
    for limits, said in (
        (Limits(seconds=0.1), r"timed out after 0\.1 s"),
        (Limits(gigabytes=0.1), r"exceeded 0\.1 GB of memory"),
    ):
        with pytest.raises(MeshError, match=said):
            _grow(limits)
    with Limits(gigabytes=0.1).watch():  # what the process had before does not count
        threading.Event().wait(0.7)
    assert signal.getsignal(signal.SIGALRM) is signal.SIG_DFL
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: zo.Mesh(np.eye(3), [[0, 1, 2], [0, 1]]), r"faces must be \(n, 3\) int; got rows of unequal length"),
        (lambda: CUBE.transformed("a"), r"scale must be a number; got \(\) <U1"),
        (lambda: CUBE.transformed(1.0, "abc"), r"translation must be \(3,\); got \(\) <U3"),
        (lambda: CUBE.rotated([[1, 2], [3]]), r"rotation must be \(3, 3\); got rows of unequal length"),
        (lambda: zo.sample_surface(CUBE, n_points=True), "n_points must be a positive int; got True"),
        (lambda: zo.sample_surface(CUBE, density="5"), "density must be positive and finite; got '5'"),
        (lambda: zo.sample_surface(None, n_points=3), "mesh must be a path, a Mesh, .* got NoneType"),
        (lambda: zo.sample_surface(CUBE, n_points=3).select([3]), "which must pick among 3 points; index 3 is"),
        (lambda: zo.sample_surface(CUBE, n_points=3).select([True]), "which must pick among 3 points; boolean"),
        (lambda: VIEWS[[True]], "which must pick among 2 views; boolean it has 1 entries"),
        (lambda: VIEWS[[0, 2]], "which must pick among 2 views; index 2 is out of bounds"),
        (lambda: VIEWS.looking((1, 2)), r"at must be \(3,\); got \(2,\) int64"),
        (lambda: VIEWS.select("a"), r"which must be a mask or indices, \(m,\) bool or int; got \(\) <U1"),
        (lambda: SENSOR.rays().select([True]), "which must pick among 28800 rays; boolean it has 1 entries"),
        (lambda: SCAN.select([True] * (len(SCAN) + 1)), "which must pick among .* returns; boolean"),
        (lambda: SCAN.select([-len(SCAN) - 1]), "which must pick among .* returns; index -.* is out of bounds"),
        (lambda: moved(to=(0, 5)), r"to must be \(3,\); got \(2,\) int64"),
        (lambda: moved(scale=(1, 2)), r"scale must be \(3,\); got \(2,\) int64"),
        (lambda: moved(yaw="left"), "yaw must be a number; got"),
        (lambda: zo.views.random(3, elevation=(1.0, 0.0)), r"elevations must run upwards within -90\.\.90 degrees"),
        (lambda: zo.views.parse(None), "views must be paper100, .*; got None"),
        (lambda: zo.load_mesh(box()), "path must be a path.*Mesh.from_trimesh"),
        (lambda: zo.prepare(zo.SurfacePoints.free(np.zeros((0, 3))), "hidden_point_removal"), "has no points|needs"),
        (lambda: zo.frames(CUBE, "ring:8@30"), "views must be Views; got str"),
        (lambda: zo.frames(CUBE, None), "views must be Views; got NoneType"),
        (lambda: zo.frames(CUBE, VIEWS, colors="no"), "colors must be True or False; got 'no'"),
        (
            lambda: zo.write_bop("bop", zo.Scene.from_mesh(CUBE), VIEWS, split="a\0b"),
            "split must be the name of a folder",
        ),
        (lambda: zo.write_bop("bop", zo.Scene.from_mesh(CUBE), VIEWS, split=1), "split must be the name of a folder"),
        (lambda: zo.write_bop("bop", zo.Scene.from_mesh(CUBE), VIEWS, background=None), "background must be labels"),
        (lambda: zo.write_bop("bop", zo.Scene.from_mesh(CUBE), 3), "views must be Views; got int"),
        (lambda: zo.Scene.from_mesh(None), "mesh must be a path, a Mesh, .* got NoneType"),
        (lambda: zo.Scene.from_mesh(CUBE, 3), "a label must be a word; got 3"),
        (lambda: Placed(None), "mesh of object must be a Mesh; got NoneType"),
        (lambda: Placed(CUBE, "car", velocity=(1, 2)), r"velocity of car must be \(3,\); got \(2,\) int64"),
        (lambda: Placed(CUBE, is_background=2), "is_background of object must be True or False; got 2"),
        (lambda: zo.visibility_grid(CUBE, [3, 2, 1], n=10**6), "at most 134,217,728 voxels .*; 1 of 1000000 along"),
        (lambda: zo.visibility_grid(CUBE, np.ones((9, 3)), n=300), "voxels for all eyes together; 9 of 300"),
        (lambda: zo.visibility_grid(CUBE, [3, 2, 1], n=2).tsdf(True), "truncation must be a length above 0"),
        (lambda: zo.prepare(CUBE, "occupancy_grid", n=True), "n must be a number, like the default"),
        (lambda: zo.compare_scans(CUBE, [[[1, 2, 3]]], "vlp-16", refine="no"), "refine must be True or False"),
        (lambda: zo.compare_scans(CUBE, [[[1, 2, 3]]], "vlp-16", tolerance=True), "tolerance must be a length above 0"),
        (lambda: zo.blockers(CUBE, None, [3, 2, 1]), "points must be SurfacePoints; got NoneType"),
        (lambda: zo.visible_faces(CUBE, [3, 2, 1], exactly="no"), "exactly must be True or False; got 'no'"),
        (lambda: zo.load_mesh("a.off", colors="no"), "colors must be True or False; got 'no'"),
        (lambda: zo.load_mesh("a.off", name=3), "name must be a word; got 3"),
        (lambda: zo.load_mesh("a.off", unit=["mm"]), r"unit must be one of mm, cm, m, in; got \['mm'\]"),
        (lambda: zo.scan(CUBE, "vlp-16", range=True, unit="m"), "range must be metres above 0; got True"),
        (lambda: zo.occlude(CUBE, up=True), "up must be one of z, y; got True"),
        (lambda: zo.depth_image(CUBE, unit=5), "unit must be one of mm, cm, m, in; got 5"),
        (lambda: zo.MeshCollection.from_paths("a.off", colors=1), "colors must be True or False; got 1"),
        (lambda: zo.occlude(CUBE, azimuth=True, elevation=0), "azimuth must be a number, degrees; got True"),
        (lambda: zo.occlude(CUBE, azimuth=0, elevation=10**400), "elevation must be a number"),
        (lambda: zo.occlude(CUBE, azimuth=0, distance=[1, 2]), r"distance must be a positive number; got \[1, 2\]"),
        (lambda: zo.occlude(CUBE, eye=[1e155, 0, 0]), r"eye must be finite and below 1e\+70"),
        (lambda: zo.occlude(CUBE, eye=["1", "2", "3"]), r"eye must be \(3,\); got \(3,\) <U1"),
        (lambda: zo.occlude(CUBE, azimuth=0, method=["exact"]), "method must be one of"),
        (lambda: zo.scan(CUBE, "vlp-16", range=5, azimuth=set()), "azimuth must be a number, degrees"),
        (lambda: zo.scan(CUBE, "vlp-16", range=5, transparent=[1, 2]), "transparent must be a mapping"),
        (
            lambda: zo.scan(CUBE, "vlp-16", np.eye(4) + np.eye(4, k=3) * 1e155),
            "pose must be finite",
        ),
        (lambda: zo.scan(CUBE, "vlp-16", range=5, towards=np.zeros((0, 3))), r"towards must be \(2, 3\); got \(0, 3\)"),
        (
            lambda: zo.write_bop("bop", zo.Scene.from_mesh(CUBE), VIEWS, background=np.array(2)),
            "background must be labels",
        ),
        (lambda: zo.views.for_mesh(CUBE, np.zeros((2, 2))), "views must be paper100"),  # type: ignore[arg-type]
        (lambda: zo.visible_mesh(CUBE, [[1], [1, 2]]), "eyes must be .*; got rows of unequal length"),
        (lambda: zo.visible_vertices(CUBE, [[1], [1, 2]]), "eyes must be .*; got rows of unequal length"),
        (lambda: zo.sample_surface(CUBE, density=1e308), "at most 2.31 - 1 can be made"),
        (
            lambda: zo.write_bop("bop", zo.Scene.from_mesh(CUBE), VIEWS, split="9" * 900),
            "split must be the name of a folder",
        ),
        (lambda: zo.sensors.look_at([[1], [1, 2]], [0, 0, 0]), "position must be .*; got rows of unequal length"),
        (lambda: ScanConfig(SENSOR, range=[[1], [1, 2]]), "--range must be a number, or two"),
        (lambda: ScanConfig(SENSOR, range=np.array(2)), "--range must be a number, or two"),
        (lambda: zo.sensors.make("vlp-16", name="x"), "a number of the sensor vlp-16 must be one of .* got 'name'"),
        (lambda: zo.sensors.make("vlp-16", self=1), "a number of the sensor vlp-16 must be one of .* got 'self'"),
        (lambda: zo.sensors.make("vlp-16", sigma=1j), "sigma of a sensor must be a number"),
        (lambda: zo.views.parse("ring:3@30", seed="a"), "seed must be an int"),
        (lambda: zo.views.parse("ring:3@30", farthest=Fraction(1, 2)), r"distances must run upwards; got 4\.\.0\.5"),
        (lambda: zo.views.parse("ring:3@30", farthest="9"), "distance must be a positive number; got '9'"),
        (lambda: zo.views.ring(True, elevation=0), "must be a positive int; got True"),
        (lambda: zo.Views([1j], [0], [1]), "must be numbers"),
        (lambda: zo.Views([0.0], [0.0], [1.0], target=(1e155, 0, 0)), r"target must be finite and below 1e\+70"),
        (lambda: zo.depth_image(CUBE, azimuth=0, fov=1e-300), "fov must be a number from 0.001 to 179.9, degrees"),
        (lambda: ScanConfig(SENSOR, size="banana"), "--size must be .*; got 'banana'"),
        (lambda: ScanConfig(SENSOR, size={"car": "big"}), "--size must be .*; got {'car': 'big'}"),
        (lambda: ScanConfig(SENSOR, size="1,2"), "each class once; got '1,2'"),
        (lambda: ScanConfig(SENSOR, range="far"), r"--range must be a number, or two as A\.\.B; got 'far'"),
        (lambda: ScanConfig(SENSOR, range=[1, 2, 3]), r"--range must be a number, or two as A\.\.B"),
        (lambda: ScanConfig(SENSOR, keep=2), "keep must be a word; got 2"),
        (lambda: ScanConfig(SENSOR, keep_clean="no"), "keep_clean must be True or False; got 'no'"),
        (lambda: ScanConfig(SENSOR, ground="no"), "ground must be True or False; got 'no'"),
        (lambda: ScanConfig(SENSOR, method="guess"), "method must be one of"),
        (lambda: ScanConfig(SENSOR, scene="ground", sensor_height="2"), "--sensor-height must be metres above 0"),
        (lambda: ScanConfig(SENSOR, transparent={"a": "b"}), "a share in 0..1; got 'a'='b'"),
    ],
)
def test_what_is_no_argument_is_one_clear_error(call: Callable[[], object], said: str) -> None:
    with pytest.raises(OccludeError, match=said):
        call()


@pytest.mark.parametrize("value", [7, 7.0, "7", (7, 7), np.float64(7), np.array([7.0, 7.0])])
def test_python_and_a_person_write_the_same_range(value: object) -> None:
    assert tuple(ScanConfig(SENSOR, range=value).range or ()) == (7.0, 7.0)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("value", "sizes"),
    [(None, {}), ({}, {}), (2, {"*": 2.0}), ("2", {"*": 2.0}), ("file", "file"), ({"car": 4}, {"car": 4.0})],
)
def test_python_and_a_person_write_the_same_sizes(value: object, sizes: object) -> None:
    assert ScanConfig(SENSOR, size=value).size == sizes  # type: ignore[arg-type]


def test_a_sensor_is_taken_wherever_its_name_is() -> None:
    sensor = zo.sensors.make("vlp-16")
    assert zo.sensors.make(sensor) is sensor
    assert zo.sensors.make(sensor, columns=9).pattern["columns"] == 9


def test_a_message_shows_a_value_in_one_line_whatever_it_is() -> None:
    for value in (10**5000, "a\nb", np.zeros((3, 3)), ["x" * 999] * 999, object()):
        said = shown(value)
        assert "\n" not in said
        assert 0 < len(said) <= 60


@pytest.mark.parametrize("seed", [None, -1, "a", 1.5, True, [1, 2]])
def test_a_seed_that_is_none(seed: object) -> None:
    for draw in (
        lambda: zo.sample_surface(CUBE, n_points=3, seed=seed),  # type: ignore[arg-type]
        lambda: zo.views.parse("random:4", seed=seed),  # type: ignore[arg-type]
    ):
        with pytest.raises(OptionError, match="seed must be an int of at least 0, a SeedSequence or a Generator; got"):
            draw()


def test_a_tensor_with_a_gradient_says_how_to_pass_it() -> None:
    torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")
    vertices, said = torch.tensor(CUBE.vertices), r"must be .*; got a Tensor: .* requires grad.*detach\(\)"
    assert len(zo.occlude((vertices, CUBE.faces), azimuth=0, n_points=9)) == 9
    for call in (
        lambda: zo.occlude((vertices.requires_grad_(), CUBE.faces), azimuth=0),
        lambda: zo.occlude(CUBE, eye=torch.tensor([3.0, 0.0, 0.0], requires_grad=True)),
        lambda: zo.SurfacePoints.free(vertices.requires_grad_()),
    ):
        with pytest.raises(ArgumentError, match=said):
            call()
    with pytest.raises(ArgumentError, match=r"must be numbers; .* requires grad"):
        zo.Views(torch.zeros(1, requires_grad=True), [0.0], [1.0])


def test_what_selects_views() -> None:
    """Also what ends an iteration over them, and the list of none."""
    assert [len(each) for each in (VIEWS[-1], VIEWS[1:], VIEWS[[False, True]], VIEWS[[]])] == [1, 1, 1, 0]
    assert [view.azimuth[0] for view in VIEWS] == VIEWS.azimuth.tolist()


@pytest.mark.parametrize("kind", ["ring", "fibonacci", "random", "grid"])
def test_numbers_of_thousands_of_digits(kind: str) -> None:
    for spec in (f"{kind}:{'9' * 5000}", f"{kind}:{'9' * 5000}@30", f"{kind}:3x{'9' * 5000}"):
        with pytest.raises(OptionError) as caught:
            zo.views.parse(spec)
        assert len(str(caught.value)) < 1000


def test_coordinates_beyond_all_measure() -> None:
    for size in (1e71, 1e160, 1e308):
        with pytest.raises(ArgumentError, match=r"vertices must be at most 1e\+70 in size"):
            zo.Mesh(CUBE.vertices * size, CUBE.faces)
    with zo.prepare(CUBE, "exact") as occluder:
        for size in (1e16, 1e39, 1e70):
            far = zo.SurfacePoints.free(np.full((3, 3), size))
            with pytest.raises(ArgumentError, match=r"points must lie within 1e\+15 diagonals of the mesh"):
                occluder.visible(far, [[0, 0, 4]])
            with pytest.raises(ArgumentError, match="eyes must lie within"):
                occluder.visible(zo.SurfacePoints.free(np.ones((3, 3))), [[0, 0, size]])
        assert occluder.visible(zo.SurfacePoints.free(np.full((1, 3), 1e14)), [[0, 0, 4]]).all()


def test_names_in_errors_command_no_terminal() -> None:
    error = MeshError("\x1b[31mred\r\udcff\x07: it is bad\nsecond line")
    assert str(error) == "\\x1b[31mred\\r\\xff\\x07: it is bad\nsecond line"
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again)) == (MeshError, str(error))
    assert isinstance(again, OccludeError)
