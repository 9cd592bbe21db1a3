"""Speed for `gpu.py`: point-views a second by faces, points and views, where the time goes, and frames."""

import math
import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from functools import lru_cache, partial
from statistics import median
from typing import Any
from unittest.mock import patch

import numpy as np
from common import in_turns
from gpu_parts import DEPTH_BUFFERS, RAYS, WARP, Amount, Cores

import zbuf_occlude as zo
from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.engines.gl.buffers import Buffers
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.engines.gl.depth_pass import DepthPass
from zbuf_occlude.engines.gl.exact_pass import ExactPass
from zbuf_occlude.engines.gl.point_pass import PointPass, UploadedPoints
from zbuf_occlude.meshes import shapes
from zbuf_occlude.visibility import find_method

METHODS_OF_FRAMES = ("exact", "depth_buffer")


@lru_cache(maxsize=1)
def knot(n_faces: int) -> zo.Mesh:
    """Return a knot of about this many faces, which hides itself from all sides: millions of them in a second."""
    n = math.isqrt(n_faces // 2)
    turn = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    points = np.stack(np.broadcast_arrays(*shapes.formulas.FORMULAS["trefoil"].surface(turn[:, None], turn)), axis=-1)
    a = np.arange(n * n, dtype=np.int32).reshape(n, n)
    b, d = np.roll(a, -1, axis=0), np.roll(a, -1, axis=1)
    c = np.roll(b, -1, axis=1)
    faces = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)])
    return zo.Mesh(points.reshape(-1, 3), faces.reshape(-1, 3), name="knot")


def fast(amount: Amount) -> dict[str, Any]:
    """Measure every method in a middle cell, and in cells where one of faces, points and views is another."""
    end, (faces, points, views) = time.perf_counter() + amount.fast_seconds, amount.middle
    sizes = [
        amount.middle,
        *((faces, n, views) for n in amount.fast_points),
        *((faces, points, n) for n in amount.views),
    ]
    sizes += [(n, points, views) for n in amount.faces]
    rows, stages, left_out = list[dict[str, Any]](), list[dict[str, Any]](), list[str]()
    with GlContext.open() as gl, Cores() as cores:
        for size in dict.fromkeys(sizes):
            place = dict(zip(("faces", "points", "views"), size, strict=True))
            done = "everything"
            for row in measured_cell(gl, cores, size, amount.call) if time.perf_counter() < end else ():
                rows.append({**place, **row})
                if time.perf_counter() > end:
                    done = f"all after {row['subject']}"
                    break
            if time.perf_counter() > end:
                left_out.append(", ".join([*(f"{n:,} {name}" for name, n in place.items()), done]))
            elif size[2] == views:
                stages += [{**place, **row} for row in staged_cell(gl, size)]
    return {"middle": amount.middle, "rows": rows, "stages": stages, "left_out": left_out}


def measured_cell(gl: GlContext, cores: Cores, size: tuple[int, int, int], seconds: float) -> Iterator[dict[str, Any]]:
    """Measure every method on one mesh, with one set of points and one of views."""
    n_faces, n_points, n_views = size
    mesh = knot(n_faces)
    points, eyes = zo.sample_surface(mesh, n_points=n_points, seed=0), eyes_of(mesh, n_views)
    makers: dict[str, Callable[[], Any]] = {
        f"depth_buffer {n}": partial(zo.prepare, mesh, "depth_buffer", gl=gl, resolution=n) for n in (256, 512, 1024)
    }
    makers["exact_gl"] = partial(zo.prepare, mesh, "exact_gl", gl=gl)
    makers["exact"] = partial(zo.prepare, mesh, "exact")
    if WARP:
        makers["warp"] = partial(zo.prepare, mesh, "warp")
    if RAYS:
        from gpu_warp import Float32Rays, Tensors  # late: Warp and PyTorch may not be there

        makers["warp, tensors"] = lambda: nullcontext(Tensors(mesh))
        makers["Warp's float32 rays"] = lambda: nullcontext(Float32Rays(mesh))
    for name, make in makers.items():
        yield {"subject": name, **measured_subject(make, points, eyes, seconds)}
    if not find_method("embree").missing() and n_faces <= 1_000_000:
        yield {"subject": "embree", **measured_embree(cores, n_faces, n_points, eyes, seconds)}


def eyes_of(mesh: zo.Mesh, n_views: int) -> FloatArray:
    """Return eyes all around a mesh, in random order: the first few are spread over all sides too."""
    eyes = zo.views.for_mesh(mesh, f"fibonacci:{n_views}").eyes
    return np.random.default_rng(0).permutation(eyes)


def measured_subject(
    make: Callable[[], Any], points: zo.SurfacePoints, eyes: FloatArray, seconds: float
) -> dict[str, Any]:
    """Time preparing, a call with points that are new, and again with points already uploaded."""
    began = time.perf_counter()
    with make() as occluder:
        prepare = time.perf_counter() - began
        n = 1
        while n < len(eyes) and 4 * in_turns({"": partial(occluder.visible, points, eyes[:n])}, 2)[""][1] < seconds:
            n = min(4 * n, len(eyes))
        asked = eyes[:n]
        occluder.visible(points, asked)  # compiles what so many eyes take
        anew = points.select(np.arange(len(points)))
        first, *again = in_turns({"": partial(occluder.visible, anew, asked)}, 4)[""]
    pairs = len(points) * len(asked)
    times = {"prepare": prepare, "first": first, "again": median(again)}
    return {**times, "views_asked": len(asked), "rate": pairs / median(again) / 1e6}


