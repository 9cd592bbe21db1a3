"""Fresh meshes: prepare and answer once, `exact` against Open3D building its `RaycastingScene` and answering the same.

    python benchmarks/fresh_meshes.py [FOLDER] [--points 20000] [--eyes 100] [--limit N] [--repeats 2] [--no-peer]

For each mesh of FOLDER (default: furniture/ in ZBUF_OCCLUDE_DATA), loaded and sampled beforehand, both sides start from
the arrays: `exact` with `prepare`, Open3D with `add_triangles`; both answer for all eyes. They take turns, `--repeats`
times, and of each the fastest counts. Two ratios: *call alone* leaves out the making of Open3D's rays (as tensors, for
one eye after the other), *with rays* counts it. `exact` takes points and eyes as they are.
"""

import argparse
import os
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

import zbuf_occlude as zo

SUFFIXES = {".obj", ".off", ".ply", ".stl", ".glb"}


class Seconds(NamedTuple):
    """What one mesh took."""

    name: str
    n_faces: int
    exact_prepare: float
    exact: float
    peer_build: float
    peer_rays: float
    peer: float
    agree: float


def peer_answers(mesh: zo.Mesh, points: zo.SurfacePoints, eyes: np.ndarray) -> tuple[np.ndarray, float, float, float]:
    """Open3D's mask, and the seconds of building (with a first ray), of making rays, and of all but these."""
    import open3d

    start, rays_seconds = time.perf_counter(), 0.0
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        open3d.core.Tensor(mesh.vertices.astype(np.float32)), open3d.core.Tensor(mesh.faces.astype(np.uint32))
    )
    scene.test_occlusions(open3d.core.Tensor(np.array([[0, 0, 9, 0, 0, 1]], dtype=np.float32)))
    built = time.perf_counter() - start
    mask = np.empty((len(eyes), len(points)), dtype=bool)
    for row, eye in zip(mask, eyes, strict=True):
        begin = time.perf_counter()
        rays = np.empty((len(points), 6), dtype=np.float32)
        rays[:, :3], rays[:, 3:] = eye, points.positions - eye
        tensor = open3d.core.Tensor(rays)
        rays_seconds += time.perf_counter() - begin
        row[:] = ~scene.test_occlusions(tensor, 0.0, 1.0 - 1e-4).numpy()
    return mask, built, rays_seconds, time.perf_counter() - start - rays_seconds


def exact_answers(mesh: zo.Mesh, points: zo.SurfacePoints, eyes: np.ndarray) -> tuple[np.ndarray, float, float]:
    """The mask of `exact`, and the seconds of preparing and of all."""
    start = time.perf_counter()
    with zo.prepare(mesh, method="exact") as occluder:
        prepared = time.perf_counter() - start
        return occluder.visible(points, eyes), prepared, time.perf_counter() - start


def measure(path: Path, options: argparse.Namespace) -> Seconds:
    mesh = zo.load_mesh(path).normalized()
    points = zo.sample_surface(mesh, n_points=options.points, seed=0)
    eyes = zo.views.fibonacci(options.eyes, distance=4.0).eyes
    ours, theirs, agree = [], [(0.0, 0.0, 0.0)] if options.no_peer else [], 1.0
    for _ in range(options.repeats):
        fresh = zo.Mesh(mesh.vertices, mesh.faces)  # nothing measured yet
        mask, *seconds = exact_answers(fresh, points, eyes)
        ours.append(seconds)
        if not options.no_peer:
            peer, *seconds = peer_answers(mesh, points, eyes)
            theirs.append(seconds)
            agree = float((mask == peer).mean())
    return Seconds(path.stem, len(mesh.faces), *min(ours, key=lambda s: s[1]), *min(theirs, key=lambda s: s[2]), agree)


def report(rows: list[Seconds], options: argparse.Namespace) -> None:
    """Print a table of Markdown."""
    exact, prepare = np.array([row.exact for row in rows]), np.array([row.exact_prepare for row in rows])
    print(
        f"| {len(rows)} meshes, {options.points:,} points, {options.eyes} eyes "
        "| seconds | of it before the first answer | times `exact`: median | total | worst |"
    )
    print("| --- |" + " ---: |" * 5)
    print(f"| `exact` | {exact.sum():.2f} | {prepare.sum():.2f} | | | |")
    if options.no_peer:
        return
    peer, rays = np.array([row.peer for row in rows]), np.array([row.peer_rays for row in rows])
    built = np.array([row.peer_build for row in rows])
    before = f"{built.sum():.2f}, median {np.median(built / prepare):.2f} times"
    for name, seconds, first in (("its calls alone", peer, before), ("with making its rays", peer + rays, "")):
        ratios = seconds / exact
        worst = int(ratios.argmin())
        print(
            f"| Open3D, {name} | {seconds.sum():.2f} | {first} | {np.median(ratios):.2f} "
            f"| {seconds.sum() / exact.sum():.2f} "
            f"| {ratios[worst]:.2f} ({rows[worst].name.partition('__')[0]}, {rows[worst].n_faces:,} faces) |"
        )
    print(f"\nOf a mesh's answers at least {min(row.agree for row in rows):.4f} agree.")


def main() -> None:
    data = Path(os.environ.get("ZBUF_OCCLUDE_DATA", "../shared/data"))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=data / "furniture")
    parser.add_argument("--points", type=int, default=20_000)
    parser.add_argument("--eyes", type=int, default=100)
    parser.add_argument("--limit", type=int)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--no-peer", action="store_true")
    options = parser.parse_args()
    paths = sorted(path for path in options.folder.rglob("*") if path.suffix in SUFFIXES)
    if options.limit:
        paths = paths[:: max(1, len(paths) // options.limit)][: options.limit]
    measure(paths[0], options)  # compiles
    report([measure(path, options) for path in paths], options)


if __name__ == "__main__":
    main()
