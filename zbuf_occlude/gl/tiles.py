"""Where each eye's picture lies in the atlas of depth tiles, and the matrices that take the mesh there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.geometry.camera import (
    Frusta,
    cube_frusta,
    cube_view_matrices,
    fitted_frusta,
    projection_matrices,
    view_matrices,
)

MARGIN = 2.0
"""Pixels left free all round the mesh: the test looks that far beside a point."""

NEAREST = 1e-6
"""The cube faces' near plane, in diagonals. What is nearer to the eye is not drawn."""

TILE = np.dtype(
    [
        ("window", "<f4", (4, 4)),
        ("across", "<f4", 3),
        ("gain", "<f4"),
        ("upward", "<f4", 3),
        ("range", "<f4"),
        ("eye", "<f4", 4),
        ("corner", "<f4", 4),
    ]
)
"""The struct Tile of shaders/include/tiles.glsl; matrices column by column."""

CUBE = 6


@dataclass(frozen=True)
class Pictures:
    """What some eyes see, in one picture or six (`CUBE`) an eye: the cameras' matrices, from the mesh's unit space.

    Attributes
    ----------
    views : (c, 4, 4) float64
    frusta : Frusta
        Of the c pictures.
    projections : (c, 4, 4) float64
        Eye to clip space, depth reversed: 1 at the near plane, 0 at the far plane (or at infinity, for cube faces).
        Floating-point numbers are dense near 0, where perspective squeezes all that is far.
    gains : (c,) float64
        What the depth gains per unit of inverse eye depth.
    """

    views: FloatArray
    frusta: Frusta
    projections: FloatArray
    gains: FloatArray


def single_pictures(eyes: FloatArray, positions: FloatArray, resolution: int) -> tuple[BoolArray, Pictures]:
    """Fit a camera to the mesh for each eye.

    Parameters
    ----------
    eyes : (k, 3) float64
        Unit space.
    positions : (m, 3) float64
        The mesh's vertices, unit space.
    resolution : int
        Pixels along a side.

    Returns
    -------
    fits : (k,) bool
        False for eyes within the mesh or so near that they need cube faces.
    pictures : Pictures
        Of the eyes that fit.
    """
    # an eye at the centre looks anywhere: it does not fit
    targets = np.where((eyes == 0.0).all(axis=1, keepdims=True), [1.0, 0.0, 0.0], 0.0)
    views = view_matrices(eyes, targets)
    fits, frusta = fitted_frusta(views, positions, margin=MARGIN / (resolution - 2.0 * MARGIN))
    return fits, reversed_depth(views[fits], Frusta(*(bound[fits] for bound in frusta)))


def reversed_depth(views: FloatArray, frusta: Frusta) -> Pictures:
    """Return the pictures of cameras given by view matrices (c, 4, 4) and frusta, with depth 1 near and 0 far."""
    projections = projection_matrices(frusta)
    gains = frusta.near * frusta.far / (frusta.far - frusta.near)
    projections[:, 2, 2] = frusta.near / (frusta.far - frusta.near)
    projections[:, 2, 3] = gains
    return Pictures(views, frusta, projections, gains)


def cube_pictures(eyes: FloatArray, positions: FloatArray, resolution: int) -> Pictures:
    """Return six pictures an eye, in the order of `camera.cube_view_matrices`."""
    views = cube_view_matrices(eyes).reshape(-1, 4, 4)
    radius = float(np.linalg.norm(positions, axis=1).max())
    far = np.repeat(np.linalg.norm(eyes, axis=1) + radius, CUBE)
    frusta = cube_frusta(len(views), NEAREST, 1.0, margin=MARGIN / (resolution - 2.0 * MARGIN))._replace(far=far)
    projections = projection_matrices(frusta)
    projections[:, 2, 2], projections[:, 2, 3] = 0.0, NEAREST
    return Pictures(views, frusta, projections, np.full(len(views), NEAREST))


def arrange_tiles(pictures: Pictures, resolution: int, columns: int, n_tiles: int) -> NDArray[np.void]:
    """Put pictures into the atlas, the c-th into tile ``c % n_tiles``, row by row; records of `TILE`, (c,)."""
    place = np.arange(len(pictures.views)) % n_tiles
    corner = np.stack([place % columns, place // columns], axis=1) * float(resolution)
    to_pixels = np.zeros((len(place), 4, 4))
    to_pixels[:, 0, 0] = to_pixels[:, 1, 1] = resolution / 2.0
    to_pixels[:, :2, 3] = corner + resolution / 2.0
    to_pixels[:, 2, 2] = to_pixels[:, 3, 3] = 1.0
    window = to_pixels @ pictures.projections @ pictures.views
    tiles = np.zeros(len(place), dtype=TILE)
    tiles["window"] = window.transpose(0, 2, 1)
    # the plane of normal n through p has inverse eye depth n . ray / n . (p - eye) along a ray of eye depth 1
    rotations = pictures.views[:, :3, :3]
    frusta, gains = pictures.frusta, pictures.gains
    tiles["across"] = -(gains * (frusta.right - frusta.left) / resolution)[:, None] * rotations[:, 0]
    tiles["upward"] = -(gains * (frusta.top - frusta.bottom) / resolution)[:, None] * rotations[:, 1]
    tiles["gain"], tiles["range"] = gains, frusta.far - frusta.near
    # the eye is where eye space has its origin
    tiles["eye"][:, :3] = -np.einsum("cij,ci->cj", rotations, pictures.views[:, :3, 3])
    tiles["corner"][:, :2], tiles["corner"][:, 2] = corner, resolution
    return tiles
