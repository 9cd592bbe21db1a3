"""Probe of the GL backends in child processes, so that a broken driver cannot harm the calling process."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from zbuf_occlude.base.child import ChildFailed, call_in_child
from zbuf_occlude.base.errors import GlError, OccludeError
from zbuf_occlude.engines.gl.context import GlContext, egl_fix
from zbuf_occlude.engines.gl.devices import FIXES, VISIBLE, egl_devices, find_gl_problem, left_by_cuda
from zbuf_occlude.engines.gl.shaders import compile_program

LIMITS = (
    "GL_MAX_SHADER_STORAGE_BLOCK_SIZE",
    "GL_MAX_SHADER_STORAGE_BUFFER_BINDINGS",
    "GL_MAX_COMPUTE_WORK_GROUP_INVOCATIONS",
    "GL_MAX_TEXTURE_SIZE",
    "GL_MAX_ARRAY_TEXTURE_LAYERS",
    "GL_MAX_FRAMEBUFFER_LAYERS",
)
TIMEOUT = 120.0
"""Seconds that a driver has to answer."""


@dataclass(frozen=True)
class Probe:
    """Result of probing one backend.

    Attributes
    ----------
    backend : str
    device_index : int or None
        Index of an EGL device; None for OSMesa, and for EGL if its devices cannot be listed.
    works : bool
        True if a context opened, and a compute shader ran and wrote the right numbers.
    renderer, version : str
        GL_RENDERER and GL_VERSION; "" if it does not work.
    is_software : bool
    limits : dict of str to int
        Limits of the driver, by the names in `LIMITS`.
    cuda_device : int or None
        CUDA ordinal of the same GPU.
    reason : str
        Reason why it does not work, or is software beside an NVIDIA GPU; "" otherwise.
    fix : str
        Command or setting that would help; "" if none is needed or known.
    """

    backend: str
    device_index: int | None
    works: bool
    renderer: str = ""
    version: str = ""
    is_software: bool = False
    limits: dict[str, int] = field(default_factory=dict)
    cuda_device: int | None = None
    reason: str = ""
    fix: str = ""


def probe_all() -> tuple[Probe, ...]:
    """Probe every EGL device (one row without an index if they cannot be listed), then OSMesa. Raises nothing.

    If no working device is hardware although the machine has an NVIDIA GPU, `reason` and `fix` explain it.
    """
    listed = _ask("devices")
    rows = [probe("egl", row["index"], row["cuda_device"]) for row in listed.get("devices", [])]
    if not rows:
        reason = listed.get("reason", "EGL lists no devices.")
        rows = [Probe("egl", None, works=False, reason=reason, fix=egl_fix())]
    if not any(row.works and not row.is_software for row in rows) and (found := find_gl_problem()) is not None:
        rows = [replace(row, reason=f"{row.reason} {found.cause}".strip(), fix=found.fix) for row in rows]
    return (*rows, probe("osmesa"))


def hardware_devices() -> list[int]:
    """Return the hardware EGL devices that open, in the order of CUDA_VISIBLE_DEVICES, each tried in a child process.

    Mesa also lists render nodes that this process may not open.
    """
    try:
        listed = left_by_cuda(egl_devices(), os.environ.get(VISIBLE))
    except GlError:
        return []
    candidates = [device for device in listed if not device.is_software]
    with ThreadPoolExecutor(max_workers=max(len(candidates), 1)) as pool:
        tried = list(pool.map(lambda device: probe("egl", device.index, device.cuda_device), candidates))
    return [row.device_index for row in tried if row.works and not row.is_software and row.device_index is not None]


def probe(backend: str, device_index: int | None = None, cuda_device: int | None = None) -> Probe:
    """Probe one backend in a child process; a failure there, even a crash, gives the result's `reason`."""
    answer = _ask(backend, *([] if device_index is None else [str(device_index)]))
    if answer.get("works"):
        return Probe(backend, device_index, cuda_device=cuda_device, **answer)
    fix = egl_fix() if backend == "egl" else FIXES[backend]
    fix = fix if fix in answer["reason"] else ""  # no command helps against a wrong device index
    return Probe(backend, device_index, False, cuda_device=cuda_device, reason=answer["reason"], fix=fix)


def _ask(*arguments: str) -> dict[str, Any]:
    try:
        found: dict[str, Any] = call_in_child(_answer, *arguments, timeout=TIMEOUT)
    except ChildFailed as failure:
        return {"works": False, "reason": f"the process {failure}"}
    return found


def _answer(backend: str, *device: str) -> dict[str, Any]:
    """Return the child's reply about one backend, or about the devices."""
    try:
        if backend == "devices":
            return {"devices": [asdict(each) for each in egl_devices()]}
        with GlContext.open(backend, int(device[0]) if device else None) as gl:
            _try_compute(gl)
            return {
                "works": True,
                "renderer": gl.renderer,
                "version": gl.version,
                "is_software": gl.is_software,
                "limits": {name: int(gl.info[name]) for name in LIMITS},
            }
    except OccludeError as error:
        return {"works": False, "reason": str(error)}


def _try_compute(gl: GlContext) -> None:
    program, numbers = compile_program(gl.ctx, "probe.comp"), gl.ctx.buffer(reserve=256)
    numbers.bind_to_storage_buffer(0)
    program.run(1)
    gl.ctx.memory_barrier()
    written = memoryview(numbers.read()).cast("I").tolist()
    numbers.release()
    program.release()
    gl.check()
    if written != list(range(64)):
        raise GlError(f"a compute shader must write 0, 1, 2, ...; {gl.renderer} wrote {written[:4]}...")
