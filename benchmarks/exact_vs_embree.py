"""`exact` against the strict peer: Open3D's `RaycastingScene.test_occlusions`, its call alone, Hilbert-sorted points.

    python benchmarks/exact_vs_embree.py [--points 2000 10000 50000 500000] [--repeats 5] [--data FOLDER] [--json FILE]

Two medians: over the five meshes with airplanes of tiny equal faces, and over five of the kinds that the goals were set
on, a soup of 19,000 faces, a bed of 31,000 and the airplane of 45,000 beside the stool and the chair.

For each mesh and number of points both answer in turn, `--repeats` times, and the medians of the ratios count.
`exact` is timed as a user calls it, sorting included, for 100 eyes in one call; the peer's ray tensors are
made beforehand and its points sorted, and it answers for every tenth eye. Agreement is that with the oracle, on a
sample of 200 points and the peer's eyes. Growth exponents are slopes between the smallest and the largest count.
In the table: the ratio, and in brackets the milliseconds per eye of `exact` and of the peer.
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import open3d

import zbuf_occlude as zo
from zbuf_occlude import Mesh, sample_surface, shapes
from zbuf_occlude.geometry.hilbert import hilbert_order
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
    for name, mesh in meshes(options.data).items():
        if options.mesh and not any(part in name for part in options.mesh):
            continue
        for n_points in options.points:
            print(f"{name}, {n_points:,} points", file=sys.stderr, flush=True)
            rows.append(compare(name, mesh, n_points, options.repeats))
    print("\n".join(table(rows, sorted(options.points))))
    print(
        f"\nAnswers as the oracle's: `exact` at least {min(row['exact_agrees'] for row in rows):.5f}, Embree at least"
        f" {min(row['embree_agrees'] for row in rows):.5f} of a mesh's."
    )
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n")


def table(rows: list[dict[str, Any]], counts: list[int]) -> list[str]:
    """Lines of Markdown: for each mesh and number of points the ratio and both times; medians and goals below."""
    lines = [
        f"| mesh | faces | {' | '.join(f'{n:,} points' for n in counts)} | time grows as |",
        f"| --- | ---: | {'---: | ' * len(counts)}--- |",
    ]
    for name in dict.fromkeys(row["mesh"] for row in rows):
        of = {row["points"]: row for row in rows if row["mesh"] == name}
        cells = [f"{of[n]['ratio']:.2f} ({of[n]['exact_ms']:.2f}, {of[n]['embree_ms']:.2f})" for n in counts]
        low, high = of[counts[0]], of[counts[-1]]
        growth = np.log(high["exact_ms"] / low["exact_ms"]) / np.log(counts[-1] / counts[0]) if len(counts) > 1 else 0.0
        lines.append(f"| {name} | {low['faces']:,} | {' | '.join(cells)} | points^{growth:.2f} |")
    for name, of_set in SETS.items():
        medians = [[row["ratio"] for row in rows if row["points"] == n and row["mesh"] in of_set] for n in counts]
        if all(medians):
            lines.append(f"| median, {name} | | {' | '.join(f'{np.median(ratios):.2f}' for ratios in medians)} | |")
    goals = [f"{GOALS[n]:g}" if n in GOALS else "" for n in counts]
    return [*lines, f"| goal | | {' | '.join(goals)} | |"]


if __name__ == "__main__":
    main()
