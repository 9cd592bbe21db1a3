"""Still pictures of clouds and meshes as seen from an eye, drawn into matplotlib axes; no display, no global state."""

from functools import cache
from typing import Any

import numpy as np
from matplotlib import font_manager
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ft2font import FT2Font
from numba import njit
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.arrays import FloatArray, as_vectors
from zbuf_occlude.camera import view_matrices
from zbuf_occlude.mesh import Mesh

COLOUR = "#3d6fb4"
"""What a surface is painted with unless told otherwise."""
LIGHT = np.array([-0.45, 0.55, 0.70]) / np.linalg.norm([-0.45, 0.55, 0.70])
"""Direction to the light in eye space: over the viewer's left shoulder."""
MESH_PIXELS = 1200
"""Side of the picture that `draw_mesh` rasterises; matplotlib scales it to the axes."""


def new_figure(n_rows: int, n_columns: int, *, panel: float = 3.0) -> tuple[Figure, NDArray[Any]]:
    """Return a figure on the Agg backend and its (n_rows, n_columns) array of bare axes, `panel` inches a side."""
    figure = Figure(figsize=(panel * n_columns, panel * n_rows), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.subplots(n_rows, n_columns, squeeze=False)
    for each in axes.flat:
        each.set_axis_off()
    return figure, axes


def set_title(axes: Axes, text: str, **style: Any) -> None:
    """Write a title in any script, $ and all: by an installed font that has its characters, else as Python escapes."""
    families = list(font_manager.FontProperties().get_family())
    lacking = set(map(ord, text)) - _characters(font_manager.findfont(font_manager.FontProperties()))
    if lacking:
        fonts = sorted(font_manager.fontManager.ttflist, key=lambda font: (font.name, font.fname))
        fallback = next((font.name for font in fonts if lacking <= _characters(font.fname)), None)
        if fallback is None:
            text = "".join(ascii(c)[1:-1] if ord(c) in lacking else c for c in text)
        else:
            families.append(fallback)
    axes.set_title(text, fontfamily=families, parse_math=False, **style)


@cache
def _characters(font_file: str) -> frozenset[int]:
    """The code points that a font can write."""
    return frozenset(FT2Font(font_file).get_charmap())


def project(
    positions: ArrayLike, *, eye: ArrayLike, target: ArrayLike, up: ArrayLike | None = None, perspective: bool = True
) -> FloatArray:
    """Project positions onto the picture plane through the target.

    Parameters
    ----------
    positions : (n, 3) float
        World space.
    eye, target : (3,) float
        World space; the target falls on the picture's origin.
    up : (3,) float, optional
        What points upwards in the picture; as in `zbuf_occlude.camera.view_matrices` by default.
    perspective : bool
        Lines of sight through the eye; otherwise parallel.

    Returns
    -------
    (n, 3) float64
        x to the right and y upwards, in world units at the target; eye depth along the axis, growing away from the eye.
        What lies behind a perspective eye gets NaN for x and y.
    """
    positions, eye, target = as_vectors(positions, "positions"), np.asarray(eye, float), np.asarray(target, float)
    x, y, back = _axes_of_eye(eye, target, up) @ (positions - eye).T
    depth = -back
    if perspective:
        factor = np.full_like(depth, np.nan)
        np.divide(np.linalg.norm(target - eye), depth, out=factor, where=depth > 0.0)
        x, y = x * factor, y * factor
    return np.stack([x, y, depth], axis=1)


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
    """Draw a cloud as seen from an eye: nearer points on top, shaded so that the shape can be read.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    positions : (n, 3) float
        World space.
    eye, target, up, perspective
        As in `project`.
    normals : (n, 3) float, optional
        Unit normals, either sign; points are then lit from over the viewer's shoulder. Without them depth alone shades.
    values : (n, 3) float, optional
        RGB in [0, 1] for each point instead of `colour`; shaded all the same.
    colour : str
        Any matplotlib colour.
    size : float, optional
        Area of a point's mark in points squared; chosen by the number of points and the panel's size by default.
    radius : float, optional
        Half the picture's side in world units, the target in the middle: gives several panels one scale.
        Without it the picture fits the cloud.

    Notes
    -----
    Nothing is hidden here: points behind others are drawn first and lighter. Call it with visible points only to
    see what the eye sees.
    """
    positions = as_vectors(positions, "positions")
    screen = project(positions, eye=eye, target=target, up=up, perspective=perspective)
    keep = np.isfinite(screen[:, 0])
    order = np.flatnonzero(keep)[np.argsort(-screen[keep, 2], kind="stable")]
    base = np.broadcast_to(to_rgb(colour), (len(positions), 3)) if values is None else as_vectors(values, "values")
    lit, fade = np.full(len(positions), 0.8), 0.8
    if normals is not None:
        lit, fade = _lambert(as_vectors(normals, "normals") @ _axes_of_eye(eye, target, up).T), 0.4
    _frame(axes, screen[order], radius)
    if not len(order):
        return
    shaded = _shade(base[order], lit[order], screen[order, 2], fade)
    size = _mark_size(axes, screen[order, :2]) if size is None else size
    axes.scatter(screen[order, 0], screen[order, 1], s=size, c=shaded, linewidths=0, rasterized=True)


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
    """Draw a mesh as seen from an eye: flat shaded, two-sided, hidden surfaces removed by a small depth buffer.

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
    Faces that reach behind a perspective eye are left out. Costs O(pixels covered); independent of GL.
    """
    corners = mesh.corners
    screen = project(corners.reshape(-1, 3), eye=eye, target=target, up=up, perspective=perspective).reshape(-1, 3, 3)
    keep = np.isfinite(screen).all(axis=(1, 2))
    _frame(axes, screen[keep].reshape(-1, 3), radius)
    if not keep.any():
        return
    normals = mesh.face_normals / np.maximum(np.linalg.norm(mesh.face_normals, axis=1, keepdims=True), 1e-300)
    base = np.broadcast_to(to_rgb(colour), (*keep.shape, 3)) if face_colours is None else np.asarray(face_colours)
    lit = _lambert(normals @ _axes_of_eye(eye, target, up).T)
    shaded = _shade(base[keep], lit[keep], screen[keep].mean(axis=1)[:, 2], 0.4)
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    pixels = screen[keep].copy()
    pixels[..., 0] = (pixels[..., 0] - left) / (right - left) * MESH_PIXELS
    pixels[..., 1] = (pixels[..., 1] - bottom) / (top - bottom) * MESH_PIXELS
    if perspective:
        pixels[..., 2] = -1.0 / pixels[..., 2]  # what is linear over the picture of a triangle
    picture = np.zeros((MESH_PIXELS, MESH_PIXELS, 4))
    _rasterise(pixels, shaded, 1.0 if edges else 0.0, np.full(picture.shape[:2], np.inf), picture)
    axes.imshow(picture, extent=(left, right, bottom, top), origin="lower", interpolation="antialiased", aspect="auto")


def _axes_of_eye(eye: ArrayLike, target: ArrayLike, up: ArrayLike | None) -> FloatArray:
    """The (3, 3) rotation from world to eye axes."""
    ups = None if up is None else np.asarray(up, float)[None]
    return view_matrices(np.asarray(eye, float)[None], np.asarray(target, float), ups)[0, :3, :3]


def _lambert(normals: FloatArray) -> FloatArray:
    """Two-sided diffuse light in [0, 1]; normals (n, 3) in eye axes, any sign. A zero normal is fully lit."""
    towards_viewer = np.where(normals[:, 2:] < 0.0, -normals, normals)
    lit = np.clip(towards_viewer @ LIGHT, 0.0, 1.0)
    return np.where((normals == 0.0).all(axis=1), 1.0, lit)


def _mark_size(axes: Axes, screen: FloatArray) -> float:
    """Area of a mark in points squared with which the marks cover what they span about once."""
    panel = axes.get_window_extent()
    side = min(panel.width, panel.height) / axes.figure.dpi * 72.0
    (left, right), spans = axes.get_xlim(), np.ptp(screen, axis=0)
    return float(np.clip(np.prod(spans / (right - left) * side) / len(screen), 0.25, 12.0))


def _shade(base: FloatArray, lit: FloatArray, depth: FloatArray, fade: float) -> FloatArray:
    """Darken colours away from the light and fade them towards white with depth; (n, 3) RGB."""
    near, far = depth.min(), depth.max()
    mist = fade * ((depth - near) / (far - near) if far > near else np.zeros_like(depth))[:, None]
    colour = base * (0.35 + 0.65 * lit)[:, None]
    highlight = 0.25 * (lit**4)[:, None]
    colour = colour + (1.0 - colour) * highlight
    return np.clip(colour + (1.0 - colour) * mist, 0.0, 1.0)


def _frame(axes: Axes, screen: FloatArray, radius: float | None) -> None:
    """Bare square axes about the target, or fitted to what is drawn; an axes already framed by `radius` stays."""
    axes.set_axis_off()
    axes.set_aspect("equal")
    if radius is not None:
        centre, half = np.zeros(2), radius
    elif len(screen):
        low, high = screen[:, :2].min(axis=0), screen[:, :2].max(axis=0)
        centre, half = (low + high) / 2.0, float((high - low).max()) * 0.53
    else:
        centre, half = np.zeros(2), 1.0
    half = half if half > 0.0 else 1.0
    axes.set_xlim(centre[0] - half, centre[0] + half)
    axes.set_ylim(centre[1] - half, centre[1] + half)


@njit(cache=True)
def _rasterise(
    pixels: FloatArray, colours: FloatArray, line: float, nearest: FloatArray, picture: FloatArray
) -> None:  # compiled
    """Fill `picture` (h, w, 4): pixels (f, 3 corners, 3) hold x, y in pixels and a depth linear over the picture."""
    height, width = nearest.shape
    for face in range(len(pixels)):
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = pixels[face, 0], pixels[face, 1], pixels[face, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        # heights over the three edges turn barycentric weights into pixels
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
