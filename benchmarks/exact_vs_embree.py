"""`exact` against the strict peer: Open3D's `RaycastingScene.test_occlusions`, its call alone, Hilbert-sorted points.

    python benchmarks/exact_vs_embree.py [--points 2000 10000 50000 500000] [--repeats 5] [--data FOLDER] [--json FILE]

Two medians: over the five meshes with airplanes of tiny equal faces, and over five of the kinds that the goals were set
on, a soup of 19,000 faces, a bed of 31,000 and the airplane of 45,000 beside the stool and the chair.

For each mesh and number of points both answer in turn, `--repeats` times, and the medians of the ratios count.
`exact` is timed as a user calls it, sorting included, for 100 eyes in one call; the peer's ray tensors are
made beforehand and its points sorted, and it answers for every tenth eye. Agreement is that with the oracle, on a
sample of 200 points and the peer's eyes. Growth exponents are slopes between the smallest and the largest count.
"""

import argparse
import json
import os
import resource
import time
from pathlib import Path

import numpy as np
import open3d

import zbuf_occlude as zo
from zbuf_occlude import Mesh, sample_surface
from zbuf_occlude.hilbert import hilbert_order
from zbuf_occlude.meshes import shapes
from zbuf_occlude.visibility.oracle import prepare as prepare_oracle

GOALS = {10_000: 4.0, 50_000: 6.0, 500_000: 12.0}
FILES = {"stool_0002": "modelnet/stool/train/stool_0002.off", "chair_0003": "modelnet/chair/train/chair_0003.off"}
AIRPLANES = (19_000, 31_000, 45_000)
SETS = {
    "airplanes": (*FILES, *(f"airplane {n // 1000}k" for n in AIRPLANES)),
    "kinds": (*FILES, "soup 19k", "bed 31k", "airplane 45k"),
}
"""Meshes over which medians are taken."""


def meshes(data: Path) -> dict[str, Mesh]:
    found = {name: zo.load_mesh(data / path) for name, path in FILES.items() if (data / path).exists()}
    found |= {f"airplane {n // 1000}k": shapes.benchmark_mesh(n) for n in AIRPLANES}
    found |= {"soup 19k": shapes.soup(19_000), "bed 31k": shapes.benchmark_mesh(31_000, "bed")}
    return {name: mesh.normalized() for name, mesh in found.items()}


def compare(name: str, mesh: Mesh, n_points: int, repeats: int) -> dict[str, float | str | int]:
    eyes = zo.views.paper100().eyes
    points = sample_surface(mesh, n_points=n_points, seed=0)
    ordered = points.select(hilbert_order(points.positions))
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        open3d.core.Tensor(mesh.vertices.astype(np.float32)), open3d.core.Tensor(mesh.faces.astype(np.uint32))
    )
    rays = []
    for eye in eyes[5::10]:
        ray = np.empty((n_points, 6), dtype=np.float32)
        ray[:, :3], ray[:, 3:] = eye, ordered.positions - eye
        rays.append(open3d.core.Tensor(ray))
    start = time.perf_counter()
    occluder = zo.prepare(mesh, method="exact")
    prepared = time.perf_counter() - start
    occluder.visible(points, eyes[:1])  # compiles
    scene.test_occlusions(rays[0], 0.0, 1.0 - 1e-4)
    ours, theirs = [], []
    for _ in range(repeats):
        start = time.perf_counter()
        mask = occluder.visible(ordered, eyes)
        ours.append((time.perf_counter() - start) / len(eyes))
        start = time.perf_counter()
        hits = [scene.test_occlusions(ray, 0.0, 1.0 - 1e-4) for ray in rays]
        theirs.append((time.perf_counter() - start) / len(rays))
    sample = np.random.default_rng(0).choice(n_points, min(200, n_points), replace=False)
    truth = prepare_oracle(mesh).visible(ordered.select(sample), eyes[5::10])
    peer = ~np.stack([hit.numpy() for hit in hits])
    return {
        "mesh": name,
        "faces": len(mesh.faces),
        "points": n_points,
        "prepare_ms": 1e3 * prepared,
        "exact_ms": 1e3 * float(np.median(ours)),
        "embree_ms": 1e3 * float(np.median(theirs)),
        "ratio": float(np.median(np.divide(theirs, ours))),
        "exact_agrees": float((mask[5::10, sample] == truth).mean()),
        "embree_agrees": float((peer[:, sample] == truth).mean()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, nargs="+", default=[2_000, 10_000, 50_000, 500_000])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--mesh", nargs="+", help="only those whose names contain one of these")
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("ZBUF_OCCLUDE_DATA", "../shared/data")))
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = []
    print("mesh              faces   points   exact ms  embree ms   ratio   agree exact / embree")
    for name, mesh in meshes(options.data).items():
        if options.mesh and not any(part in name for part in options.mesh):
            continue
        for n_points in options.points:
            row = compare(name, mesh, n_points, options.repeats)
            rows.append(row)
            print(
                f"{name:15}{row['faces']:8}{n_points:9}{row['exact_ms']:11.3f}{row['embree_ms']:11.3f}"
                f"{row['ratio']:8.2f}   {row['exact_agrees']:.5f} / {row['embree_agrees']:.5f}",
                flush=True,
            )
    for name, meshes_of_set in SETS.items():
        for n_points in options.points:
            ratios = [row["ratio"] for row in rows if row["points"] == n_points and row["mesh"] in meshes_of_set]
            goal = GOALS.get(n_points)
            if ratios:
                print(
                    f"{name}: median ratio of {len(ratios)} meshes at {n_points} points {np.median(ratios):.2f}"
                    + (f" (goal {goal:g})" if goal else "")
                )
    if len(options.points) > 1:
        low, high = min(options.points), max(options.points)
        for name in dict.fromkeys(row["mesh"] for row in rows):
            times = {row["points"]: row["exact_ms"] for row in rows if row["mesh"] == name}
            print(f"{name}: time grows as points^{np.log(times[high] / times[low]) / np.log(high / low):.2f}")
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
