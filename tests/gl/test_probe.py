"""The probe: facts about backends, learnt in child processes."""

import json

import pytest

from zbuf_occlude.gl import probe as module
from zbuf_occlude.gl.context import FIXES, egl_fix
from zbuf_occlude.gl.probe import LIMITS, Probe, probe, probe_all


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
    assert probe("egl").fix == FIXES["egl"] == egl_fix()


def test_a_library_named_by_the_environment_is_not_to_be_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GLCONTEXT_LINUX_LIBEGL", "libEGL_is_not_here.so")
    found = probe("egl")
    assert not found.works
    assert "libEGL_is_not_here.so" in found.reason
    assert found.fix == "unset GLCONTEXT_LINUX_LIBEGL"


def test_a_crash_is_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.sys, "executable", "/bin/false")
    assert probe("osmesa") == Probe("osmesa", None, works=False, reason="the process ended with code 1: no message")


def test_a_hidden_nvidia_gpu_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = {
        "devices": {"devices": [{"index": 0, "cuda_device": None}]},
        "egl": {"works": True, "renderer": "llvmpipe", "version": "4.5", "is_software": True, "limits": {}},
        "osmesa": {"works": False, "reason": "it is not there"},
    }
    monkeypatch.setattr(module, "_ask", lambda *arguments: json.loads(json.dumps(answers[arguments[0]])))
    monkeypatch.setattr(module.Path, "exists", lambda self: str(self) == "/dev/nvidiactl")
    egl, osmesa = probe_all()
    assert egl.works
    assert "NVIDIA_DRIVER_CAPABILITIES" in egl.fix
    assert osmesa.reason == "it is not there"
