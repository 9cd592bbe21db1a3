"""EGL devices, their selection by CUDA_VISIBLE_DEVICES, and diagnosis of missing OpenGL on NVIDIA GPUs."""

import ctypes
import os
from collections.abc import Mapping, Sequence
from ctypes.util import find_library
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from uuid import UUID

from zbuf_occlude.base.errors import GlError

# EGL_EXT_device_query, EGL_NV_device_cuda, EGL_EXT_device_persistent_id
_EXTENSIONS, _CUDA_DEVICE, _DEVICE_UUID = 0x3055, 0x323A, 0x335C
_MAX_DEVICES = 64
_NAMES = (b"eglQueryDevicesEXT", b"eglQueryDeviceAttribEXT", b"eglQueryDeviceStringEXT", b"eglQueryDeviceBinaryEXT")

FIXES = {
    "egl": "apt-get install libegl1 libgl1-mesa-dri",
    "osmesa": "apt-get install libosmesa6",
}
"""Command (Debian) that installs a backend's libraries on a machine without a GPU driver."""

VISIBLE = "CUDA_VISIBLE_DEVICES"

NVIDIA = Path("/dev/nvidiactl")
"""Device file that exists if a driver for NVIDIA GPUs is loaded."""

ICD = '{"file_format_version": "1.0.0", "ICD": {"library_path": "libEGL_nvidia.so.0"}}'
_LIBRARIES = ("usr/lib/x86_64-linux-gnu", "usr/lib/aarch64-linux-gnu", "usr/lib64", "usr/lib", "usr/local/lib", "lib64")
_VENDORS = ("etc/glvnd/egl_vendor.d", "usr/share/glvnd/egl_vendor.d")
_SOFTWARE = ("llvmpipe", "softpipe", "swrast", "swr ", "software rasterizer", "lavapipe")


def is_software(renderer: str) -> bool:
    """Return whether a GL_RENDERER runs on the CPU."""
    return any(name in renderer.lower() for name in _SOFTWARE)


@dataclass(frozen=True)
class EglDevice:
    """EGL device, an entry of eglQueryDevicesEXT.

    Attributes
    ----------
    index : int
        Index for `GlContext.open(device_index=...)`.
    cuda_device : int or None
        CUDA ordinal of the same GPU, without regard to CUDA_VISIBLE_DEVICES; None if it is not a CUDA device.
    is_software : bool
        True for Mesa's rasteriser, by its extension EGL_MESA_device_software.
    uuid : str
        UUID as shown by nvidia-smi, ``GPU-...``; "" if the driver does not report it.
    """

    index: int
    cuda_device: int | None
    is_software: bool
    uuid: str = ""


def egl_devices() -> tuple[EglDevice, ...]:
    """List the EGL devices without opening a display; raise GlError if libEGL is missing or cannot list them."""
    name = find_library("EGL") or "libEGL.so.1"
    try:
        library = ctypes.CDLL(name)
    except OSError as error:
        raise GlError(f"libEGL cannot be loaded: {error}.") from None
    library.eglGetProcAddress.restype = ctypes.c_void_p
    library.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    addresses = [library.eglGetProcAddress(symbol) for symbol in _NAMES]
    if not all(addresses[:3]):
        raise GlError("libEGL lacks EGL_EXT_device_enumeration or EGL_EXT_device_query.")
    # prototypes: EGLBoolean and EGLint are 32-bit, EGLAttrib and handles are as wide as a pointer
    boolean, pointer, integer = ctypes.c_uint, ctypes.c_void_p, ctypes.c_int
    query = ctypes.CFUNCTYPE(boolean, integer, ctypes.POINTER(pointer), ctypes.POINTER(integer))(addresses[0])
    attribute = ctypes.CFUNCTYPE(boolean, pointer, integer, ctypes.POINTER(ctypes.c_ssize_t))(addresses[1])
    string = ctypes.CFUNCTYPE(ctypes.c_char_p, pointer, integer)(addresses[2])
    binary = ctypes.CFUNCTYPE(boolean, pointer, integer, integer, pointer, ctypes.POINTER(integer))(addresses[3] or 0)

    handles, count = (pointer * _MAX_DEVICES)(), integer(0)
    if not query(_MAX_DEVICES, handles, ctypes.byref(count)):
        raise GlError("eglQueryDevicesEXT failed to list the devices.")
    devices = []
    for index in range(count.value):
        handle, value = handles[index], ctypes.c_ssize_t(0)
        extensions = (string(handle, _EXTENSIONS) or b"").decode().split()
        has_cuda = "EGL_NV_device_cuda" in extensions and attribute(handle, _CUDA_DEVICE, ctypes.byref(value))
        uuid = (ctypes.c_ubyte * 16)()
        has_uuid = "EGL_EXT_device_persistent_id" in extensions and addresses[3]
        has_uuid = has_uuid and binary(handle, _DEVICE_UUID, 16, uuid, ctypes.byref(integer(0)))
        devices.append(
            EglDevice(
                index,
                int(value.value) if has_cuda else None,
                "EGL_MESA_device_software" in extensions,
                f"GPU-{UUID(bytes=bytes(uuid))}" if has_uuid else "",
            )
        )
    return tuple(devices)


