"""`depth_buffer` against Embree as a user calls it: rays built for each view from points in random order.

    python benchmarks/depth_buffer_vs_embree.py [--faces 19000] [--points 50000 500000] [--rounds 5]

Open3D's `RaycastingScene.test_occlusions` answers for 10 of the 100 eyes, `depth_buffer` at 512 pixels a side for all
100 in one call, with its refinement and without; in turn, `--rounds` times; the medians of the ratios count. Meshes:
the airplane of tiny faces, and a soup of triangles in which everything crosses everything. Wrong: against `exact`.
"""

import argparse
import time

import numpy as np
import open3d

import zbuf_occlude as zo
from zbuf_occlude import Mesh, shapes
from zbuf_occlude.gl.context import GlContext

GOALS = {50_000: 1.7, 500_000: 8.0}


def row(mesh: Mesh, gl: GlContext, n_points: int, rounds: int) -> str:
    points, eyes = zo.sample_surface(mesh, n_points=n_points, seed=0), zo.views.paper100().eyes
    points = points.select(np.random.default_rng(0).permutation(n_points))
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        open3d.core.Tensor(mesh.vertices.astype(np.float32)), open3d.core.Tensor(mesh.faces.astype(np.uint32))
    )
    seconds: dict[str, list[float]] = {"embree": [], "witness": [], "none": []}
    with (
        zo.prepare(mesh, "depth_buffer", gl=gl) as witness,
        zo.prepare(mesh, "depth_buffer", gl=gl, refine="none") as none,
        zo.prepare(mesh, "exact") as exact,
    ):
        truth = exact.visible(points, eyes[::20])
        wrong = [(each.visible(points, eyes[::20]) != truth).mean() for each in (witness, none)]
        for _ in range(rounds):
            began = time.perf_counter()
            for eye in eyes[5::10]:
                rays = np.concatenate([np.broadcast_to(eye, (n_points, 3)), points.positions - eye], axis=1)
                scene.test_occlusions(open3d.core.Tensor(rays.astype(np.float32)), 0.0, 1.0 - 1e-4).numpy()
            seconds["embree"].append((time.perf_counter() - began) / 10)
            for name, occluder in (("witness", witness), ("none", none)):
                began = time.perf_counter()
                occluder.visible(points, eyes)
                seconds[name].append((time.perf_counter() - began) / len(eyes))
    ms = [f"{1e3 * np.median(each):.1f}" for each in seconds.values()]
    ratios = [float(np.median(np.divide(seconds["embree"], seconds[name]))) for name in ("witness", "none")]
    cells = [f"{len(mesh.faces):,}", f"{n_points:,}", *ms, *(f"{ratio:.2f}" for ratio in ratios)]
    cells += [f"{GOALS.get(n_points, float('nan')):g}", *(f"{fraction:.4f}" for fraction in wrong)]
    return f"| {mesh.name} | " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faces", type=int, default=19_000)
    parser.add_argument("--points", type=int, nargs="+", default=[50_000, 500_000])
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    with GlContext.open() as gl:
        print(f"{gl.renderer}\n")
        print("| mesh | faces | points | embree ms | witness ms | none ms | witness x | none x | goal | wrong | none |")
        print("|" + " --- |" * 11)
        for mesh in (shapes.benchmark_mesh(options.faces).normalized(), shapes.soup(options.faces)):
            for n_points in options.points:
                print(row(mesh, gl, n_points, options.rounds), flush=True)


if __name__ == "__main__":
    main()
