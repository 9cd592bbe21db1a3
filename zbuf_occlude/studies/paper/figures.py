"""The paper's figures 4, 7, 8, 10, 11 and 12 of any mesh, and figure 9, the objects made by formulas."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.drawing.marks import project_to_picture
from zbuf_occlude.drawing.pictures import GREY, canvas, draw_cloud, draw_mesh, new_figure
from zbuf_occlude.engines.object_space.division import divide_faces
from zbuf_occlude.engines.object_space.occupancy import OccupancyGrid
from zbuf_occlude.geometry.camera import view_matrices
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints, sample_surface
from zbuf_occlude.meshes.shapes import formulas
from zbuf_occlude.views import PAPER_DISTANCE, Views, paper100
from zbuf_occlude.visibility import prepare

ORIGIN = np.zeros(3)
PLANES = ("y-z", "x-z", "x-y")
"""Planes of projection, in the order of `projected_areas`."""
Mask = Callable[[Mesh, SurfacePoints, FloatArray], BoolArray]
"""Function of a mesh, n points and eyes (k, 3) that returns the visibility mask (k, n)."""


@dataclass(frozen=True, eq=False)
class Exhibit:
    """Object of a figure."""

    mesh: Mesh  # longest side 1, about the origin
    mask: Mask
    seed: int = 0
    scan: FloatArray | None = None  # (n, 3), metres, scanner at the origin, z up; last row of fig. 7
    distance: float = PAPER_DISTANCE  # distance of the cameras from the centre


@dataclass(frozen=True)
class PaperFigure:
    """A figure of the paper."""

    draw: Callable[[Exhibit], Figure]
    kind: str  # class of the built-in shape drawn by default; empty for a figure with its own objects
    summary: str
    masked: bool = True  # True if the figure uses the exhibit's mask


def make_mask(method: str, options: dict[str, Any]) -> Mask:
    """Return the function that computes masks by a method of the table."""

    def mask(mesh: Mesh, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        with prepare(mesh, method, **options) as occluder:
            return occluder.visible(points, eyes)

    return mask


def eye_at(azimuth: float, elevation: float, distance: float = 4.0) -> FloatArray:
    """Return the position of a view about the origin; degrees."""
    return Views(np.radians([azimuth]), np.radians([elevation]), np.array([distance])).eyes[0]


def radius_of(mesh: Mesh) -> float:
    """Return half the side of a panel that shows a centred mesh from any direction."""
    return 0.52 * mesh.diagonal


def figure_4(exhibit: Exhibit) -> Figure:
    """Draw the division of large faces: before and after."""
    mesh = exhibit.mesh
    division = divide_faces(mesh, 1.0 / 600.0, max(20_000, len(mesh.faces)))
    figure, axes = new_figure(1, 2, panel=4.2)
    for panel, drawn, letter in zip(axes[0], (mesh, division.mesh), "AB", strict=True):
        draw_mesh(panel, drawn, eye=eye_at(35, 28), target=ORIGIN, edges=True, colour="#8fb4dd")
        title(panel, f"({letter}) {len(drawn.faces):,} faces")
    return figure


SIDES = ((0, 0, "the camera"), (90, 0, "its right"), (180, 15, "behind"))
"""Viewpoints relative to the camera: azimuth and elevation in degrees, and a name."""


def figure_7(exhibit: Exhibit) -> Figure:
    """Draw mesh, full sampling and occupancy grid; the occluded cloud and a real scan from three sides."""
    mesh, seed = exhibit.mesh, exhibit.seed
    points = sample_surface(mesh, n_points=100_000, seed=seed)
    azimuth, elevation = 40.0, 20.0
    seen = points.select(exhibit.mask(mesh, points, eye_at(azimuth, elevation, exhibit.distance)[None])[0])
    fewer = seen.select(np.random.default_rng(seed).permutation(len(seen))[:6_000])
    figure, axes = new_figure(2 if exhibit.scan is None else 3, 3, panel=3.4)
    fixed: dict[str, Any] = {"eye": eye_at(azimuth, elevation), "target": ORIGIN, "radius": radius_of(mesh)}
    draw_mesh(axes[0, 0], mesh, edges=len(mesh.faces) < 6_000, **fixed)
    title(axes[0, 0], f"(A) mesh, {len(mesh.faces):,} faces")
    draw_cloud(axes[0, 1], points.positions, normals=points.normals, **fixed)
    title(axes[0, 1], f"(B) sampled, {len(points):,} points")
    grid = OccupancyGrid(mesh.bounds, 64, points.positions)
    draw_mesh(axes[0, 2], cells_as_mesh(grid.occupied), **fixed)
    title(axes[0, 2], f"(C) grid 64³, {int(grid.occupied.sum()):,} cells")
    for panel, letter, (turn, rise, where) in zip(axes[1], "DEF", SIDES, strict=True):
        eye = eye_at(azimuth + turn, elevation + rise)
        draw_cloud(panel, fewer.positions, normals=fewer.normals, eye=eye, target=ORIGIN, radius=radius_of(mesh))
        title(panel, f"({letter}) occluded, from {where}")
    if exhibit.scan is not None:
        low, high = exhibit.scan.min(axis=0), exhibit.scan.max(axis=0)
        cloud = (exhibit.scan - (low + high) / 2) / float((high - low).max())
        x, y, z = -(low + high) / 2  # direction of the scanner
        azimuth, elevation = np.degrees(np.arctan2([y, z], [x, np.hypot(x, y)]))
        for panel, letter, (turn, rise, where) in zip(axes[2], "GHI", SIDES, strict=True):
            eye = eye_at(azimuth + turn, min(89.0, elevation + rise))
            draw_cloud(panel, cloud, eye=eye, target=ORIGIN, radius=0.52 * float(np.linalg.norm(np.ptp(cloud, axis=0))))
            title(panel, f"({letter}) real scan, {len(cloud):,} points, from {where.replace('camera', 'scanner')}")
    return figure


def figure_8(exhibit: Exhibit) -> Figure:
    """Draw the object with the camera, the result of HSR by vertices (large faces divided), and a sampled cloud."""
    mesh, seed = exhibit.mesh, exhibit.seed
    camera = eye_at(20, 25, 1.9)
    divided = divide_faces(mesh, 1.0 / 4000.0, max(20_000, len(mesh.faces))).mesh
    ids = np.arange(len(divided.faces), dtype=np.int32)
    centres = SurfacePoints(divided.corners.mean(axis=1), ids, np.zeros((len(ids), 3)))
    with prepare(divided, "vertex_hsr") as occluder:
        kept = occluder.visible(centres, camera[None])[0]
    figure, axes = new_figure(1, 3, panel=3.8)
    fixed: dict[str, Any] = {"eye": eye_at(95, 28, 6.0), "target": camera * 0.36, "radius": 1.2}
    draw_mesh(axes[0, 0], mesh, **fixed)
    draw_camera(axes[0, 0], camera, ORIGIN, **fixed)
    title(axes[0, 0], "(A) object and camera")
    near: dict[str, Any] = {"eye": eye_at(95, 28), "target": ORIGIN, "radius": radius_of(mesh)}
    if kept.any():
        left = Mesh(divided.vertices, divided.faces[kept], mesh.name)
        draw_mesh(axes[0, 1], left, **near)
        cloud = sample_surface(left, n_points=6_000, seed=seed)
        draw_cloud(axes[0, 2], cloud.positions, normals=cloud.normals, **near)
    title(axes[0, 1], f"(B) after HSR: {int(kept.sum()):,} of {len(kept):,} faces")
    title(axes[0, 2], "(C) sampled")
    return figure


def figure_9(exhibit: Exhibit) -> Figure:
    """Draw the built-in objects made by formulas; the exhibit is not used."""
    objects = list(formulas.collection())
    figure, axes = new_figure(-(-len(objects) // 7), 7, panel=1.7)
    for panel, entry in zip(axes.flat, objects, strict=False):
        mesh = entry.load()
        draw_mesh(panel, mesh, eye=eye_at(35, 28), target=ORIGIN, radius=radius_of(mesh), colour="#8fb4dd")
        title(panel, entry.label.replace("_", " "))
    return figure


def figure_10(exhibit: Exhibit) -> Figure:
    """Draw four azimuths: above from a fixed viewpoint, below from each camera."""
    return _four_views(exhibit, [(azimuth, 20.0) for azimuth in (0.0, 72.0, 144.0, 216.0)], "azimuth")


def figure_11(exhibit: Exhibit) -> Figure:
    """Draw four elevations: above from a fixed viewpoint, below from each camera."""
    return _four_views(exhibit, [(30.0, elevation) for elevation in (-60.0, -20.0, 20.0, 60.0)], "elevation")


def figure_12(exhibit: Exhibit) -> Figure:
    """Plot the projected area of the visible part on the coordinate planes against the camera's elevation."""
    views = paper100(exhibit.distance)
    areas = projected_areas(exhibit.mesh, exhibit.mask, views, exhibit.seed)
    elevations = degrees(views.elevation)
    levels = np.unique(elevations)
    figure, axes = canvas(11.0, 3.6, 3)
    for axis, (panel, plane) in enumerate(zip(axes, PLANES, strict=True)):
        by_level = [areas[elevations == level, axis] for level in levels]
        panel.fill_between(
            levels, [a.min() for a in by_level], [a.max() for a in by_level], color="#0072b2", alpha=0.15
        )
        panel.plot(levels, [a.mean() for a in by_level], color="#0072b2", marker="o", markersize=3.5)
        panel.set_title(f"onto the {plane} plane", fontsize=11)
        panel.set_xticks(range(-90, 91, 30))
        panel.set_ylim(0, None)
        panel.set_xlabel("elevation of the camera, degrees", fontsize=9)
    axes[0].set_ylabel("area, longest side = 1", fontsize=9)
    figure.suptitle(
        "Sum over the visible points of area element × |normal component|; mean and range over the azimuths",
        fontsize=9,
        color=GREY,
    )
    return figure