def left_by_cuda(devices: Sequence[EglDevice], visible: str | None) -> tuple[EglDevice, ...]:
    """Return the devices that a value of CUDA_VISIBLE_DEVICES names, in its order, then those without CUDA.

    The value is a comma-separated list of ordinals or prefixes of UUIDs; None leaves all devices. As with CUDA, an
    unknown entry hides the entries after it.
    """
    if visible is None:
        return tuple(devices)
    chosen: list[EglDevice] = []
    for word in map(str.strip, visible.split(",")):
        found = [
            d
            for d in devices
            if d.cuda_device is not None
            and (word == str(d.cuda_device) or (word.startswith("GPU-") and d.uuid.startswith(word)))
        ]
        if len(found) != 1:
            break
        chosen += found
    return (*chosen, *(device for device in devices if device.cuda_device is None))


def default_device() -> int:
    """Return the index of the first device that CUDA_VISIBLE_DEVICES leaves; 0 if it is not set."""
    visible = os.environ.get(VISIBLE)
    if visible is None:
        return 0
    try:
        devices = egl_devices()
    except GlError:  # opening the device will report the reason
        return 0
    left = left_by_cuda(devices, visible)
    return left[0].index if left else 0


class GlProblem(NamedTuple):
    """Reason why there is no OpenGL on the GPU, a sentence, and the remedy."""

    cause: str
    fix: str


def find_gl_problem(root: Path = Path("/"), environment: Mapping[str, str] | None = None) -> GlProblem | None:
    """Return the reason, from the system's files, why OpenGL does not run on an NVIDIA GPU; None if there is none."""
    if not (root / "dev/nvidiactl").exists():
        return None
    environment = os.environ if environment is None else environment

    def has(library: str) -> bool:
        return any(any((root / folder).glob(f"{library}*")) for folder in _LIBRARIES)

    named = ",".join(environment.get(name, "") for name in ("CUDA_VISIBLE_DEVICES", "NVIDIA_VISIBLE_DEVICES"))
    if "MIG-" in named or any((root / "proc/driver/nvidia/capabilities").glob("gpu*/mig/gi*")):
        return GlProblem(
            "the NVIDIA GPU is divided into MIG instances, which have no graphics.",
            "run on a GPU without MIG, or use --method exact",
        )
    if not has("libEGL_nvidia.so"):
        return GlProblem(
            "there is an NVIDIA GPU, but the driver's libEGL_nvidia is missing.",
            "start the container with -e NVIDIA_DRIVER_CAPABILITIES=graphics,compute,utility "
            "(outside one: install the driver's libnvidia-gl package)",
        )
    if not (has("libEGL.so.1") and has("libGLdispatch.so.0")):
        return GlProblem(
            "there is an NVIDIA GPU and its driver, but glvnd's libEGL, which finds drivers, is missing.",
            "apt-get install libegl1",
        )
    if not any(file for folder in _VENDORS for file in (root / folder).glob("*nvidia*.json")):
        return GlProblem(
            "there is an NVIDIA GPU and its driver, but no ICD file registers it with glvnd.",
            f"echo '{ICD}' > /usr/share/glvnd/egl_vendor.d/10_nvidia.json",
        )
    return None


def explain_software_fallback(renderer: str) -> str:
    """Return why a GL_RENDERER is software although there is an NVIDIA GPU; "" if that is not the case."""
    if not is_software(renderer) or not NVIDIA.exists():
        return ""
    found = find_gl_problem() or GlProblem("nothing is known to be missing.", "run `zbuf-occlude doctor`")
    return f"OpenGL runs in software ({renderer}), although /dev/nvidiactl exists: {found.cause} Fix: {found.fix}"
