"""`--method auto`: what it chooses for which sizes and machines, and that the reason reaches the recipe."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from zbuf_occlude import Mesh, MeshCollection, OptionError, shapes
from zbuf_occlude.dataset import auto
from zbuf_occlude.dataset.auto import AUTO, FEW_POINTS, MANY_FACES, choose_exact, resolve
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.gl import devices
from zbuf_occlude.gl.context import GlContext


@pytest.mark.parametrize(
    ("n_faces", "n_points", "gain", "embree", "method"),
    [
        (3000, 20_000, 2.5, True, "exact_gl"),
        (3000, 20_000, 0.7, True, "exact"),
        (3000, 20_000, 0.0, True, "exact"),
        (MANY_FACES, FEW_POINTS, 0.0, True, "embree"),
        (MANY_FACES, FEW_POINTS, 0.0, False, "exact"),
        (MANY_FACES, FEW_POINTS + 1, 0.0, True, "exact"),
        (MANY_FACES - 1, FEW_POINTS, 0.0, True, "exact"),
    ],
)
def test_choices(n_faces: int, n_points: int, gain: float, embree: bool, method: str) -> None:
    choice = choose_exact(n_faces, n_points, gain=gain, embree=embree)
    assert choice.method == method
    assert ("GPU here" in choice.reason) == (gain > 0.0)
    if gain:
        assert f"{gain} times as fast" in choice.reason
    else:
        assert f"{n_points:,} points" in choice.reason
        assert f"{n_faces:,} faces" in choice.reason


def test_a_named_method_stays() -> None:
    recipe = Recipe(method="oracle")
    assert resolve(recipe, shapes.collection()) is recipe


def test_the_reason_names_the_sizes_it_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(auto, "gain_on_gpu", lambda *_: 0.0)
    meshes = shapes.collection().limit(1)
    n_faces = len(meshes[0].load().faces)
    found = resolve(Recipe(method=AUTO, n_points=1234), meshes)
    assert found == replace(Recipe(n_points=1234), method="exact", reason=found.reason)
    assert f"1,234 points on meshes of about {n_faces:,} faces" in found.reason


def test_a_density_counts_points_by_area(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(auto, "gain_on_gpu", lambda *_: 0.0)
    square = Mesh(5.0 * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    lines = ["OFF", "4 2 0", *(" ".join(map(str, v)) for v in square.vertices), "3 0 1 2", "3 0 2 3"]
    (tmp_path / "square.off").write_text("\n".join(lines))
    (tmp_path / "broken.off").write_text("OFF\n")
    found = resolve(Recipe(method=AUTO, n_points=None, density=700.0), MeshCollection.from_paths([tmp_path]))
    assert "700 points on meshes of about 2 faces" in found.reason


def test_large_files_are_not_loaded_and_broken_ones_do_not_count(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(auto, "gain_on_gpu", lambda *_: 0.0)
    monkeypatch.setattr(auto, "LARGE", 1000)
    (tmp_path / "large.off").write_text("OFF\n" + "x" * 4000)  # loading it would fail
    found = resolve(Recipe(method=AUTO, n_points=500), MeshCollection.from_paths([tmp_path]))
    assert "500 points on meshes of about 100 faces" in found.reason
    monkeypatch.setattr(auto, "LARGE", 10_000)
    found = resolve(Recipe(method=AUTO, n_points=500), MeshCollection.from_paths([tmp_path]))
    assert (found.method, "no mesh could be loaded" in found.reason) == ("exact", True)


def test_a_named_method_resumes_what_auto_began(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(auto, "gain_on_gpu", lambda *_: 0.0)
    meshes = shapes.collection().limit(1)
    chosen = Plan(meshes, resolve(Recipe(method=AUTO), meshes))
    assert chosen.recipe.reason
    assert chosen.fingerprint == Plan(meshes, Recipe(method="exact")).fingerprint
    assert chosen.fingerprint != Plan(meshes, Recipe(method="oracle")).fingerprint


def test_options_need_a_named_method() -> None:
    with pytest.raises(OptionError, match="--set needs a named method; got --method auto"):
        resolve(Recipe(method=AUTO, method_options={"contact": 1e-6}), shapes.collection())


def test_without_a_gpu_nothing_is_tried(gl: GlContext) -> None:
    if not gl.is_software:
        pytest.skip("this machine may have a GPU")
    assert auto.gain_on_gpu(Recipe(n_points=10), shapes.collection().limit(1)) == 0.0


def test_on_a_gpu_both_are_asked(monkeypatch: pytest.MonkeyPatch, gl: GlContext) -> None:
    """Taken for hardware, a software renderer is compared with `exact` too: some ratio comes of it."""
    monkeypatch.setattr(GlContext, "is_software", False)
    meshes = shapes.collection().limit(3)
    gain = auto.gain_on_gpu(Recipe(n_points=300), meshes)
    assert 0.0 < gain < 1000.0


def test_software_beside_an_nvidia_gpu_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "nvidiactl").touch()
    monkeypatch.setattr(devices, "hindrance", lambda: devices.Hindrance("it is hidden.", "show it"))
    assert devices.fallen_to_software("llvmpipe (LLVM 15)") == ""
    monkeypatch.setattr(devices, "NVIDIA", tmp_path / "nvidiactl")
    assert devices.fallen_to_software("NVIDIA H100") == ""
    said = devices.fallen_to_software("llvmpipe (LLVM 15)")
    assert said == (
        "OpenGL runs in software (llvmpipe (LLVM 15)), though /dev/nvidiactl is there: it is hidden. Fix: show it"
    )
