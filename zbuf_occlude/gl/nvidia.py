"""What keeps OpenGL from an NVIDIA GPU that is there: four causes, each with what would help, by looking at files."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from zbuf_occlude.gl.context import is_software

NVIDIA = Path("/dev/nvidiactl")
"""There where a driver for NVIDIA's GPUs is."""

LIBRARIES = ("usr/lib/x86_64-linux-gnu", "usr/lib/aarch64-linux-gnu", "usr/lib64", "usr/lib", "usr/local/lib", "lib64")
VENDORS = ("etc/glvnd/egl_vendor.d", "usr/share/glvnd/egl_vendor.d")
"""Where the dynamic loader, and glvnd, look."""

ICD = '{"file_format_version": "1.0.0", "ICD": {"library_path": "libEGL_nvidia.so.0"}}'


class Hindrance(NamedTuple):
    """Why there is no OpenGL on the GPU, in a sentence, and the one thing to do."""

    cause: str
    fix: str


def hindrance(root: Path = Path("/"), environment: Mapping[str, str] | None = None) -> Hindrance | None:
    """Say what keeps OpenGL from an NVIDIA GPU; None where there is none, or nothing is seen to be missing.

    Parameters
    ----------
    root : Path
        Of the file system to look at.
    environment : mapping, optional
        By default this process's.
    """
    if not (root / "dev/nvidiactl").exists():
        return None
    environment = os.environ if environment is None else environment
    named = ",".join(environment.get(name, "") for name in ("CUDA_VISIBLE_DEVICES", "NVIDIA_VISIBLE_DEVICES"))
    if "MIG-" in named or any((root / "proc/driver/nvidia/capabilities").glob("gpu*/mig/gi*")):
        return Hindrance(
            "the NVIDIA GPU is cut into MIG instances, which have no graphics.",
            "run on a GPU that is not cut, or take --method exact",
        )
    if not _library(root, "libEGL_nvidia.so"):
        return Hindrance(
            "there is an NVIDIA GPU, but not the driver's libEGL_nvidia.",
            "start the container with -e NVIDIA_DRIVER_CAPABILITIES=graphics,compute,utility "
            "(outside one: install the driver's libnvidia-gl package)",
        )
    if not (_library(root, "libEGL.so.1") and _library(root, "libGLdispatch.so.0")):
        return Hindrance(
            "there is an NVIDIA GPU and its driver, but not glvnd's libEGL, which finds drivers.",
            "apt-get install libegl1",
        )
    if not any(file for folder in VENDORS for file in (root / folder).glob("*nvidia*.json")):
        return Hindrance(
            "there is an NVIDIA GPU and its driver, but no ICD file that names it to glvnd.",
            f"echo '{ICD}' > /usr/share/glvnd/egl_vendor.d/10_nvidia.json",
        )
    return None


def _library(root: Path, name: str) -> bool:
    return any(any((root / folder).glob(f"{name}*")) for folder in LIBRARIES)


def fallen_to_software(renderer: str) -> str:
    """Say that a GL_RENDERER is software though there is an NVIDIA GPU, and why; "" where that is not so."""
    if not is_software(renderer) or not NVIDIA.exists():
        return ""
    found = hindrance() or Hindrance("nothing is seen to be missing.", "ask `zbuf-occlude doctor`")
    return f"OpenGL runs in software ({renderer}), though /dev/nvidiactl is there: {found.cause} Fix: {found.fix}"
