"""The probe: facts about backends, learnt in child processes."""

import json

import pytest

from zbuf_occlude.cli.lists import backend_lines
from zbuf_occlude.engines.gl import probe as module
from zbuf_occlude.engines.gl.devices import FIXES, EglDevice, GlProblem
from zbuf_occlude.engines.gl.probe import LIMITS, Probe, probe, probe_all


@pytest.mark.gl
def test_all_backends_have_a_row_and_those_that_fail_a_reason() -> None:
    rows = probe_all()
    assert {row.backend for row in rows} == {"egl", "osmesa"}
    for row in rows:
        if row.works:
            assert row.renderer
            assert row.version
            assert set(row.limits) == set(LIMITS)
            assert row.limits["GL_MAX_COMPUTE_WORK_GROUP_INVOCATIONS"] >= 1024
            assert row.reason == ""
        else:
            assert row.reason


def test_a_missing_library_comes_with_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("GLCONTEXT_LINUX_LIBEGL", raising=False)
    monkeypatch.setattr(module, "_ask", lambda *_: {"works": False, "reason": f"no libEGL. Try: {FIXES['egl']}"})
    assert probe("egl").fix == FIXES["egl"]


def test_a_library_named_by_the_environment_is_not_to_be_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GLCONTEXT_LINUX_LIBEGL", "libEGL_is_not_here.so")
    found = probe("egl")
    assert not found.works
    # where there is no libGL either, that is what is said first
    assert "libEGL_is_not_here.so" in found.reason or "libGL.so.1" in found.reason
    assert found.fix == "unset GLCONTEXT_LINUX_LIBEGL"


def test_a_crash_is_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.executable", "/bin/false")
    assert probe("osmesa") == Probe("osmesa", None, works=False, reason="the process ended with exit code 1")


SOFTWARE = {"works": True, "renderer": "llvmpipe", "version": "4.5", "is_software": True, "limits": {}}
HARDWARE = {"works": True, "renderer": "NVIDIA H100", "version": "4.6", "is_software": False, "limits": {}}
DEAD = {"works": False, "reason": "eglInitialize failed"}


def test_a_hidden_nvidia_gpu_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = {
        "devices": {"devices": [{"index": 0, "cuda_device": None}]},
        "egl": SOFTWARE,
        "osmesa": {"works": False, "reason": "it is not there"},
    }
    monkeypatch.setattr(module, "_ask", lambda *arguments: json.loads(json.dumps(answers[arguments[0]])))
    monkeypatch.setattr(module, "find_gl_problem", lambda: GlProblem("it is hidden.", "show it"))
    egl, osmesa = probe_all()
    assert egl.works
    assert (egl.reason, egl.fix) == ("it is hidden.", "show it")
    assert backend_lines(egl)[-2:] == ["    it is hidden.", "    fix: show it"]
    assert osmesa.reason == "it is not there"


def test_workers_get_hardware_that_opens_in_the_order_of_cuda(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two NVIDIA GPUs, a render node of Mesa's for one of them that nobody can open, and llvmpipe."""
    listed = [
        EglDevice(0, 0, False, "GPU-aaaa"),
        EglDevice(1, 1, False, "GPU-bbbb"),
        EglDevice(2, None, False),
        EglDevice(3, None, True),
    ]
    tried = []

    def ask(backend: str, index: str) -> dict[str, object]:
        tried.append((backend, int(index)))
        return dict(DEAD if index == "2" else HARDWARE)

    monkeypatch.setattr(module, "egl_devices", lambda: tuple(listed))
    monkeypatch.setattr(module, "_ask", ask)
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    assert module.hardware_devices() == [0, 1]
    assert sorted(tried) == [("egl", 0), ("egl", 1), ("egl", 2)], "each in a child process, but for software"
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "1,0")
    assert module.hardware_devices() == [1, 0]
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    assert module.hardware_devices() == []