def degrees(elevations: Any) -> Any:
    """Return elevations (radians) as whole degrees."""
    return np.round(np.degrees(elevations)).astype(int)


def projected_areas(mesh: Mesh, mask: Mask, views: Views, seed: int, n_points: int = 20_000) -> FloatArray:
    """Return the projected areas (k, 3) of the visible part on the planes across x, y and z, for k views.

    An area is the sum over the visible ones of `n_points` samples of area element times absolute component of the unit
    normal; overlapping layers of the visible part all count. The paper (4.2, Fig. 12) does not define its area; this
    definition is ours.
    """
    points = sample_surface(mesh, n_points=n_points, seed=seed)
    visible = mask(mesh, points, views.eyes)
    return np.asarray(visible @ np.abs(points.normals) * (mesh.areas.sum() / n_points))


def cells_as_mesh(occupied: BoolArray) -> Mesh:
    """Return the surface of a grid's occupied cells as triangles; the grid is the unit cube about the origin."""
    n = len(occupied)
    padded = np.pad(occupied, 1)
    quads = []
    for axis in range(3):
        for side in (0, 1):
            bare = occupied & ~np.roll(padded, 1 - 2 * side, axis)[1:-1, 1:-1, 1:-1]
            cells = np.argwhere(bare).astype(np.float64)
            u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
            corner = cells + side * np.eye(3)[axis]
            quads.append(np.stack([corner, corner + u, corner + u + v, corner + v], axis=1))
    corners = np.concatenate(quads) / n - 0.5
    first = 4 * np.arange(len(corners))[:, None]
    faces = np.concatenate([np.add(first, [0, 1, 2]), np.add(first, [0, 2, 3])])
    return Mesh(corners.reshape(-1, 3), faces, "cells")


