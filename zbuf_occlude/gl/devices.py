"""Which EGL devices there are, and which CUDA device each one is: EGL counts in its own order."""

import ctypes
from ctypes.util import find_library
from dataclasses import dataclass

from zbuf_occlude.errors import GlError

# EGL_EXT_device_query, EGL_NV_device_cuda, EGL_EXT_device_drm
_EXTENSIONS, _CUDA_DEVICE, _DRM_DEVICE_FILE = 0x3055, 0x323A, 0x3233
_MOST = 64


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
    """

    index: int
    cuda_device: int | None
    drm_file: str
    is_software: bool


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
    addresses = [
        library.eglGetProcAddress(symbol)
        for symbol in (b"eglQueryDevicesEXT", b"eglQueryDeviceAttribEXT", b"eglQueryDeviceStringEXT")
    ]
    if not all(addresses):
        raise GlError("libEGL must have EGL_EXT_device_enumeration and EGL_EXT_device_query; it has not.")
    # prototypes: EGLBoolean and EGLint are 32-bit, EGLAttrib and handles are as wide as a pointer
    boolean, pointer, integer = ctypes.c_uint, ctypes.c_void_p, ctypes.c_int
    query = ctypes.CFUNCTYPE(boolean, integer, ctypes.POINTER(pointer), ctypes.POINTER(integer))(addresses[0])
    attribute = ctypes.CFUNCTYPE(boolean, pointer, integer, ctypes.POINTER(ctypes.c_ssize_t))(addresses[1])
    string = ctypes.CFUNCTYPE(ctypes.c_char_p, pointer, integer)(addresses[2])

    handles, count = (pointer * _MOST)(), integer(0)
    if not query(_MOST, handles, ctypes.byref(count)):
        raise GlError("eglQueryDevicesEXT must list the devices; it failed.")
    devices = []
    for index in range(count.value):
        handle, value = handles[index], ctypes.c_ssize_t(0)
        extensions = (string(handle, _EXTENSIONS) or b"").decode().split()
        has_cuda = "EGL_NV_device_cuda" in extensions and attribute(handle, _CUDA_DEVICE, ctypes.byref(value))
        drm_file = string(handle, _DRM_DEVICE_FILE) if "EGL_EXT_device_drm" in extensions else None
        devices.append(
            EglDevice(
                index,
                int(value.value) if has_cuda else None,
                (drm_file or b"").decode(),
                "EGL_MESA_device_software" in extensions,
            )
        )
    return tuple(devices)
