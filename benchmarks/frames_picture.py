"""The picture of docs/frames.md: what a frame holds, the visible part, masks, pairs, coverage, voxels, occlusions.

python benchmarks/frames_picture.py --out docs/frames.png
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import ListedColormap

import zbuf_occlude as zo
from zbuf_occlude import shapes
from zbuf_occlude.drawing.pictures import draw_mesh, new_figure
from zbuf_occlude.scenes import Placed, Scene, moved

SIZE = {"width": 480, "height": 400, "fov": 32.0}
COLOURS = np.array([[0x0B, 0x66, 0xB0], [0xD5, 0x5E, 0x00], [0x00, 0x9E, 0x73]], np.uint8)
"""Of the objects; the colour-blind can tell them apart."""
VIEWER = (1.6, -3.4, 2.2)
"""From where the visible part is drawn."""


def main() -> None:
    """Draw the ten panels."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("docs/frames.png"))
    given = parser.parse_args()
    chair, table, bottle = (shapes.make(name, 3).normalized() for name in ("chair", "table", "bottle"))
    placed = [
        Placed(chair, "chair"),
        Placed(table, "table", moved(to=(-1.0, -0.15, -0.25), yaw=0.4)),
        Placed(bottle, "bottle", moved(to=(0.3, 0.5, -0.3), scale=0.4)),
    ]
    scene = Scene.joined(placed)
    view = zo.views.from_angles(20, 22, distance=3.6)
    (frame,) = zo.frames(scene, view, **SIZE)
    white = np.full((*frame.depth.shape, 3), 255, np.uint8)
    near, far = frame.depth[frame.mask].min(), frame.depth[frame.mask].max()
    shaded = colormaps["viridis_r"]((np.where(frame.mask, frame.depth, far) - near) / (far - near))[..., :3] * 255
    pictures = {
        "shaded": frame.picture[..., :3],
        "depth": shaded.astype(np.uint8),
        "normals": ((frame.normals + 1.0) * 127.5).astype(np.uint8),
        "instances": COLOURS[frame.instances],
    }
    figure, axes = new_figure(2, 5, panel=3.0)
    for panel, (title, picture) in zip(axes[0], pictures.items(), strict=False):
        panel.imshow(np.where(frame.mask[..., None], picture, white))
        panel.set_title(title)
    part = zo.visible_mesh(chair, view.eyes[0]).mesh
    draw_mesh(axes[0][4], part, eye=np.array(VIEWER), target=np.zeros(3), radius=0.75, colour="#b7bfca")
    axes[0][4].set_title("its visible part, from aside")
    (alone,) = zo.frames(Scene.joined(placed[1:2]), view, **SIZE)
    picture = white.copy()
    picture[alone.mask] = 0xF2, 0xC9, 0xA5
    picture[frame.instances == 1] = COLOURS[1]
    axes[1][0].imshow(picture)
    axes[1][0].set_title("mask and mask_visib of the table")
    draw_pair(axes[1][1], chair, zo.views.parse("ring:6@25").around(chair.centre, 1.0).eyes[:2])
    found = zo.coverage(chair, zo.views.for_mesh(chair, "fibonacci:8").eyes)
    axes[1][2].set_axis_on()
    axes[1][2].bar(range(8), 100 * found.alone, color="#b8c4ce")
    axes[1][2].plot(range(8), 100 * found.together, color="#0b66b0", marker="o", markersize=3)
    axes[1][2].set_ylim(0, 100)
    axes[1][2].set_title("% seen: by view, together")
    grid = zo.visibility_grid(chair, view.eyes[0], n=64)
    axes[1][3].imshow(grid.states[:, 32].T, origin="lower", cmap=ListedColormap(["#5b6673", "#e8eef4", "#d55e00"]))
    axes[1][3].set_title("voxels: hidden, free, surface")
    graph = zo.occlusion_graph(scene, view.eyes[0])
    axes[1][4].set_axis_on()
    axes[1][4].imshow(graph.shares, cmap="Blues", vmin=0, vmax=1)
    for a, b in np.argwhere(graph.shares > 0):
        axes[1][4].text(b, a, f"{graph.shares[a, b]:.0%}", ha="center", va="center")
    axes[1][4].set_xticks(range(3), graph.labels)
    axes[1][4].set_yticks(range(3), graph.labels, rotation=90, va="center")
    axes[1][4].set_title("share of the row hidden by")
    figure.savefig(given.out, format="png", dpi=90)


def draw_pair(axes: Any, mesh: zo.Mesh, eyes: np.ndarray) -> None:
    """Draw what both of two cameras see, and what one does, from the middle between them."""
    points = zo.sample_surface(mesh, n_points=8_000, seed=0)
    with zo.prepare(mesh, "exact") as occluder:
        first, second = occluder.visible(points, eyes)
    back = eyes.mean(axis=0) / np.linalg.norm(eyes.mean(axis=0))
    right = np.cross([0, 0, 1], back)
    right /= np.linalg.norm(right)
    places = points.positions @ np.stack([right, np.cross(back, right)], axis=1)
    for seen, colour in ((first & ~second, COLOURS[0]), (second & ~first, COLOURS[1]), (first & second, COLOURS[2])):
        axes.scatter(*places[seen].T, s=1.5, color=colour / 255, linewidths=0)
    axes.set_aspect("equal")
    axes.set_title(f"a pair: {(first & second).sum() / first.sum():.0%} overlap, in green")


if __name__ == "__main__":
    main()
