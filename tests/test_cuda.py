"""The CUDA kernel's source, compiled as C++, against the oracle. No GPU is asked."""

import ctypes
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.random_scenes import scene
from tests.scenes import sphere
from zbuf_occlude.cuda.mesh_tree import LEAF, PARAMETERS, MeshTree
from zbuf_occlude.visibility.interface import CONTACT

SOURCE = Path(zo.__file__).parent / "cuda" / "visible.cu"
Visible = Callable[..., np.ndarray]


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> Visible:
    """The kernel as a function of this process."""
    compiler = next(filter(shutil.which, filter(None, (os.environ.get("CXX"), "g++", "clang++", "c++"))), None)
    if compiler is None:
        pytest.skip("the kernel's twin needs a C++ compiler; install g++")
    library = tmp_path_factory.mktemp("twin") / "visible.so"
    flags = ["-std=c++17", "-O2", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run([compiler, *flags, "-x", "c++", SOURCE, "-o", library], check=True)
    compiled = ctypes.CDLL(str(library)).visible
    compiled.restype = None

    def visible(mesh: zo.Mesh, points: zo.SurfacePoints, eyes: np.ndarray, tree: MeshTree | None = None) -> np.ndarray:
        tree = tree or MeshTree.of(mesh)
        parameters = tree.parameters(len(points), len(eyes), CONTACT * mesh.diagonal)
        mask = np.zeros((len(eyes), len(points)), dtype=bool)
        own, eyes = tree.own_places(points.face_ids), np.ascontiguousarray(eyes, dtype=np.float64)
        before = [np.atleast_1d(parameters), tree.boxes, np.ascontiguousarray(tree.corners)]
        after = [points.positions, own, eyes, mask]
        addresses = [[ctypes.c_void_p(array.ctypes.data) for array in arrays] for arrays in (before, after)]
        compiled(*addresses[0], ctypes.c_int(len(tree.corners)), *addresses[1])
        return mask

    return visible


def truth(mesh: zo.Mesh, points: zo.SurfacePoints, eyes: np.ndarray) -> np.ndarray:
    with zo.prepare(mesh, "oracle") as oracle:
        return oracle.visible(points, eyes)


@pytest.mark.parametrize("index", [*range(12), 46, 98, 280])  # the last: lines in faces' planes
def test_random_scenes(twin: Visible, index: int) -> None:
    """Slivers, duplicates, coplanar sheets, eyes in planes and near edges."""
    mesh, points, eyes, kind = scene(31, index)
    with zo.prepare(mesh, "oracle") as oracle:
        differs = twin(mesh, points, eyes) & ~oracle.visible(points, eyes)
        assert ((twin(mesh, points, eyes) ^ differs) == oracle.visible(points, eyes)).all(), (
            "brute force alone hides more"
        )
        assert not differs.any() or not (differs & oracle.decided(points, eyes)).any(), kind
    assert differs.mean() < 0.01, kind


@pytest.mark.parametrize("scale", [1e-30, 1e-3, 1.0, 1e30])
def test_sizes_and_places(twin: Visible, scale: float) -> None:
    """Far eyes, far points, eyes within, free points; of any size."""
    mesh = sphere(12)
    mesh = zo.Mesh(mesh.vertices * scale + 3 * scale, mesh.faces)
    points, rng = zo.sample_surface(mesh, n_points=300, seed=1), np.random.default_rng(2)
    free = mesh.centre + scale * rng.normal(size=(300, 3)) * 10.0 ** rng.uniform(-2, 6, (300, 1))
    eyes = mesh.centre + scale * rng.normal(size=(8, 3)) * 10.0 ** np.arange(-2, 6)[:, None]
    for asked in (points, zo.SurfacePoints.free(free)):
        expected = truth(mesh, asked, eyes)
        assert (twin(mesh, asked, eyes) == expected).all()
        assert 0.02 < expected.mean() < 0.98


def test_faces_of_boxes_that_no_line_meets_are_left_out(twin: Visible) -> None:
    """If all faces were tested, the tree would be of no use, and its boxes untested."""
    mesh = sphere(12)
    points, eyes = zo.sample_surface(mesh, n_points=200, seed=1), np.array([[4.0, 1.0, 2.0]])
    tree = MeshTree.of(mesh)
    assert not twin(mesh, points, eyes, tree).all()
    tree.boxes[: tree.level_size[0]] += 100.0
    assert twin(mesh, points, eyes, tree).all()


@pytest.mark.parametrize("n_faces", [1, LEAF, LEAF + 1, 4 * LEAF, 4 * LEAF + 1, 1000])
def test_every_face_is_in_a_box_at_every_level(n_faces: int) -> None:
    corners = np.random.default_rng(n_faces).normal(size=(n_faces, 3, 3))
    mesh = zo.Mesh(corners.reshape(-1, 3), np.arange(3 * n_faces).reshape(-1, 3))
    tree = MeshTree.of(mesh)
    assert (tree.corners[tree.places] == mesh.corners).all()
    local = (tree.corners - tree.centre) * tree.scale
    assert tree.level_size[-1] == 1
    for level, (start, size) in enumerate(zip(tree.level_start, tree.level_size, strict=True)):
        boxes = tree.boxes[start + np.arange(n_faces) // (LEAF * 4**level)]
        assert size == -(-n_faces // (LEAF * 4**level))
        assert (boxes[:, None, :3] < local).all()
        assert (local < boxes[:, None, 3:]).all()


def test_parameters_lie_as_the_kernel_has_them() -> None:
    """A C++ compiler pads nothing here: doubles and long longs first, then an even number of ints."""
    assert PARAMETERS.itemsize == 7 * 8 + 4 * 4 + 2 * 32 * 4
    assert PARAMETERS.fields is not None
    assert PARAMETERS.fields["n_levels"][1] == 7 * 8


def test_nvcc_compiles_it(tmp_path: Path) -> None:
    compiler = shutil.which("nvcc")
    if compiler is None:
        pytest.skip("no CUDA device here, and no nvcc")
    out = tmp_path / "visible.ptx"
    subprocess.run([compiler, "-ptx", "-fmad=false", "-std=c++17", SOURCE, "-o", out], check=True)
    text = out.read_text()
    assert ".visible .entry visible(" in text
    assert "fma.rn.f64" not in text, "contracted: cross(b, a) is not the exact negative of cross(a, b) any more"
