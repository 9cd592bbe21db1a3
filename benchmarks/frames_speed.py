"""Time frames by `exact` beside pyrender's: depth, instances and normals of 640 x 480 pixels, the same views.

    python benchmarks/frames_speed.py MESH... [--views fibonacci:24]

pyrender renders each view in three passes: flat with depth, segments, and one for normals, for which it has no pass: a
flat one stands in. Preparing is counted on both sides, reading is not. Prints ratios of medians of seven rounds.
"""

import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common import run

import zbuf_occlude as zo

SIZE, ROUNDS = (640, 480), 7


def theirs(renderer: Any, mesh: zo.Mesh, frames: list[Any]) -> list[Any]:
    """Render views by pyrender; return the depth of each."""
    import pyrender  # late: it takes the platform from the environment when it is imported

    (fx, _, cx), (_, fy, cy), _ = frames[0].intrinsics.tolist()
    far = max(float(np.linalg.norm(frame.camera_to_world[:3, 3] - mesh.centre)) for frame in frames) + mesh.diagonal
    scene = pyrender.Scene(ambient_light=np.ones(3))
    node = scene.add(pyrender.Mesh.from_trimesh(mesh.to_trimesh(), smooth=False))
    camera = scene.add(pyrender.IntrinsicsCamera(fx, fy, cx, cy, znear=far / 1e4, zfar=far))
    flags, depths = pyrender.RenderFlags.SKIP_CULL_FACES, []
    for frame in frames:
        scene.set_pose(camera, frame.camera_to_world)
        depths.append(renderer.render(scene, flags | pyrender.RenderFlags.FLAT)[1])
        renderer.render(scene, flags | pyrender.RenderFlags.SEG, {node: (255, 0, 0)})
        renderer.render(scene, flags | pyrender.RenderFlags.FLAT)
    return depths


def main(meshes: Sequence[Path], *, views: str = "fibonacci:24") -> None:
    ratios = []
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    import pyrender

    renderer = pyrender.OffscreenRenderer(*SIZE)
    for path in meshes:
        mesh = zo.load_mesh(path)
        chosen = zo.views.for_mesh(mesh, views)
        frames, seconds, agree = list[Any](), np.empty((ROUNDS, 2)), list[float]()
        for turn in range(ROUNDS):
            begin = time.perf_counter()
            frames = list(zo.frames(mesh, chosen, width=SIZE[0], height=SIZE[1]))
            middle = time.perf_counter()
            depths = theirs(renderer, mesh, frames)
            seconds[turn] = middle - begin, time.perf_counter() - middle
            agree = [(frame.mask == (depth > 0)).mean() for frame, depth in zip(frames, depths, strict=True)]
        mine, other = np.median(seconds, axis=0) / len(chosen) * 1e3
        ratios.append(other / mine)
        print(
            f"{path.stem} ({len(mesh.faces):,} faces): exact {mine:.2f} ms, pyrender {other:.2f} ms, "
            f"{ratios[-1]:.1f} times; masks agree {np.mean(agree):.3%}",
            flush=True,
        )
    print(f"median {np.median(ratios):.1f} times, worst {min(ratios):.1f}")


if __name__ == "__main__":
    run(main, __doc__)
