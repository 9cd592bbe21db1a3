"""Pictures of clouds and meshes from an eye, drawn into matplotlib axes without a display or global state."""

from functools import cache
from typing import Any

import numpy as np
from matplotlib import font_manager
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.ft2font import FT2Font
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.jit.compiler import njit
from zbuf_occlude.drawing import marks
from zbuf_occlude.drawing.marks import (
    area_of_mark,
    axes_of_eye,
    lambert,
    lit_colours,
    marks_of,
    picture_frame,
    project_to_picture,
)
from zbuf_occlude.geometry.mesh import Mesh

COLOUR = to_hex(marks.COLOUR)
"""Default colour of surfaces."""
GREY = "#555555"
"""Colour of axes and titles."""
MESH_PIXELS = 1200
"""Side of the image that `draw_mesh` rasterises; matplotlib scales it to the axes."""


def blank_figure(width: float, height: float) -> Figure:
    """Return a white figure of a size in inches, on the Agg backend."""
    figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def new_figure(n_rows: int, n_columns: int, *, panel: float = 3.0) -> tuple[Figure, NDArray[Any]]:
    """Return a figure on the Agg backend and its (n_rows, n_columns) array of bare axes, `panel` inches a side."""
    figure = blank_figure(panel * n_columns, panel * n_rows)
    axes = figure.subplots(n_rows, n_columns, squeeze=False)
    for each in axes.flat:
        each.set_axis_off()
    return figure, axes


def canvas(width: float, height: float, columns: int = 1, rows: int = 1, **options: Any) -> tuple[Figure, Any]:
    """Return a styled figure of a size in inches, and its axes (rows, columns), or (columns,) for one row."""
    figure = blank_figure(width, height)
    panels = figure.subplots(rows, columns, squeeze=False, **options)
    for axes in panels.flat:
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#e6e6e6", linewidth=0.7)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=9, colors=GREY)
    return figure, panels[0] if rows == 1 else panels


def font_file_for(text: str) -> str | None:
    """Return an installed font with every character of a text, matplotlib's own if possible; None if there is none."""
    wanted = set(map(ord, text))
    fonts = sorted(font_manager.fontManager.ttflist, key=lambda font: (font.name, font.fname))
    files = [font_manager.findfont(font_manager.FontProperties()), *(font.fname for font in fonts)]
    return next((file for file in files if wanted <= _characters(file)), None)


@cache
def _characters(font_file: str) -> frozenset[int]:
    """Return the code points of a font."""
    return frozenset(FT2Font(font_file).get_charmap())


def draw_cloud(
    axes: Axes,
    positions: ArrayLike,
    *,
    eye: ArrayLike,
    target: ArrayLike,
    up: ArrayLike | None = None,
    normals: ArrayLike | None = None,
    values: ArrayLike | None = None,
    colour: str = COLOUR,
    size: float | None = None,
    radius: float | None = None,
    perspective: bool = True,
) -> None:
    """Draw a cloud from an eye: nearer points on top, shaded to show the shape.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    positions : (n, 3) float
        World space.
    eye, target, up, perspective
        As in `zbuf_occlude.drawing.marks.project_to_picture`.
    normals : (n, 3) float, optional
        Unit normals, either sign, for a light over the viewer's shoulder. Without them only depth shades the points.
    values : (n, 3) float, optional
        RGB in [0, 1] for each point instead of `colour`; also shaded.
    colour : str
        Any matplotlib colour.
    size : float, optional
        Area of a point's mark in points squared. By default it follows from the number of points and the panel's size.
    radius : float, optional
        Half the picture's side in world units, with the target in the centre: gives several panels one scale. By
        default the picture fits the cloud.

    Notes
    -----
    Nothing is hidden: points behind others are drawn first and lighter. Pass only visible points to show the view of
    the eye.
    """
    marks_xy, shaded = marks_of(
        positions,
        eye=eye,
        target=target,
        up=up,
        normals=normals,
        values=values,
        colour=to_rgb(colour),
        perspective=perspective,
    )
    _frame(axes, marks_xy, radius)
    if not len(marks_xy):
        return
    if size is None:
        panel, (left, right) = axes.get_window_extent(), axes.get_xlim()
        size = area_of_mark(marks_xy, (right - left) / 2.0, min(panel.width, panel.height) / axes.figure.dpi * 72.0)
    axes.scatter(marks_xy[:, 0], marks_xy[:, 1], s=size, c=shaded, linewidths=0, rasterized=True)


