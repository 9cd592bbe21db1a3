"""How different the members of each built-in class are: face counts and Chamfer distances, as a Markdown table.

    python benchmarks/shape_distances.py [--label chair] [--members 75] [--seed 0] [--points 512]

The distance between two members, both normalized (longest side 1, centred), is the mean over points of one of how
far the nearest point of the other is, averaged over both directions: `points` random points asked against 64 times
as many. Sampling alone leaves a distance between two clouds of one member, "same"; the last column is the smallest
quotient of a distance and the mean "same" of its two members.
"""

from collections.abc import Sequence

import numpy as np
from common import heads, row, run
from scipy.spatial import cKDTree

from zbuf_occlude import Mesh, sample_surface
from zbuf_occlude.meshes import shapes

DENSER = 64


class Clouds:
    """A sparse and a dense sampling of one normalized mesh."""

    def __init__(self, mesh: Mesh, n_points: int, seed: int) -> None:
        sparse, dense = np.random.SeedSequence(seed).spawn(2)
        normal = mesh.normalized()
        self.points = sample_surface(normal, n_points=n_points, seed=sparse).positions
        self.tree = cKDTree(sample_surface(normal, n_points=n_points * DENSER, seed=dense).positions)


def chamfer(a: Clouds, b: Clouds) -> float:
    """Return the symmetric mean distance to the nearest point, in longest sides."""
    return 0.5 * float(b.tree.query(a.points)[0].mean() + a.tree.query(b.points)[0].mean())


def distances(clouds: list[Clouds]) -> np.ndarray:
    """Return all distances between members, (n, n), infinity on the diagonal."""
    n = len(clouds)
    matrix = np.full((n, n), np.inf)
    for i in range(n):
        for j in range(i):
            matrix[i, j] = matrix[j, i] = chamfer(clouds[i], clouds[j])
    return matrix


def measure(label: str, members: int, seed: int, n_points: int) -> None:
    """Print the row of one class."""
    meshes = [shapes.make(label, index, seed=seed) for index in range(members)]
    clouds = [Clouds(mesh, n_points, seed=1) for mesh in meshes]
    again = [Clouds(mesh, n_points, seed=2) for mesh in meshes]
    matrix = distances(clouds)
    same = np.array([chamfer(*pair) for pair in zip(clouds, again, strict=True)])
    i, j = np.unravel_index(matrix.argmin(), matrix.shape)
    faces = [len(mesh.faces) for mesh in meshes]
    counts = [f"{count:,}" for count in (min(faces), int(np.median(faces)), max(faces))]
    measures = (np.median(matrix.min(axis=1)), np.median(matrix[np.isfinite(matrix)]), same.max())
    ratio = (2 * matrix / (same[:, None] + same)).min()
    row(label, *counts, f"{matrix.min():.4f}", f"{j}, {i}", *(f"{value:.4f}" for value in measures), f"{ratio:.2f}")


def main(
    *, label: Sequence[str] = shapes.CLASSES, members: int = shapes.MEMBERS, seed: int = 0, points: int = 512
) -> None:
    faces, distances = ("fewest faces", "median", "most"), ("smallest distance", "between", "median of the nearest")
    heads("class", *faces, *distances, "median of all", "largest same", "smallest quotient", words=10)
    for each in label:
        measure(each, members, seed, points)


if __name__ == "__main__":
    run(main, __doc__, label=shapes.CLASSES)
