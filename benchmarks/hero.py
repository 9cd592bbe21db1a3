"""README's picture: a mesh and its camera, the complete cloud, the partial cloud, and an HDL-64E scan.

python benchmarks/hero.py --out docs/hero.png
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

import zbuf_occlude as zo
from zbuf_occlude import shapes
from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.drawing.marks import project_to_picture
from zbuf_occlude.drawing.pictures import draw_cloud, draw_mesh, new_figure
from zbuf_occlude.sensors import look_at, make

LENGTH = 4.5
"""Of the car, metres."""
VIEWER = 14.0 * np.array([np.cos(np.radians(-62.0)), np.sin(np.radians(-62.0)), 0.42])
"""From where the pictures are drawn."""
CAMERA = np.array([-2.0, -2.5, 1.9])
"""Where the car is seen from."""
LIDAR = 10.0 * np.array([CAMERA[0], CAMERA[1], 0.0]) / np.hypot(CAMERA[0], CAMERA[1]) + [0.0, 0.0, 1.0]
"""Where the LiDAR stands: on the camera's side, 10 m away, level."""
MIDDLE = np.zeros(3)
ACROSS, UPWARDS = (-3.5, 1.72), (-1.42, 1.8)
"""What a panel shows of the plane through the middle, metres."""
SEEN, GHOST, CAMERAS = "#0b66b0", "#c9ced6", "#d55e00"
"""Colours that the colour-blind can tell apart."""
VIEW = {"eye": VIEWER, "target": MIDDLE, "radius": 3.5}


def frustum(eye: FloatArray, target: FloatArray, depth: float = 0.9, half: float = 0.34) -> list[FloatArray]:
    """Return the lines of a camera's frustum, each (2, 3)."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    corners = [
        eye + depth * forward + half * (x * right + 0.75 * y * up) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    return [np.array([eye, corner]) for corner in corners] + [
        np.array([corners[i], corners[(i + 1) % 4]]) for i in range(4)
    ]


def draw_camera(panel: Axes) -> None:
    """Draw the camera's frustum over what the panel shows."""
    for line in frustum(CAMERA, np.zeros(3)):
        x, y, _ = project_to_picture(line, eye=VIEWER, target=MIDDLE).T
        panel.plot(x, y, color=CAMERAS, linewidth=1.4, solid_capstyle="round")
    x, y, _ = project_to_picture(CAMERA[None], eye=VIEWER, target=MIDDLE)[0]
    panel.plot([x], [y], "o", color=CAMERAS, markersize=5)


def main() -> None:
    """Draw the four panels."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("docs/hero.png"))
    given = parser.parse_args()
    car = shapes.make("car", 1)
    car = zo.Mesh((car.vertices - car.centre) * (LENGTH / car.longest_side), car.faces)
    points = zo.sample_surface(car, n_points=16_000, seed=0)
    with zo.prepare(car, "exact") as occluder:
        visible = occluder.visible(points, CAMERA[None])[0]
    scan = zo.scan(car, make("hdl-64e"), look_at(LIDAR, [0.0, 0.0, LIDAR[2]]), seed=0)
    figure, axes = new_figure(1, 4, panel=3.4)
    mesh_panel, complete_panel, partial_panel, scan_panel = axes[0]
    draw_mesh(mesh_panel, car, colour="#b7bfca", **VIEW)
    draw_cloud(complete_panel, points.positions, normals=points.normals, colour=SEEN, size=2.0, **VIEW)
    draw_cloud(partial_panel, points.positions[~visible], colour=GHOST, size=1.2, **VIEW)
    draw_cloud(partial_panel, points.positions[visible], normals=points.normals[visible], colour=SEEN, size=2.4, **VIEW)
    draw_cloud(scan_panel, points.positions, colour=GHOST, size=0.4, **VIEW)
    draw_cloud(scan_panel, scan.positions, colour=SEEN, size=3.0, **VIEW)
    for panel in (mesh_panel, partial_panel):
        draw_camera(panel)
    titles = (
        f"mesh and camera: {len(car.faces):,} faces",
        f"complete: {len(points.positions):,} points",
        f"partial: {visible.mean():.0%} visible, hidden in grey",
        f"HDL-64E at 10 m: {len(scan.positions):,} returns",
    )
    for panel, title in zip(axes[0], titles, strict=True):
        panel.set_title(title, fontsize=12.5, color="#1f2933")
        panel.set_xlim(*ACROSS)
        panel.set_ylim(*UPWARDS)
    figure.set_size_inches(4 * 3.4, 3.4 * (UPWARDS[1] - UPWARDS[0]) / (ACROSS[1] - ACROSS[0]) + 0.35)
    figure.savefig(given.out, format="png", dpi=130)


if __name__ == "__main__":
    main()
