"""`--method auto`: what it chooses for which sizes and machines, and that the reason reaches the recipe."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from zbuf_occlude import Mesh, MeshCollection, OptionError, shapes
from zbuf_occlude.dataset import auto, trial
from zbuf_occlude.dataset.auto import AUTO, FEW_POINTS, MANY_FACES, choose, resolve
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.trial import Trial
from zbuf_occlude.errors import GlError
from zbuf_occlude.farm import local
from zbuf_occlude.gl import nvidia
from zbuf_occlude.limits import GivenUp, Limits


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
    choice = choose(n_faces, n_points, gain=gain, embree=embree)
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
    monkeypatch.setattr(auto, "_has_gpu", lambda: False)
    meshes = shapes.collection().limit(1)
    n_faces = len(meshes[0].load().faces)
    found = resolve(Recipe(method=AUTO, n_points=1234), meshes)
    assert found == replace(Recipe(n_points=1234), method="exact", reason=found.reason)
    assert f"1,234 points on meshes of about {n_faces:,} faces" in found.reason


def test_a_density_counts_points_by_area(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(auto, "_has_gpu", lambda: False)
    square = Mesh(5.0 * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    lines = ["OFF", "4 2 0", *(" ".join(map(str, v)) for v in square.vertices), "3 0 1 2", "3 0 2 3"]
    (tmp_path / "square.off").write_text("\n".join(lines))
    (tmp_path / "broken.off").write_text("OFF\n")
    found = resolve(Recipe(method=AUTO, n_points=None, density=700.0), MeshCollection.from_paths([tmp_path]))
    assert "700 points on meshes of about 2 faces" in found.reason


def test_large_files_are_not_loaded_and_broken_ones_do_not_count(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(auto, "_has_gpu", lambda: False)
    monkeypatch.setattr(auto, "LARGE", 1000)
    (tmp_path / "large.off").write_text("OFF\n" + "x" * 4000)  # loading it would fail
    found = resolve(Recipe(method=AUTO, n_points=500), MeshCollection.from_paths([tmp_path]))
    assert "500 points on meshes of about 100 faces" in found.reason
    monkeypatch.setattr(auto, "LARGE", 10_000)
    found = resolve(Recipe(method=AUTO, n_points=500), MeshCollection.from_paths([tmp_path]))
    assert (found.method, "no mesh could be loaded" in found.reason) == ("exact", True)


def test_a_named_method_resumes_what_auto_began(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(auto, "_has_gpu", lambda: False)
    meshes = shapes.collection().limit(1)
    chosen = Plan(meshes, resolve(Recipe(method=AUTO), meshes))
    assert chosen.recipe.reason
    assert chosen.fingerprint == Plan(meshes, Recipe(method="exact")).fingerprint
    assert chosen.fingerprint != Plan(meshes, Recipe(method="oracle")).fingerprint


def test_options_need_a_named_method() -> None:
    with pytest.raises(OptionError, match="--set needs a named method; got --method auto"):
        resolve(Recipe(method=AUTO, method_options={"contact": 1e-6}), shapes.collection())


def test_on_a_gpu_both_are_tried_on_a_mesh_of_middling_size(monkeypatch: pytest.MonkeyPatch) -> None:
    now, tried = [0.0], []

    def make(plan: Plan, mesh_id: int, gl: object, store: object) -> None:
        now[0] += {"exact": 3.0, "exact_gl": 1.0}[plan.recipe.method]
        tried.append((plan.recipe.method, plan.recipe.n_points, len(plan.meshes[mesh_id].load().faces)))

    monkeypatch.setattr(auto, "_has_gpu", lambda: True)
    monkeypatch.setattr(Trial, "needs_gl", False)
    monkeypatch.setattr(trial, "make_mesh", make)
    monkeypatch.setattr(trial, "time", SimpleNamespace(perf_counter=lambda: now[0]))
    meshes = shapes.collection().limit(3)
    sizes = sorted(len(entry.load().faces) for entry in meshes)
    found = resolve(Recipe(method=AUTO, n_points=321), meshes)
    assert (found.method, "3.0 times as fast" in found.reason) == ("exact_gl", True)
    assert tried == [
        (method, n, size) for method in ("exact", "exact_gl") for n, size in ((100, sizes[0]), (321, sizes[1]))
    ]


def test_a_trial_compares_what_a_mesh_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that only making moves: 30 ms with one method, 120 with the other and its option, 10 s to compile."""
    now, made = [0.0], []

    def make(plan: Plan, mesh_id: int, gl: object, store: object) -> None:
        now[0] += 10.0 if not made else {"exact": 0.03, "oracle": 0.12}[plan.recipe.method]
        made.append((plan.recipe.method, plan.recipe.method_options))

    monkeypatch.setattr(trial, "time", SimpleNamespace(perf_counter=lambda: now[0]))
    monkeypatch.setattr(trial, "make_mesh", make)
    recipe = Recipe(method="oracle", method_options={"contact": 1e-6}, density=900.0, n_points=None)
    found = auto.gain_of("exact", "oracle", recipe, shapes.collection().limit(1))
    assert found == pytest.approx(4.0)
    assert made == [*[("oracle", {"contact": 1e-6})] * 2, *[("exact", {})] * 3]


def test_a_worker_tries_real_meshes() -> None:
    run = partial(local.run_jobs, n_workers=1, limits=Limits())
    recipe = Recipe(method="oracle", n_points=300)
    assert auto.gain_of("exact", "oracle", recipe, shapes.collection().limit(2), run) > 0.0


def test_a_trial_that_workers_died_of_is_left() -> None:
    """A supervisor knows of a mesh that it is told of, and tells the next worker when it gives that up."""
    told: list[int | None] = []
    one = Trial("exact", "oracle", Recipe(n_points=10), shapes.collection().limit(1), (0,))
    assert one.do(0, None, {0: GivenUp("it hung", Limits())}, told.append) == 0.0
    assert not told
    assert one.do(0, None, on_mesh=told.append) > 0.0
    assert told == [0]


def test_what_cannot_be_tried_has_no_gain(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def fail(*_: object) -> float:
        raise GlError("no GPU")

    monkeypatch.setattr(trial, "make_mesh", fail)
    meshes = shapes.collection().limit(1)
    assert auto.gain_of("exact", "oracle", Recipe(n_points=10), meshes) == 0.0
    (tmp_path / "broken.off").write_text("OFF\n")
    meshes = MeshCollection.from_paths([tmp_path])
    assert Trial("exact", "oracle", Recipe(n_points=10), meshes, (0,)).do(0, None) == 0.0


def test_software_beside_an_nvidia_gpu_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "nvidiactl").touch()
    monkeypatch.setattr(nvidia, "hindrance", lambda: nvidia.Hindrance("it is hidden.", "show it"))
    assert nvidia.fallen_to_software("llvmpipe (LLVM 15)") == ""
    monkeypatch.setattr(nvidia, "NVIDIA", tmp_path / "nvidiactl")
    assert nvidia.fallen_to_software("NVIDIA H100") == ""
    said = nvidia.fallen_to_software("llvmpipe (LLVM 15)")
    assert said == (
        "OpenGL runs in software (llvmpipe (LLVM 15)), though /dev/nvidiactl is there: it is hidden. Fix: show it"
    )
