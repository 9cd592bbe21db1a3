"""The two pictures of docs/exact.md: clusters before a packet of points, and where a sign is certain.

python benchmarks/exact_pictures.py [--out docs]
"""

import argparse
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.collections import PolyCollection
from matplotlib.patches import Rectangle

import zbuf_occlude as zo
from zbuf_occlude import shapes
from zbuf_occlude.exact.bvh import build_bvh
from zbuf_occlude.exact.layout import PACKET
from zbuf_occlude.exact.points import make_packets
from zbuf_occlude.exact.view import project_eyes

EYES = 3.0 * np.array([[np.cos(0.35) * np.cos(0.6), np.cos(0.35) * np.sin(0.6), np.sin(0.35)]])
GREY, BLUE, ORANGE, RED = "#c8ccd0", "#3b78b5", "#e69f3c", "#c0392b"


def projected(matrix: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Positions (..., 3), scene space, as x / w, y / w and w."""
    homogeneous = positions @ matrix[:, :3].T + matrix[:, 3]
    return np.concatenate([homogeneous[..., :2] / homogeneous[..., 2:], homogeneous[..., 2:]], axis=-1)


def box_of(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    flat = places.reshape(-1, 3)
    return flat.min(axis=0), flat.max(axis=0)


def draw_clusters(path: Path) -> None:
    mesh = shapes.make("chair", 3).normalized()
    points = zo.sample_surface(mesh, n_points=6000, seed=0)
    bvh = build_bvh(mesh, 1e-5 * mesh.diagonal)
    packets = make_packets(bvh, points)
    matrix = project_eyes(bvh, EYES, float(packets.farthest)).matrices[0, 0].reshape(3, 4).astype(np.float64)
    corners = projected(matrix, (mesh.corners - bvh.centre) * bvh.scale)
    members = [ids[ids >= 0] for ids in bvh.face_ids]
    figure, axes = plt.subplots(1, 2, figsize=(11, 5.6))
    colours = plt.get_cmap("tab20")(np.arange(len(members)) % 20)
    depth = np.argsort(-corners[..., 2].mean(axis=1))
    of_face = np.zeros(len(mesh.faces), dtype=int)
    for cluster, ids in enumerate(members):
        of_face[ids] = cluster
    axes[0].add_collection(PolyCollection(corners[depth, :, :2], facecolors=colours[of_face[depth]], linewidths=0))
    axes[0].set_title(f"{len(mesh.faces)} faces in {len(members)} clusters of up to 16, one colour each")
    places = projected(matrix, packets.coordinates.T.astype(np.float64)).reshape(-1, PACKET, 3)
    mask = zo.prepare(mesh, method="exact").visible(points, EYES)[0][packets.order].reshape(-1, PACKET)
    sizes = np.ptp(places[..., :2], axis=1).max(axis=1)
    usual = np.abs(sizes - np.median(sizes)) < 0.2 * np.median(sizes)
    mixed = usual & (mask.mean(axis=1) > 0.2) & (mask.mean(axis=1) < 0.8)
    packet = int(np.flatnonzero(mixed)[np.flatnonzero(mixed).size // 2])
    low, high = box_of(places[packet])
    axes[1].add_collection(PolyCollection(corners[:, :, :2], facecolors=GREY, edgecolors="white", linewidths=0.2))
    n_before = 0
    for ids in members:
        first, last = box_of(corners[ids])
        if (first[:2] <= high[:2]).all() and (last[:2] >= low[:2]).all() and first[2] <= high[2]:
            n_before += 1
            axes[1].add_patch(Rectangle(first[:2], *(last - first)[:2], fill=False, ec=BLUE, lw=1.2))
    axes[1].add_patch(Rectangle(low[:2], *(high - low)[:2], fill=False, ec=RED, lw=1.8))
    for seen, colour in ((True, ORANGE), (False, "black")):
        some = places[packet][mask[packet] == seen]
        axes[1].scatter(some[:, 0], some[:, 1], s=14, c=colour, label="visible" if seen else "hidden", zorder=3)
    axes[1].legend(loc="lower left", frameon=False)
    axes[1].set_title(f"one packet (red) and the {n_before} clusters before it (blue)")
    for axis in axes:
        axis.set_aspect("equal")
        axis.autoscale_view()
        axis.invert_yaxis()  # y of the image points down
        axis.axis("off")
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def draw_certainty(path: Path) -> None:
    """A face's three edge functions, in units of their error, over the image; the error is drawn much too large."""
    corners = np.array([[-0.8, -0.55], [0.9, -0.3], [-0.15, 0.75]])
    error = 0.12
    x, y = np.meshgrid(np.linspace(-1.2, 1.2, 600), np.linspace(-0.9, 1.1, 500))
    least = np.full(x.shape, np.inf)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = b - a
        value = edge[0] * (y - a[1]) - edge[1] * (x - a[0])
        least = np.minimum(least, value / (error * np.linalg.norm(edge)))
    figure, axis = plt.subplots(figsize=(7.5, 5))
    axis.contourf(x, y, least, levels=[-1e9, -1.0, 1.0, 1e9], colors=["white", ORANGE, BLUE], alpha=0.75)
    axis.add_patch(plt.Polygon(corners, fill=False, lw=1.6))
    for place, text in (
        ((0.0, -0.05), "all three > blur:\ncertainly within the face"),
        ((0.62, 0.52), "one < -blur:\ncertainly outside"),
        ((-0.93, 0.22), "between:\nfloat64 decides,\nby the definition"),
    ):
        axis.text(*place, text, ha="center", va="center", fontsize=10)
    axis.annotate("", xy=(-0.5, 0.2), xytext=(-0.72, 0.22), arrowprops={"arrowstyle": "->"})
    axis.set_aspect("equal")
    axis.axis("off")
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1] / "docs")
    options = parser.parse_args()
    draw_clusters(options.out / "exact_clusters.png")
    draw_certainty(options.out / "exact_certainty.png")


if __name__ == "__main__":
    main()
