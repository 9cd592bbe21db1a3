"""Which cells are a cell's own surface: python benchmarks/own_surface.py [MESH ...]

The table of docs/object_space.md: agreement with `exact` on meshes (built-in shapes, unless files are named), and how
many visible points are lost on the fronts of a sphere, a box and a cylinder, seen at more than 30 degrees from their
plane.
"""

from pathlib import Path

import numpy as np
from common import heads, rates, row, run

import zbuf_occlude as zo
from zbuf_occlude.meshes import shapes

VARIANTS = (("touching cells", 1, 1), ("touching, and an unbroken run to 3 cells", 1, 3))
VARIANTS += (("all within 2 cells, a run to 4", 2, 4), ("all within 3 cells", 3, 3))
SIZES = (32, 64, 128)
N_POINTS, STEEP = 10_000, np.radians(30)


def answers(mesh: zo.Mesh, n: int, touching: int, run: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the grid's answer, the truth, and the sine of the angle between lines of sight and faces; (k, n) each."""
    views = zo.views.paper100()
    eyes = views.select(np.arange(0, 100, 8)).around(mesh.centre, mesh.longest_side).eyes
    points = zo.sample_surface(mesh, n_points=N_POINTS, seed=0)
    with zo.prepare(mesh, "exact") as reference:
        truth = reference.visible(points, eyes)
    n_samples = 400_000 if n > 64 else 100_000
    with zo.prepare(mesh, "occupancy_grid", n=n, n_samples=n_samples, touching=touching, run=run) as grid:
        answer = grid.visible(points, eyes)
    towards = eyes[:, None] - points.positions[None]
    sine = np.abs(np.einsum("knx,nx->kn", towards, points.normals)) / np.linalg.norm(towards, axis=2)
    return answer, truth, sine


def main(*files: Path) -> None:
    meshes = [zo.load_mesh(path) for path in files] or [shapes.make(label, 0) for label in shapes.CLASSES]
    fronts = [shapes.solids.icosphere(4), shapes.solids.box(), shapes.formulas.make("cylinder")]
    heads("own surface", "n", "agreement", "false visible", "false hidden", "front", words=6)
    for name, touching, length in VARIANTS:
        for n in SIZES:
            pairs = [answers(mesh, n, touching, length) for mesh in meshes]
            shares = np.mean([rates(answer, truth) for answer, truth, _ in pairs], axis=0)
            seen = [(a, t & (sine > np.sin(STEEP))) for a, t, sine in (answers(m, n, touching, length) for m in fronts)]
            front = sum((~a & t).sum() for a, t in seen) / sum(t.sum() for _, t in seen)
            row(name, n, *(f"{share:.3f}" for share in shares), f"{front:.1%}")


if __name__ == "__main__":
    run(main, __doc__)
