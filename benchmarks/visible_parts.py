"""Hold the visible parts of meshes to sampled visibility: areas within the sampling's error, and seen a second time.

    python benchmarks/visible_parts.py FOLDER

Each mesh is cut from five sides. A row is printed where the areas differ by more than three standard errors.
"""

import time
from pathlib import Path

import numpy as np
from common import run

import zbuf_occlude as zo
from zbuf_occlude.meshes import shapes

N_EYES, N_POINTS, N_AGAIN = 5, 200_000, 20_000


def main(folder: Path) -> None:
    off, again, seconds = [], [], []
    zo.visible_mesh(shapes.make("chair", 0), [3.0, 2.0, 1.5])  # compiles
    for path in sorted(folder.rglob("*.o[bf][jf]")):
        mesh = zo.load_mesh(path)
        eyes = zo.views.for_mesh(mesh, f"fibonacci:{N_EYES}").eyes
        points = zo.sample_surface(mesh, n_points=N_POINTS, seed=7)
        with zo.prepare(mesh, "exact") as occluder:
            shares = occluder.visible(points, eyes).mean(axis=1)
        for i, (eye, share) in enumerate(zip(eyes, shares, strict=True)):
            begin = time.perf_counter()
            part = zo.visible_mesh(mesh, eye)
            seconds.append(time.perf_counter() - begin)
            error = np.sqrt(max(share * (1 - share), 1 / N_POINTS) / N_POINTS)
            off.append((part.mesh.areas.sum() / mesh.areas.sum() - share) / error)
            on_part = zo.sample_surface(part.mesh, n_points=N_AGAIN, seed=3)
            own = zo.SurfacePoints(on_part.positions, part.face_ids[on_part.face_ids], on_part.normals)
            with zo.prepare(mesh, "exact") as occluder:
                again.append(occluder.visible(own, eye).mean())
            if abs(off[-1]) > 3:
                print(f"{path.name}, eye {i}: {off[-1]:.2f} standard errors of {share:.4f}", flush=True)
    beyond = int((np.abs(off) > 3).sum())
    print(f"{len(off)} parts: {beyond} beyond three standard errors, {0.0027 * len(off):.1f} expected by chance")
    print(f"root mean square {np.sqrt(np.mean(np.square(off))):.2f} standard errors, largest {np.abs(off).max():.2f}")
    print(f"seen a second time: {np.mean(again):.3%}, of the worst part {min(again):.3%}")
    print(f"a part takes {np.median(seconds):.2f} s, the slowest {max(seconds):.1f} s")


if __name__ == "__main__":
    run(main, __doc__)
