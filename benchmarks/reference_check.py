"""Check of the reference: oracle against exact_hsr and Embree on every point; rational arithmetic decides the rest.

    python benchmarks/reference_check.py MESH [MESH ...] [--points 5000] [--views paper100] [--seed 0]

For each mesh: the boundary band's share; how often `exact_hsr` (perpendicular planes, float64) and `embree` (own face
excluded, float32) differ from `oracle` (signed volumes, float64), in all and outside the band; and of each pair on
which two of them differ, whom rational arithmetic proves right. Exits with 1 when the oracle is proved wrong outside
the band, when exact_hsr differs from it there, or when Embree agrees on less than 99.99 %.
"""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from common import run

import zbuf_occlude as zo
from tests.rational import sees
from zbuf_occlude.meshes.load import load_mesh
from zbuf_occlude.visibility.methods import oracle

MAX_DISPUTES = 300
"""This many disputes are decided at most, on one mesh and with one rival; a few seconds each on large meshes."""


def main(meshes: Sequence[Path], *, points: int = 5000, views: str = "paper100", seed: int = 0) -> int:
    failed = False
    for path in meshes:
        mesh = load_mesh(path).normalized()
        sampled = zo.sample_surface(mesh, n_points=points, seed=seed)
        failed |= check(mesh, sampled, zo.views.parse(views).eyes)
    return int(failed)


def check(mesh: zo.Mesh, points: zo.SurfacePoints, eyes: np.ndarray) -> bool:
    """Print the figures of one mesh; True when something is wrong."""
    start = time.perf_counter()
    reference = oracle.prepare(mesh)
    truth, decided = reference.visible(points, eyes), reference.decided(points, eyes)
    print(f"{mesh.name}: {len(mesh.faces):,} faces, {len(points):,} points, {len(eyes)} views = {truth.size:,} pairs")
    print(f"  visible {truth.mean():.4f}; in the boundary band {(~decided).sum():,} pairs, {(~decided).mean():.2e}")
    failed = False
    for rival in ("exact_hsr", "embree"):
        with zo.prepare(mesh, rival) as occluder:
            differs = occluder.visible(points, eyes) != truth
        outside = int((differs & decided).sum())
        agreement = 1.0 - differs.mean()
        differing = f"{differs.sum()} pairs, {outside} of them outside the band"
        print(f"  {rival}: agrees on {100 * agreement:.5f} %; differs on {differing}")
        oracle_right, oracle_wrong, wrong_outside = decide(
            mesh, points, eyes, truth, differs, decided, reference.contact
        )
        lost = f"{rival} right {oracle_wrong} ({wrong_outside} of these outside the band)"
        print(f"    rational arithmetic: oracle right {oracle_right}, {lost}")
        failed |= wrong_outside > 0 or (outside > 0 if rival == "exact_hsr" else agreement < 0.9999)
    print(f"  {time.perf_counter() - start:.0f} s{'; FAILED' if failed else ''}")
    return failed


def decide(
    mesh: zo.Mesh,
    points: zo.SurfacePoints,
    eyes: np.ndarray,
    truth: np.ndarray,
    differs: np.ndarray,
    decided: np.ndarray,
    contact: float,
) -> tuple[int, int, int]:
    """Count the disputes that the oracle wins, that its rival wins, and those of the latter outside the band."""
    disputes = np.argwhere(differs)
    if len(disputes) > MAX_DISPUTES:
        print(f"    (deciding {MAX_DISPUTES} of {len(disputes)} disputes, evenly chosen)")
        disputes = disputes[np.linspace(0, len(disputes) - 1, MAX_DISPUTES).astype(int)]
    proved = [sees(mesh, eyes[j], points.positions[i], int(points.face_ids[i]), contact) for j, i in disputes]
    right = np.array(proved, dtype=bool) == truth[tuple(disputes.T)]
    outside = decided[tuple(disputes.T)] & ~right
    return int(right.sum()), int((~right).sum()), int(outside.sum())


if __name__ == "__main__":
    run(main, __doc__)