def draw_mesh(
    axes: Axes,
    mesh: Mesh,
    *,
    eye: ArrayLike,
    target: ArrayLike,
    up: ArrayLike | None = None,
    colour: str = COLOUR,
    face_colours: ArrayLike | None = None,
    edges: bool = False,
    radius: float | None = None,
    perspective: bool = True,
) -> None:
    """Draw a mesh from an eye: flat shaded, two-sided, with hidden surfaces removed by a small depth buffer.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    mesh : Mesh
        World space.
    eye, target, up, perspective, radius
        As in `draw_cloud`.
    colour : str
        Any matplotlib colour.
    face_colours : (f, 3) float, optional
        RGB in [0, 1] for each face instead of `colour`.
    edges : bool
        Draw the outlines of the faces too.

    Notes
    -----
    Faces that reach behind a perspective eye are left out. The cost is O(covered pixels). OpenGL is not needed.
    """
    corners = mesh.corners
    screen = project_to_picture(corners.reshape(-1, 3), eye=eye, target=target, up=up, perspective=perspective)
    screen = screen.reshape(-1, 3, 3)
    keep = np.isfinite(screen).all(axis=(1, 2))
    _frame(axes, screen[keep].reshape(-1, 3)[:, :2], radius)
    if not keep.any():
        return
    normals = mesh.face_normals / np.maximum(np.linalg.norm(mesh.face_normals, axis=1, keepdims=True), 1e-300)
    base = np.broadcast_to(to_rgb(colour), (*keep.shape, 3)) if face_colours is None else np.asarray(face_colours)
    lit = lambert(normals @ axes_of_eye(eye, target, up).T)
    shaded = lit_colours(base[keep], lit[keep], screen[keep].mean(axis=1)[:, 2], 0.4)
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    pixels = screen[keep].copy()
    pixels[..., :2] = (pixels[..., :2] - (left, bottom)) / (right - left, top - bottom) * MESH_PIXELS
    if perspective:
        pixels[..., 2] = -1.0 / pixels[..., 2]  # linear over the image of a triangle
    picture = np.zeros((MESH_PIXELS, MESH_PIXELS, 4))
    _rasterise(pixels, shaded, 1.0 if edges else 0.0, np.full(picture.shape[:2], np.inf), picture)
    axes.imshow(picture, extent=(left, right, bottom, top), origin="lower", interpolation="antialiased", aspect="auto")


def _frame(axes: Axes, positions: FloatArray, radius: float | None) -> None:
    """Make axes bare and square, within `radius` of the target or fitted to the positions (n, 2)."""
    axes.set_axis_off()
    axes.set_aspect("equal")
    centre, half = picture_frame(positions, radius)
    axes.set_xlim(centre[0] - half, centre[0] + half)
    axes.set_ylim(centre[1] - half, centre[1] + half)


@njit(cache=True)
def _rasterise(pixels: FloatArray, colours: FloatArray, line: float, nearest: FloatArray, picture: FloatArray) -> None:
    """Fill `picture` (h, w, 4) with triangles: pixels (f, 3 corners, 3) are x, y and a depth linear over the image."""
    height, width = nearest.shape
    for face in range(len(pixels)):
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = pixels[face, 0], pixels[face, 1], pixels[face, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        # heights over the three edges convert barycentric weights to pixels
        height_a = abs(area) / max(np.hypot(cx - bx, cy - by), 1e-12)
        height_b = abs(area) / max(np.hypot(ax - cx, ay - cy), 1e-12)
        height_c = abs(area) / max(np.hypot(bx - ax, by - ay), 1e-12)
        for row in range(max(0, int(min(ay, by, cy))), min(height, int(max(ay, by, cy)) + 1)):
            y = row + 0.5
            for column in range(max(0, int(min(ax, bx, cx))), min(width, int(max(ax, bx, cx)) + 1)):
                x = column + 0.5
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                depth = u * az + v * bz + w * cz
                if depth >= nearest[row, column]:
                    continue
                nearest[row, column] = depth
                on_edge = min(u * height_a, v * height_b, w * height_c) < line
                for channel in range(3):
                    picture[row, column, channel] = colours[face, channel] * (0.55 if on_edge else 1.0)
                picture[row, column, 3] = 1.0
