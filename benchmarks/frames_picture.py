"""The picture of docs/frames.md: what a frame holds, and the part of a mesh that its camera sees.

python benchmarks/frames_picture.py --out docs/frames.png
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib import colormaps

import zbuf_occlude as zo
from zbuf_occlude import shapes
from zbuf_occlude.drawing.pictures import draw_mesh, new_figure
from zbuf_occlude.scenes import Placed, moved

SIZE = {"width": 480, "height": 400, "fov": 32.0}
COLOURS = np.array([[0x0B, 0x66, 0xB0], [0xD5, 0x5E, 0x00], [0x00, 0x9E, 0x73]], np.uint8)
"""Of the objects; the colour-blind can tell them apart."""
VIEWER = (1.6, -3.4, 2.2)
"""From where the visible part is drawn."""


def main() -> None:
    """Draw the five panels."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("docs/frames.png"))
    given = parser.parse_args()
    chair, table, bottle = (shapes.make(name, 3).normalized() for name in ("chair", "table", "bottle"))
    placed = [
        Placed(chair, "chair"),
        Placed(table, "table", moved(to=(-1.0, -0.15, -0.25), yaw=0.4)),
        Placed(bottle, "bottle", moved(to=(0.3, 0.5, -0.3), scale=0.4)),
    ]
    scene = zo.Scene.joined(placed)
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
    figure, axes = new_figure(1, 5, panel=3.0)
    for panel, (title, picture) in zip(axes[0], pictures.items(), strict=False):
        panel.imshow(np.where(frame.mask[..., None], picture, white))
        panel.set_title(title)
    part = zo.visible_mesh(chair, view.eyes[0]).mesh
    draw_mesh(axes[0][4], part, eye=np.array(VIEWER), target=np.zeros(3), radius=0.75, colour="#b7bfca")
    axes[0][4].set_title("its visible part, from aside")
    figure.savefig(given.out, format="png", dpi=90)


if __name__ == "__main__":
    main()
