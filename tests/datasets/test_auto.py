"""`--method auto`: what it chooses on which machines, and that the reason reaches the config."""

from dataclasses import replace
from pathlib import Path

import pytest

from zbuf_occlude import MeshCollection, OptionError
from zbuf_occlude.datasets import auto
from zbuf_occlude.datasets.auto import AUTO, resolve
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.engines.gl import devices
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.meshes import shapes


@pytest.mark.parametrize(("gain", "method"), [(2.5, "exact_gl"), (0.7, "exact"), (0.0, "exact")])
def test_choices(gain: float, method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(auto, "gain_on_gpu", lambda *_: gain)
    found = resolve(DatasetConfig(method=AUTO, n_points=1234), shapes.collection().limit(1))
    assert found == replace(DatasetConfig(n_points=1234), method=method, reason=found.reason)
    assert (f"{gain} times as fast" if gain else "no GPU") in found.reason


def test_a_named_method_stays() -> None:
    config = DatasetConfig(method="oracle")
    assert resolve(config, shapes.collection()) is config


def test_a_named_method_resumes_what_auto_began(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(auto, "gain_on_gpu", lambda *_: 0.0)
    meshes = shapes.collection().limit(1)
    chosen = Plan(meshes, resolve(DatasetConfig(method=AUTO), meshes))
    assert chosen.config.reason
    assert chosen.fingerprint == Plan(meshes, DatasetConfig(method="exact")).fingerprint
    assert chosen.fingerprint != Plan(meshes, DatasetConfig(method="oracle")).fingerprint


def test_options_need_a_named_method() -> None:
    with pytest.raises(OptionError, match="--set needs a named method; got --method auto"):
        resolve(DatasetConfig(method=AUTO, method_options={"contact": 1e-6}), shapes.collection())


def test_without_a_gpu_nothing_is_tried(gl: GlContext) -> None:
    if not gl.is_software:
        pytest.skip("this machine may have a GPU")
    assert auto.gain_on_gpu(DatasetConfig(n_points=10), shapes.collection().limit(1)) == 0.0


def test_on_a_gpu_both_are_asked(monkeypatch: pytest.MonkeyPatch, gl: GlContext, tmp_path: Path) -> None:
    """Taken for hardware, a software renderer is compared with `exact` too: some ratio comes of it."""
    monkeypatch.setattr(GlContext, "is_software", False)
    meshes = shapes.collection().limit(3)
    gain = auto.gain_on_gpu(DatasetConfig(n_points=300), meshes)
    assert 0.0 < gain < 1000.0
    (tmp_path / "large.off").write_text("OFF\n" + "x" * 4000)  # loading it would fail
    (tmp_path / "broken.off").write_text("OFF\n")
    monkeypatch.setattr(auto, "LARGE", 1000)
    assert auto.gain_on_gpu(DatasetConfig(n_points=300), MeshCollection.from_paths([tmp_path])) == 0.0


def test_software_beside_an_nvidia_gpu_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "nvidiactl").touch()
    monkeypatch.setattr(devices, "find_gl_problem", lambda: devices.GlProblem("it is hidden.", "show it"))
    assert devices.explain_software_fallback("llvmpipe (LLVM 15)") == ""
    monkeypatch.setattr(devices, "NVIDIA", tmp_path / "nvidiactl")
    assert devices.explain_software_fallback("NVIDIA H100") == ""
    said = devices.explain_software_fallback("llvmpipe (LLVM 15)")
    assert said == (
        "OpenGL runs in software (llvmpipe (LLVM 15)), although /dev/nvidiactl exists: it is hidden. Fix: show it"
    )