def measured_embree(cores: Cores, n_faces: int, n_points: int, eyes: FloatArray, seconds: float) -> dict[str, Any]:
    """Time Embree by a process for each core, each with some of the eyes."""
    shares = cores.split(eyes)
    one = max(cores.each(seconds_of_embree, [(n_faces, n_points, mine[:1]) for mine in shares]))
    most = int(np.clip(seconds / one, 1, len(shares[0])))
    began = time.perf_counter()
    cores.each(seconds_of_embree, [(n_faces, n_points, mine[:most]) for mine in shares])
    again = time.perf_counter() - began
    asked = sum(len(mine[:most]) for mine in shares)
    return {"again": again, "views_asked": asked, "rate": n_points * asked / again / 1e6}


def seconds_of_embree(n_faces: int, n_points: int, eyes: FloatArray) -> float:
    """Return the seconds of a call in this process, the mesh prepared before."""
    occluder, points = _embree(n_faces, n_points)
    return in_turns({"": lambda: occluder.visible(points, eyes)}, 1)[""][0]


@lru_cache(maxsize=1)
def _embree(n_faces: int, n_points: int) -> tuple[Any, zo.SurfacePoints]:
    mesh = knot(n_faces)
    return zo.prepare(mesh, "embree"), zo.sample_surface(mesh, n_points=n_points, seed=0)


def staged_cell(gl: GlContext, size: tuple[int, int, int]) -> Iterator[dict[str, Any]]:
    """Tell where the time of a call with new points goes: uploading, drawing, testing, reading back, unpacking."""
    mesh = knot(size[0])
    points, eyes = zo.sample_surface(mesh, n_points=size[1], seed=0), eyes_of(mesh, size[2])
    for label, (name, options) in {**DEPTH_BUFFERS, "exact_gl": ("exact_gl", {})}.items():
        with zo.prepare(mesh, name, gl=gl, **options) as occluder:
            occluder.visible(points, eyes)
            anew = points.select(np.arange(len(points)))
            with watched(gl) as spent:
                began = time.perf_counter()
                occluder.visible(anew, eyes)
                spent["else"] = time.perf_counter() - began - sum(spent.values())
        yield {"subject": label, "stages": dict(spent)}


@contextmanager
def watched(gl: GlContext) -> Iterator[dict[str, float]]:
    """Clock the steps of the engines, each without the steps within it; the device is waited for after each."""
    spent: dict[str, float] = defaultdict(float)
    within = [0.0]

    def clocked(function: Callable[..., Any], stage: str) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            gl.wait()
            began = time.perf_counter()
            within.append(0.0)
            result = function(*arguments, **named)
            gl.wait()
            seconds = time.perf_counter() - began
            spent[stage] += seconds - within.pop()
            within[-1] += seconds
            return result

        return call

    steps = (
        (UploadedPoints, "__init__", "upload"),
        (DepthPass, "draw", "draw"),
        (PointPass, "test", "test"),
        (Buffers, "read_into", "transfer"),
        (PointPass, "fetch", "unpack"),
        (ExactPass, "upload", "upload"),
        (ExactPass, "visible", "test"),
    )
    with ExitStack() as stack:
        for owner, name, stage in steps:
            stack.enter_context(patch.object(owner, name, clocked(getattr(owner, name), stage)))
        yield spent


def frames(amount: Amount) -> dict[str, Any]:
    """Time frames of depth, normals and faces by `exact` and `depth_buffer`, and by pyrender where it is installed."""
    from frames_speed import SIZE, theirs

    def ours(mesh: zo.Mesh, views: zo.views.Views, method: str) -> list[Any]:
        return list(zo.frames(mesh, views, width=SIZE[0], height=SIZE[1], method=method))

    os.environ["PYOPENGL_PLATFORM"] = "egl"  # before pyrender is imported
    rows, renderer, theirs_by = list[dict[str, Any]](), None, ""
    for n_faces in (5_000, 100_000):
        mesh = knot(n_faces)
        views = zo.views.for_mesh(mesh, f"fibonacci:{amount.frames}")
        jobs: dict[str, Callable[[], object]] = {name: partial(ours, mesh, views, name) for name in METHODS_OF_FRAMES}
        exact, drawn = (ours(mesh, views, name) for name in METHODS_OF_FRAMES)
        if not find_method("pyrender").missing():
            import pyrender
            from OpenGL import GL

            renderer = renderer or pyrender.OffscreenRenderer(*SIZE)
            jobs["pyrender"] = partial(theirs, renderer, mesh, exact)
            jobs["pyrender"]()
            theirs_by = GL.glGetString(GL.GL_RENDERER).decode()
        seconds = {name: median(each) for name, each in in_turns(jobs, 2).items()}
        same = [(a.face_ids == b.face_ids).mean() for a, b in zip(exact, drawn, strict=True)]
        rate = {name: len(views) / each for name, each in seconds.items()}
        rows.append({"faces": len(mesh.faces), "rate": rate, "same_faces": float(np.mean(same))})
    return {"width": SIZE[0], "height": SIZE[1], "rows": rows, "pyrender": theirs_by}
