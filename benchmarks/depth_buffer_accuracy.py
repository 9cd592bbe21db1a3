"""How wrong `depth_buffer` is, with its refinement and without, and what the refinement costs.

    python benchmarks/depth_buffer_accuracy.py [--points 50000] [--every 1] [--repeats 3] [--data FOLDER]

The paper's 100 views (every N-th with --every), points sampled on the surface, default options. The truth is `exact`,
itself held to the oracle on every 20th view here. Time: both in turn, --repeats times, all 100 views in one call; the
ratio is of the medians. Prints the Markdown table of docs/methods.md.
"""

from functools import partial
from pathlib import Path

import numpy as np
from common import DATA, heads, in_turns, rates, row, run

import zbuf_occlude as zo
from zbuf_occlude import Mesh
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.meshes import shapes

FILES = ("chair/train/chair_0003", "bed/train/bed_0001", "stool/train/stool_0002", "bathtub/train/bathtub_0002")
TINY = 45_000


def meshes(data: Path) -> dict[str, Mesh]:
    found = {}
    for file in FILES:
        path = data / "modelnet" / f"{file}.off"
        if path.exists():
            found[path.stem] = zo.load_mesh(path).normalized()
    return found | {"airplane of tiny faces": shapes.benchmark_mesh(TINY).normalized()}


def measure(name: str, mesh: Mesh, gl: GlContext, n_points: int, every: int, repeats: int) -> float:
    """Print a row of the table; return the share of `exact`'s answers that the oracle disputes."""
    points, eyes = zo.sample_surface(mesh, n_points=n_points, seed=0), zo.views.paper100().eyes
    judged = eyes[::every]
    with zo.prepare(mesh, "exact") as exact:
        truth = exact.visible(points, judged)
    with zo.prepare(mesh, "oracle") as oracle:
        disputed = (truth[::20] != oracle.visible(points, judged[::20])).mean()
    with (
        zo.prepare(mesh, "depth_buffer", gl=gl, refine="none") as plain,
        zo.prepare(mesh, "depth_buffer", gl=gl) as refined,
    ):
        both = {"none": plain, "witness": refined}
        shares = [rates(occluder.visible(points, judged), truth) for occluder in both.values()]
        cells = [f"{share:.4f}" for share in (shares[0][0], *shares[1])]
        jobs = {refine: partial(occluder.visible, points, eyes) for refine, occluder in both.items()}
        seconds = in_turns(jobs, repeats)
    none, witness = (np.median(seconds[refine]) for refine in ("none", "witness"))
    cells += [f"{10 * none:.1f}", f"{10 * witness:.1f}", f"{witness / none:.2f}"]
    row(name, f"{len(mesh.faces):,}", *cells)
    return float(disputed)


def main(*, points: int = 50_000, every: int = 1, repeats: int = 3, data: Path = DATA) -> None:
    with GlContext.open() as gl:
        print(f"{gl.renderer}, {points:,} points\n")
        agreements = "`none` agrees", "`witness` agrees", "false visible", "hidden"
        heads("mesh", "faces", *agreements, "ms per view, none", "witness", "ratio")
        most = max(measure(name, mesh, gl, points, every, repeats) for name, mesh in meshes(data).items())
    print(f"\nAnswers are held against those of `exact`, with which the oracle disagrees in {most:.1e} at most.")


if __name__ == "__main__":
    run(main, __doc__)
