"""Contact sheets of the built-in shapes: every member drawn small, lit and seen from the front, a PNG a class.

    python benchmarks/shape_sheet.py --out sheets [--label chair] [--count 75] [--columns 15] [--seed 0]

The rasteriser is a dozen lines of numpy, so this needs no graphics library.
"""

import argparse
from pathlib import Path

import matplotlib.image
import numpy as np

from zbuf_occlude import Mesh, shapes


def picture(mesh: Mesh, size: int, azimuth: float, elevation: float) -> np.ndarray:
    """Draw one mesh, orthographic, two-sided shading; (size, size) float in [0, 1]."""
    a, e = np.radians([azimuth, elevation])
    forward = -np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    frame = np.stack([right, np.cross(right, forward), -forward])
    corners = mesh.corners @ frame.T
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    corners = (corners - (low + high) / 2) / (high - low)[:2].max() * 0.94 * size + (size / 2, size / 2, 0)
    face, x, y = covered(corners[..., :2], size)
    weights = barycentric(corners[face][..., :2], x + 0.5, y + 0.5)
    inside = (weights >= 0).all(axis=1)
    face, x, y, weights = face[inside], x[inside], y[inside], weights[inside]
    z = (weights * corners[face][..., 2]).sum(axis=1)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    light = np.array([-0.45, 0.65, 0.6]) / np.linalg.norm([-0.45, 0.65, 0.6])
    shade = np.abs(normals @ light) / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    # of all the writes to one pixel the last stays: the nearest
    order = np.argsort(z)
    pixel = (y * size + x)[order]
    depth, image = np.full(size * size, -4.0 * size), np.ones(size * size)
    depth[pixel], image[pixel] = z[order], 0.18 + 0.68 * shade[face[order]]
    depth, image = depth.reshape(size, size)[::-1], image.reshape(size, size)[::-1]
    # a dark line where the surface steps back
    for axis in (0, 1):
        for shift in (-1, 1):
            step = np.roll(depth, shift, axis=axis) - depth
            image = np.where((step > 0.02 * size) & (depth > -4.0 * size), image * 0.72, image)
    return image


def covered(corners: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """List the pixels of every triangle's bounding box: face, x and y of each pair, (p,) int."""
    first = np.clip(np.floor(corners.min(axis=1)).astype(int), 0, size - 1)
    count = np.clip(np.floor(corners.max(axis=1)).astype(int), 0, size - 1) - first + 1
    n = count.prod(axis=1)
    face = np.repeat(np.arange(len(corners)), n)
    k = np.arange(n.sum()) - np.repeat(np.cumsum(n) - n, n)
    return face, first[face, 0] + k % count[face, 0], first[face, 1] + k // count[face, 0]


def barycentric(corners: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Weights of points in triangles (p, 3, 2), (p, 3); negative outside, and for a triangle seen edge-on."""
    edges = np.roll(corners, -1, axis=1) - corners
    towards = np.stack([x, y], axis=1)[:, None] - corners
    cross = np.roll(edges[..., 0] * towards[..., 1] - edges[..., 1] * towards[..., 0], -1, axis=1)
    total = cross.sum(axis=1, keepdims=True)
    return np.divide(cross, total, out=np.full_like(cross, -1.0), where=np.abs(total) > 1e-9)


def sheet(
    label: str, indices: range, columns: int, size: int, azimuth: float, elevation: float, seed: int
) -> np.ndarray:
    """Draw the members of one class in rows; (rows * size, columns * size) float."""
    tiles = [
        picture(shapes.make(label, index, seed=seed), 2 * size, azimuth, elevation)
        .reshape(size, 2, size, 2)
        .mean(axis=(1, 3))
        for index in indices
    ]
    tiles += [np.ones((size, size))] * (-len(tiles) % columns)
    rows = [np.hstack(tiles[i : i + columns]) for i in range(0, len(tiles), columns)]
    return np.vstack(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--label", action="append", choices=shapes.CLASSES)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=75)
    parser.add_argument("--columns", type=int, default=15)
    parser.add_argument("--size", type=int, default=150, help="pixels a member")
    parser.add_argument("--azimuth", type=float, default=-60.0)
    parser.add_argument("--elevation", type=float, default=22.0)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    indices = range(chosen.first, chosen.first + chosen.count)
    for label in chosen.label or shapes.CLASSES:
        image = sheet(label, indices, chosen.columns, chosen.size, chosen.azimuth, chosen.elevation, chosen.seed)
        file = chosen.out / f"{label}.png"
        matplotlib.image.imsave(file, image, cmap="gray", vmin=0.0, vmax=1.0)
        print(file)


if __name__ == "__main__":
    main()
