"""Choice of the method where none is named: `depth_buffer` if OpenGL opens; for `auto` the fastest as measured."""

import os
import time
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from zbuf_occlude.base.errors import GlError, MeshError, OccludeError, OptionError
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.base.provenance import seed_of
from zbuf_occlude.datasets.plan import DatasetConfig
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.meshes.sampling import sample_surface
from zbuf_occlude.views import parse as parse_views
from zbuf_occlude.visibility import find_method, prepare

AUTO = "auto"

LOOKED_AT = 8
"""Number of meshes of a collection that are loaded to estimate the size of all."""

LARGE = 1 << 24
"""Maximum size of a file that is loaded for the estimate, bytes."""
PATIENCE = 10.0
"""Timeout of loading a mesh for the estimate, seconds."""
TRIED_VIEWS, DENSE = "modelnet8", 20_000
"""Views of a trial, and its points where the configuration gives a density."""


@dataclass(frozen=True)
class Choice:
    """A method and why it was taken."""

    method: str
    reason: str


def by_default() -> Choice:
    """Choose the default method: `depth_buffer`; or `exact`, with the reason, where no OpenGL context opens."""
    from zbuf_occlude.engines.gl.context import GlContext  # late: nothing touches GL before it must

    try:
        GlContext.open().close()
    except GlError:
        return Choice("exact", "no OpenGL context opens here")
    return Choice("depth_buffer", "")


def remark_on_renderer(method: str) -> str:
    """Return a remark on a method that would render in software beside an NVIDIA GPU; else ""."""
    from zbuf_occlude.engines.gl.context import GlContext  # late, as above
    from zbuf_occlude.engines.gl.devices import NVIDIA, explain_software_fallback

    if method == AUTO or not find_method(method).needs_gl or not NVIDIA.exists():
        return ""
    try:
        with GlContext.open() as gl:
            return explain_software_fallback(gl.renderer)
    except GlError:  # the run itself reports the reason
        return ""


def resolve(config: DatasetConfig, meshes: MeshCollection) -> DatasetConfig:
    """Replace the method `auto` by a choice for this machine; leave any other configuration as it is.

    On a GPU both candidates are timed on one of up to `LOOKED_AT` meshes. Nodes of a cluster that differ may choose
    differently: name the method there. Options with the method `auto` are an OptionError.
    """
    if config.method != AUTO:
        return config
    if config.method_options:
        raise OptionError(f"--set needs a named method; got --method {AUTO}. Name the one the option is of.")
    gain, choice = gain_on_gpu(config, meshes), Choice("exact", "no GPU: nothing exact was measured to be faster")
    if gain > 1.0:
        choice = Choice("exact_gl", f"in a trial on the GPU here it was {gain:.1f} times as fast as `exact`")
    elif gain > 0.0:
        choice = Choice("exact", f"in a trial `exact_gl` on the GPU here was {gain:.1f} times as fast")
    return replace(config, method=choice.method, reason=choice.reason)


def gain_on_gpu(config: DatasetConfig, meshes: MeshCollection) -> float:
    """Return the speed of `exact_gl` on this machine's GPU over that of `exact`; 0 without a GPU.

    Both are timed on the median mesh by size of a few, after a smaller call that compiles.
    """
    from zbuf_occlude.engines.gl.context import GlContext  # late: only this choice touches GL

    loaded = []
    with suppress(OccludeError, OSError, MemoryError), GlContext.open() as gl:
        if gl.is_software:
            return 0.0
        for mesh_id in np.unique(np.linspace(0, len(meshes) - 1, min(LOOKED_AT, len(meshes))).astype(int)).tolist():
            path = meshes[mesh_id].path
            if path and os.path.getsize(path) > LARGE:
                continue
            with suppress(MeshError, OSError), Limits(seconds=PATIENCE).watch():
                loaded.append(meshes[mesh_id].load())
        if not loaded:
            return 0.0
        mesh = sorted(loaded, key=lambda mesh: len(mesh.faces))[len(loaded) // 2]
        views = parse_views(TRIED_VIEWS, distance=config.distance, seed=seed_of(0, ""))
        eyes = views.around(mesh.centre, mesh.longest_side).eyes
        points = sample_surface(mesh, n_points=config.n_points or DENSE, seed=0)
        seconds = {}
        for method in ("exact", "exact_gl"):
            for asked in (points.select(np.arange(100)), points):
                began = time.perf_counter()
                with prepare(mesh, method, gl=gl if find_method(method).needs_gl else None) as occluder:
                    occluder.visible(asked, eyes)
                seconds[method] = time.perf_counter() - began
        return seconds["exact"] / seconds["exact_gl"]
    return 0.0
