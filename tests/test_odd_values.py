"""Odd values at the public border: what is valid is understood, what is not is one clear error, never a traceback."""

import pickle
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from trimesh.creation import box

import zbuf_occlude as zo
from zbuf_occlude.errors import ArgumentError, MeshError, OccludeError, OptionError
from zbuf_occlude.limits import Limits

CUBE = zo.Mesh.from_trimesh(box())
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


@pytest.mark.usefixtures("free_alarm")
def test_a_mesh_that_takes_too_long_or_too_much_is_an_error() -> None:
    for limits, said in (
        (Limits(seconds=0.1), r"timed out after 0\.1 s"),
        (Limits(gigabytes=1e-3), r"exceeded 0\.001 GB of memory"),
    ):
        with pytest.raises(MeshError, match=said), limits.watch():
            threading.Event().wait(20)
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
        (lambda: zo.views.random(3, elevation=(1.0, 0.0)), r"elevations must run upwards within -90\.\.90 degrees"),
        (lambda: zo.views.parse(None), "views must be paper100, .*; got None"),
        (lambda: zo.load_mesh(box()), "path must be a path; got Trimesh"),
        (lambda: zo.prepare(zo.SurfacePoints.free(np.zeros((0, 3))), "hidden_point_removal"), "must have points|needs"),
    ],
)
def test_what_is_no_argument_is_one_clear_error(call: Callable[[], object], said: str) -> None:
    with pytest.raises(OccludeError, match=said):
        call()


@pytest.mark.parametrize("seed", [-1, "a", 1.5])
def test_a_seed_that_is_none(seed: object) -> None:
    for draw in (
        lambda: zo.sample_surface(CUBE, n_points=3, seed=seed),  # type: ignore[arg-type]
        lambda: zo.views.parse("random:4", seed=seed),  # type: ignore[arg-type]
    ):
        with pytest.raises(OptionError, match="seed must be an int of at least 0"):
            draw()


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
