"""Which EGL devices there are, which CUDA device each one is, and which CUDA_VISIBLE_DEVICES leaves."""

import ctypes
import os
from collections.abc import Sequence
from ctypes.util import find_library
from dataclasses import dataclass
from uuid import UUID

from zbuf_occlude.errors import GlError

# EGL_EXT_device_query, EGL_NV_device_cuda, EGL_EXT_device_drm, EGL_EXT_device_persistent_id
_EXTENSIONS, _CUDA_DEVICE, _DRM_DEVICE_FILE, _DEVICE_UUID = 0x3055, 0x323A, 0x3233, 0x335C
_MOST = 64
_NAMES = (b"eglQueryDevicesEXT", b"eglQueryDeviceAttribEXT", b"eglQueryDeviceStringEXT", b"eglQueryDeviceBinaryEXT")

VISIBLE = "CUDA_VISIBLE_DEVICES"


@dataclass(frozen=True)
class EglDevice:
    """One row of eglQueryDevicesEXT.

    Attributes
    ----------
    index : int
        What `GlContext.open(device_index=...)` takes.
    cuda_device : int or None
        The CUDA ordinal of the same GPU, as CUDA counts without CUDA_VISIBLE_DEVICES; None when it is no CUDA device.
    drm_file : str
        E.g. ``/dev/dri/card0``; "" when it has none.
    is_software : bool
        Mesa's rasteriser, by its extension EGL_MESA_device_software.
    uuid : str
        As nvidia-smi names it, ``GPU-...``; "" when the driver does not tell.
    """

    index: int
    cuda_device: int | None
    drm_file: str
    is_software: bool
    uuid: str = ""


def egl_devices() -> tuple[EglDevice, ...]:
    """List the EGL devices without opening a display.

    Raises
    ------
    GlError
        libEGL is missing, or cannot enumerate devices.
    """
    name = find_library("EGL") or "libEGL.so.1"
    try:
        library = ctypes.CDLL(name)
    except OSError as error:
        raise GlError(f"libEGL must be installed; it could not be loaded: {error}.") from None
    library.eglGetProcAddress.restype = ctypes.c_void_p
    library.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    addresses = [library.eglGetProcAddress(symbol) for symbol in _NAMES]
    if not all(addresses[:3]):
        raise GlError("libEGL must have EGL_EXT_device_enumeration and EGL_EXT_device_query; it has not.")
    # prototypes: EGLBoolean and EGLint are 32-bit, EGLAttrib and handles are as wide as a pointer
    boolean, pointer, integer = ctypes.c_uint, ctypes.c_void_p, ctypes.c_int
    query = ctypes.CFUNCTYPE(boolean, integer, ctypes.POINTER(pointer), ctypes.POINTER(integer))(addresses[0])
    attribute = ctypes.CFUNCTYPE(boolean, pointer, integer, ctypes.POINTER(ctypes.c_ssize_t))(addresses[1])
    string = ctypes.CFUNCTYPE(ctypes.c_char_p, pointer, integer)(addresses[2])
    binary = ctypes.CFUNCTYPE(boolean, pointer, integer, integer, pointer, ctypes.POINTER(integer))(addresses[3] or 0)

    handles, count = (pointer * _MOST)(), integer(0)
    if not query(_MOST, handles, ctypes.byref(count)):
        raise GlError("eglQueryDevicesEXT must list the devices; it failed.")
    devices = []
    for index in range(count.value):
        handle, value = handles[index], ctypes.c_ssize_t(0)
        extensions = (string(handle, _EXTENSIONS) or b"").decode().split()
        has_cuda = "EGL_NV_device_cuda" in extensions and attribute(handle, _CUDA_DEVICE, ctypes.byref(value))
        drm_file = string(handle, _DRM_DEVICE_FILE) if "EGL_EXT_device_drm" in extensions else None
        uuid = (ctypes.c_ubyte * 16)()
        has_uuid = "EGL_EXT_device_persistent_id" in extensions and addresses[3]
        has_uuid = has_uuid and binary(handle, _DEVICE_UUID, 16, uuid, ctypes.byref(integer(0)))
        devices.append(
            EglDevice(
                index,
                int(value.value) if has_cuda else None,
                (drm_file or b"").decode(),
                "EGL_MESA_device_software" in extensions,
                f"GPU-{UUID(bytes=bytes(uuid))}" if has_uuid else "",
            )
        )
    return tuple(devices)


def left_by_cuda(devices: Sequence[EglDevice], visible: str | None) -> tuple[EglDevice, ...]:
    """Return the devices that a value of CUDA_VISIBLE_DEVICES leaves: those it names, in its order, then all others.

    Parameters
    ----------
    devices : sequence of EglDevice
    visible : str or None
        Numbers, or UUIDs or beginnings of them, between commas; None, the variable not being set, leaves all. As with
        CUDA, what follows an unknown word is not seen.
    """
    if visible is None:
        return tuple(devices)
    chosen: list[EglDevice] = []
    for word in map(str.strip, visible.split(",")):
        found = [d for d in devices if d.cuda_device is not None and _is_named(d, word)]
        if len(found) != 1:
            break
        chosen += found
    return (*chosen, *(device for device in devices if device.cuda_device is None))


def _is_named(device: EglDevice, word: str) -> bool:
    return word == str(device.cuda_device) or (word.startswith("GPU-") and device.uuid.startswith(word))


def default_device() -> int:
    """Return the index of the first device that CUDA_VISIBLE_DEVICES leaves; 0 where that says nothing."""
    visible = os.environ.get(VISIBLE)
    if visible is None:
        return 0
    try:
        devices = egl_devices()
    except GlError:  # opening it will say why
        return 0
    left = left_by_cuda(devices, visible)
    return left[0].index if left else 0
