"""Points as marks on a picture: their positions, order and colours; and the painting of marks into pixels."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.base.arrays import FloatArray, as_vectors
from zbuf_occlude.geometry.camera import view_matrices

COLOUR = (0x3D / 255, 0x6F / 255, 0xB4 / 255)
"""Default colour of surfaces, RGB in [0, 1]."""
LIGHT = np.array([-0.45, 0.55, 0.70]) / np.linalg.norm([-0.45, 0.55, 0.70])
"""Direction to the light in eye space: over the viewer's left shoulder."""
MIN_AREA, MAX_AREA = 0.25, 12.0
"""Bounds of a mark's area, typographic points squared."""


def project_to_picture(
    positions: ArrayLike, *, eye: ArrayLike, target: ArrayLike, up: ArrayLike | None = None, perspective: bool = True
) -> FloatArray:
    """Return positions (n, 3) projected onto the picture plane through the target, which is its origin; (n, 3) float64.

    x points to the right and y upwards, in world units at the target; the third column is the eye depth. x and y of
    positions behind a perspective eye are NaN. `up` points upwards in the picture; the default is that of
    `view_matrices`. Without `perspective` the projection is parallel.
    """
    positions, eye, target = as_vectors(positions, "positions"), np.asarray(eye, float), np.asarray(target, float)
    x, y, back = axes_of_eye(eye, target, up) @ (positions - eye).T
    depth = -back
    if perspective:
        factor = np.full_like(depth, np.nan)
        np.divide(np.linalg.norm(target - eye), depth, out=factor, where=depth > 0.0)
        x, y = x * factor, y * factor
    return np.stack([x, y, depth], axis=1)


def axes_of_eye(eye: ArrayLike, target: ArrayLike, up: ArrayLike | None) -> FloatArray:
    """Return the (3, 3) rotation from world to eye axes."""
    ups = None if up is None else np.asarray(up, float)[None]
    return view_matrices(np.asarray(eye, float)[None], np.asarray(target, float), ups)[0, :3, :3]


def marks_of(
    positions: ArrayLike,
    *,
    eye: ArrayLike,
    target: ArrayLike,
    up: ArrayLike | None = None,
    normals: ArrayLike | None = None,
    values: ArrayLike | None = None,
    colour: tuple[float, float, float] = COLOUR,
    perspective: bool = True,
) -> tuple[FloatArray, FloatArray]:
    """Return positions (m, 2) and colours (m, 3) of a cloud's marks, the farthest first, without those behind the eye.

    Parameters are those of `zbuf_occlude.drawing.pictures.draw_cloud`; `colour` is RGB in [0, 1].
    """
    positions = as_vectors(positions, "positions")
    screen = project_to_picture(positions, eye=eye, target=target, up=up, perspective=perspective)
    keep = np.isfinite(screen[:, 0])
    order = np.flatnonzero(keep)[np.argsort(-screen[keep, 2], kind="stable")]
    base = np.broadcast_to(colour, (len(positions), 3)) if values is None else as_vectors(values, "values")
    lit, fade = np.full(len(positions), 0.8), 0.8
    if normals is not None:
        lit, fade = lambert(as_vectors(normals, "normals") @ axes_of_eye(eye, target, up).T), 0.4
    return screen[order, :2], lit_colours(base[order], lit[order], screen[order, 2], fade)


def lambert(normals: FloatArray) -> FloatArray:
    """Return two-sided diffuse light in [0, 1] for normals (n, 3) in eye axes, any sign; 1 for a zero normal."""
    towards_viewer = np.where(normals[:, 2:] < 0.0, -normals, normals)
    lit = np.clip(towards_viewer @ LIGHT, 0.0, 1.0)
    return np.where((normals == 0.0).all(axis=1), 1.0, lit)


def lit_colours(base: FloatArray, lit: FloatArray, depth: FloatArray, fade: float) -> FloatArray:
    """Return RGB colours (n, 3) that are darker away from the light and fade to white with depth."""
    if not len(depth):
        return np.empty((0, 3))
    near, far = depth.min(), depth.max()
    mist = fade * ((depth - near) / (far - near) if far > near else np.zeros_like(depth))[:, None]
    colour = base * (0.35 + 0.65 * lit)[:, None]
    highlight = 0.25 * (lit**4)[:, None]
    colour = colour + (1.0 - colour) * highlight
    return np.clip(colour + (1.0 - colour) * mist, 0.0, 1.0)


def picture_frame(positions: FloatArray, radius: float | None) -> tuple[FloatArray, float]:
    """Return centre (2,) and half the side of a square picture: `radius` about the target, or fitted to positions."""
    centre, half = np.zeros(2), 1.0 if radius is None else radius
    if radius is None and len(positions):
        low, high = positions.min(axis=0), positions.max(axis=0)
        centre, half = (low + high) / 2.0, float((high - low).max()) * 0.53
    return centre, half if half > 0.0 else 1.0


def area_of_mark(positions: FloatArray, half: float, side: float) -> float:
    """Return the area of a mark, typographic points squared, with which marks cover their bounding box about once.

    `half` is half the picture's side in the units of `positions`, `side` the whole side in typographic points.
    """
    spans = np.ptp(positions, axis=0)
    return float(np.clip(np.prod(spans / (2.0 * half) * side) / len(positions), MIN_AREA, MAX_AREA))


def paint(picture: NDArray[np.uint32], centres: FloatArray, diameter: float, colours: FloatArray) -> None:
    """Paint round marks into the pixels of a picture (h, w) uint32, RGBA, in place; later marks cover earlier ones.

    `centres` (n, 2) are pixels to the right and down from the upper left corner; marks outside are left out.
    `diameter` is in pixels, `colours` (n, 3) are RGB in [0, 1]. The picture may be a view of a larger one.
    """
    radius, (height, width) = int(diameter / 2.0), picture.shape
    offsets = np.arange(-radius, radius + 1)
    down, right = np.nonzero(offsets[:, None] ** 2 + offsets**2 <= diameter**2 / 4.0)
    columns, rows = np.floor(centres).astype(np.intp).T
    shown = (rows >= -radius) & (rows < height + radius) & (columns >= -radius) & (columns < width + radius)
    wide = np.empty((height + 4 * radius, width + 4 * radius), dtype=np.uint32)  # with room for whole marks
    wide[2 * radius : 2 * radius + height, 2 * radius : 2 * radius + width] = picture
    opaque = np.full((len(colours), 4), 255, dtype=np.uint8)
    opaque[:, :3] = np.rint(colours * 255.0)
    corners = (rows[shown] + radius) * wide.shape[1] + columns[shown] + radius
    marked = (corners[:, None] + (down * wide.shape[1] + right)).ravel()
    wide.ravel()[marked] = np.repeat(opaque.view(np.uint32)[shown], len(down))  # the last value of an index counts
    picture[:] = wide[2 * radius : 2 * radius + height, 2 * radius : 2 * radius + width]
