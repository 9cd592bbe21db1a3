"""What keeps OpenGL from an NVIDIA GPU: each cause in a file system that has it."""

from pathlib import Path

import pytest

from zbuf_occlude.gl.nvidia import ICD, hindrance

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


def test_nothing_is_missing(tmp_path: Path) -> None:
    assert hindrance(machine(tmp_path, *WHOLE), {}) is None


def test_no_gpu_no_hindrance(tmp_path: Path) -> None:
    assert hindrance(machine(tmp_path, *WHOLE[1:3]), {}) is None


@pytest.mark.parametrize(
    ("missing", "cause", "fix"),
    [
        ("libEGL_nvidia.so.0", "not the driver's libEGL_nvidia", "NVIDIA_DRIVER_CAPABILITIES=graphics"),
        ("libEGL.so.1", "not glvnd's libEGL", "apt-get install libegl1"),
        ("libGLdispatch.so.0", "not glvnd's libEGL", "apt-get install libegl1"),
        ("10_nvidia.json", "no ICD file", ICD),
    ],
)
def test_each_missing_file_is_told_apart(missing: str, cause: str, fix: str, tmp_path: Path) -> None:
    found = hindrance(machine(tmp_path, *(file for file in WHOLE if not file.endswith(missing))), {})
    assert found is not None
    assert cause in found.cause
    assert fix in found.fix


def test_a_gpu_cut_into_instances_has_no_graphics(tmp_path: Path) -> None:
    whole = machine(tmp_path, *WHOLE)
    found = hindrance(whole, {"CUDA_VISIBLE_DEVICES": "MIG-5d1f"})
    assert found is not None
    assert "MIG" in found.cause
    assert "--method exact" in found.fix
    assert hindrance(machine(tmp_path, "proc/driver/nvidia/capabilities/gpu0/mig/gi1/access"), {}) == found


def test_capabilities_of_a_gpu_that_is_not_cut_mean_nothing(tmp_path: Path) -> None:
    assert hindrance(machine(tmp_path, *WHOLE, "proc/driver/nvidia/capabilities/gpu0/mig/config"), {}) is None
