"""A short trial: how many times as fast as another a method is, on this machine, on a typical mesh of a job."""

import time
from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any

import numpy as np

from zbuf_occlude import views
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.sampling import SurfacePoints, sample_surface
from zbuf_occlude.visibility import find_method, prepare

SECONDS = 0.05
"""For each of the two, at least one mesh: who waits for the trial has waited long enough."""

EYES = 25
"""Per mesh: as many as `modelnet8` has."""


def times_as_fast(
    method: str, other: str, mesh: Mesh, points: SurfacePoints, options: Mapping[str, Any] | None = None
) -> float:
    """Prepare the mesh and ask about its points, by both; return the other's seconds divided by the method's.

    Parameters
    ----------
    method, other : str
        Of the table of methods. Contexts are opened, and functions compiled, before anything is timed.
    mesh : Mesh
    points : SurfacePoints
    options : mapping, optional
        The other's.

    Raises
    ------
    GlError, UnavailableError
        One of them cannot run here.
    """
    return _seconds(other, dict(options or {}), mesh, points) / _seconds(method, {}, mesh, points)


def _seconds(method: str, options: dict[str, Any], mesh: Mesh, points: SurfacePoints) -> float:
    """Seconds per mesh."""
    eyes = views.fibonacci(EYES).around(mesh.centre, mesh.longest_side).eyes
    triangle = Mesh(np.eye(3), np.array([[0, 1, 2]]), name="trial")
    with ExitStack() as stack:
        if find_method(method).needs_gl:
            from zbuf_occlude.gl.context import GlContext  # late: only these methods touch GL

            options["gl"] = stack.enter_context(GlContext.open())
        _ask(method, options, triangle, sample_surface(triangle, n_points=10), eyes)
        began, n_meshes = time.perf_counter(), 0
        while n_meshes == 0 or time.perf_counter() - began < SECONDS:
            _ask(method, options, mesh, points, eyes)
            n_meshes += 1
        return (time.perf_counter() - began) / n_meshes


def _ask(method: str, options: dict[str, Any], mesh: Mesh, points: SurfacePoints, eyes: Any) -> None:
    with prepare(mesh, method, **options) as occluder:
        occluder.visible(points, eyes)
