"""Which EGL devices CUDA_VISIBLE_DEVICES leaves, and what keeps OpenGL from an NVIDIA GPU."""

from pathlib import Path

import pytest

from zbuf_occlude.engines.gl import devices
from zbuf_occlude.engines.gl.devices import ICD, EglDevice, find_gl_problem, left_by_cuda

LIBRARIES = "usr/lib/x86_64-linux-gnu"
WHOLE = (
    "dev/nvidiactl",
    f"{LIBRARIES}/libEGL_nvidia.so.0",
    f"{LIBRARIES}/libEGL.so.1",
    f"{LIBRARIES}/libGLdispatch.so.0",
    "usr/share/glvnd/egl_vendor.d/10_nvidia.json",
)


def machine(root: Path, *files: str) -> Path:
    for file in files:
        (root / file).parent.mkdir(parents=True, exist_ok=True)
        (root / file).touch()
    return root


def test_nothing_is_missing_and_no_gpu_no_hindrance(tmp_path: Path) -> None:
    assert (
        find_gl_problem(machine(tmp_path / "gpu", *WHOLE, "proc/driver/nvidia/capabilities/gpu0/mig/config"), {})
        is None
    )
    assert find_gl_problem(machine(tmp_path / "none", *WHOLE[1:3]), {}) is None


@pytest.mark.parametrize(
    ("missing", "cause", "fix"),
    [
        ("libEGL_nvidia.so.0", "the driver's libEGL_nvidia is missing", "NVIDIA_DRIVER_CAPABILITIES=graphics"),
        ("libEGL.so.1", "glvnd's libEGL, which finds drivers, is missing", "apt-get install libegl1"),
        ("libGLdispatch.so.0", "glvnd's libEGL, which finds drivers, is missing", "apt-get install libegl1"),
        ("10_nvidia.json", "no ICD file", ICD),
    ],
)
def test_each_missing_file_is_told_apart(missing: str, cause: str, fix: str, tmp_path: Path) -> None:
    found = find_gl_problem(machine(tmp_path, *(file for file in WHOLE if not file.endswith(missing))), {})
    assert found is not None
    assert cause in found.cause
    assert fix in found.fix


def test_a_gpu_cut_into_instances_has_no_graphics(tmp_path: Path) -> None:
    whole = machine(tmp_path, *WHOLE)
    found = find_gl_problem(whole, {"CUDA_VISIBLE_DEVICES": "MIG-5d1f"})
    assert found is not None
    assert "MIG" in found.cause
    assert "--method exact" in found.fix
    assert find_gl_problem(machine(tmp_path, "proc/driver/nvidia/capabilities/gpu0/mig/gi1/access"), {}) == found


@pytest.mark.parametrize(
    ("visible", "left"),
    [
        (None, [0, 1, 2]),
        ("", [2]),
        ("-1", [2]),
        ("1", [1, 2]),
        ("1,0", [1, 0, 2]),
        ("0,7,1", [0, 2]),  # what follows an unknown one is not seen, as with CUDA
        ("GPU-bbbb-1", [1, 2]),
        ("GPU-b, GPU-a", [1, 0, 2]),
        ("GPU-", [2]),  # of which of the two?
        ("MIG-aaaa", [2]),
    ],
)
def test_cuda_visible_devices_chooses(visible: str | None, left: list[int]) -> None:
    listed = (
        EglDevice(0, 0, False, "GPU-aaaa-0"),
        EglDevice(1, 1, False, "GPU-bbbb-1"),
        EglDevice(2, None, True),
    )
    assert [device.index for device in left_by_cuda(listed, visible)] == left


def test_without_a_word_the_first_that_cuda_sees_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    swapped = (EglDevice(0, 1, False), EglDevice(1, 0, False), EglDevice(2, None, True))
    monkeypatch.setattr(devices, "egl_devices", lambda: swapped)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "0")
    assert devices.default_device() == 1
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    assert devices.default_device() == 2
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES")
    assert devices.default_device() == 0