def draw_camera(axes: Axes, camera: FloatArray, looks_at: FloatArray, **view: Any) -> None:
    """Draw a camera as a small pyramid with a dashed line of sight; `view` as for `draw_mesh`."""
    backwards = view_matrices(camera[None], looks_at)[0, :3, :3]
    corners = np.array([[x, y, -0.26] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]) * [0.15, 0.11, 1.0]
    at = {"eye": view["eye"], "target": view["target"]}
    x, y, _ = project_to_picture(np.concatenate([[camera], camera + corners @ backwards, [looks_at]]), **at).T
    for a, b in ((0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (2, 3), (3, 4), (4, 1)):
        axes.plot(x[[a, b]], y[[a, b]], color="#222222", linewidth=1.3)
    axes.plot(x[[0, 5]], y[[0, 5]], color="#222222", linewidth=0.8, linestyle=(0, (4, 4)), zorder=0)


def title(axes: Axes, text: str) -> None:
    """Write a panel's title."""
    axes.set_title(text, fontsize=10, color=GREY)


def _four_views(exhibit: Exhibit, angles: Sequence[tuple[float, float]], varied: str) -> Figure:
    mesh = exhibit.mesh
    points = sample_surface(mesh, n_points=12_000, seed=exhibit.seed)
    eyes = np.stack([eye_at(*angle, exhibit.distance) for angle in angles])
    visible = exhibit.mask(mesh, points, eyes)
    figure, axes = new_figure(2, len(angles), panel=2.9)
    for column, (eye, seen) in enumerate(zip(eyes, visible, strict=True)):
        cloud = points.select(seen)
        for row, viewpoint in enumerate((eye_at(110, 20), eye)):
            panel = axes[row, column]
            draw_cloud(
                panel, cloud.positions, normals=cloud.normals, eye=viewpoint, target=ORIGIN, radius=radius_of(mesh)
            )
        angle = angles[column][0 if varied == "azimuth" else 1]
        title(axes[0, column], f"{varied} {angle:.0f}°, {seen.mean():.0%} visible")
    figure.suptitle("Above: from a fixed viewpoint. Below: from each camera.", fontsize=10, color=GREY)
    return figure


FIGURES = {
    "fig4": PaperFigure(figure_4, "table", "division of large faces", masked=False),
    "fig7": PaperFigure(figure_7, "car", "mesh, sampling, grid, and an occluded cloud from three sides"),
    "fig8": PaperFigure(figure_8, "chair", "object with camera, result of HSR, cloud", masked=False),
    "fig9": PaperFigure(figure_9, "", "objects made by formulas", masked=False),
    "fig10": PaperFigure(figure_10, "chair", "clouds at four azimuths"),
    "fig11": PaperFigure(figure_11, "airplane", "clouds at four elevations"),
    "fig12": PaperFigure(figure_12, "airplane", "projected area of the visible part against elevation"),
}
