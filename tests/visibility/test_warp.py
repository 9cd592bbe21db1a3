"""`warp` against the oracle: random scenes, awkward places, and the device it is asked for."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.random_scenes import CONTACTS, KINDS, wrong_answers_of, wrong_rays_of
from tests.scenes import box, row_in_a_plane, sphere, wrong

pytest.importorskip("warp", reason="Warp is not installed: pip install 'zbuf-occlude[warp]'")


@pytest.mark.parametrize("turn", range(len(CONTACTS)))
def test_random_scenes(turn: int) -> None:
    """Each kind of scene once at each contact tolerance: their numbers have no common divisor."""
    for index in range(turn, len(KINDS) * len(CONTACTS), len(CONTACTS)):
        assert wrong_answers_of("warp", 2, index, CONTACTS[turn])[0] == 0, f"scene {index}"


def test_random_rays() -> None:
    for index in range(len(KINDS)):
        assert wrong_rays_of("warp", 2, index)[0] == 0, f"scene {index}"


@pytest.mark.parametrize("seed", range(5))
def test_no_face_hides_what_is_seen_past_it_in_its_own_plane(seed: int) -> None:
    mesh, points, eyes = row_in_a_plane(seed)
    with zo.prepare(mesh, "warp") as occluder:
        assert occluder.visible(points, eyes).all()


def test_far_points_and_far_eyes() -> None:
    """Points up to 10^4 radii outside, some beyond where all faces are asked; eyes up to 10^7 away."""
    ball, rng = sphere(12), np.random.default_rng(0)
    far = rng.normal(size=(600, 3)) * 10.0 ** rng.uniform(-1, 4, (600, 1))
    eyes = rng.normal(size=(8, 3)) * 10.0 ** np.arange(8)[:, None]
    for points in (zo.SurfacePoints.free(far), zo.sample_surface(ball, n_points=600, seed=0)):
        with zo.prepare(ball, "warp") as occluder:
            found = occluder.visible(points, eyes)
        assert 0.1 < found.mean() < 0.9
        assert wrong(ball, found, points, eyes) == 0


def test_the_device() -> None:
    with zo.prepare(box(), "warp", device="cpu") as occluder:
        assert occluder.first_hits([[0, 0, 9.0]], [[0, 0, -1.0]]).distances.item() == 8.5
    with pytest.raises(zo.OptionError, match=r"device must be auto, or one that Warp finds here, cpu.*got 'cuda:99'"):
        zo.prepare(box(), "warp", device="cuda:99")


def test_warp_prints_nothing() -> None:
    program = (
        "import zbuf_occlude as zo; mesh = zo.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])\n"
        "assert zo.prepare(mesh, 'warp').visible(zo.SurfacePoints.free([[0.2, 0.2, -1]]), [0.2, 0.2, 1]) == [False]"
    )
    child = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (child.returncode, child.stdout) == (0, ""), child.stderr


def test_the_source_compiles_for_cuda_and_contracts_no_product(tmp_path: Path) -> None:
    """No device is needed to compile. A product fused with a sum would let edges that two faces share leak."""
    import warp

    from zbuf_occlude.engines.warp import kernels

    warp.compile_aot_module(kernels, arch=75, module_dir=tmp_path, use_ptx=True)
    (path,) = tmp_path.glob("*.ptx")
    code = path.read_bytes()
    assert all(name in code for name in (b"fill_boxes", b"fill_visible", b"fill_first_hits"))
    assert code.count(b"mul.rn.f64") > 50, "rounded on its own"
    assert b"mul.f64" not in code
    assert b"fma.rn.f64" not in code
