"""Unit space of a mesh, cameras in it, and the tiles of the atlas that hold their pictures."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.geometry.camera import (
    Frusta,
    cube_frusta,
    cube_view_matrices,
    fitted_frusta,
    projection_matrices,
    view_matrices,
)

MARGIN = 2.0
"""Border around the mesh in pixels: tests read pixels up to this far from a point."""

NEAR = 1e-6
"""Near plane of the cube faces, in diagonals. Nearer faces are not drawn."""

TILE = np.dtype(
    [
        ("to_window", "<f4", (4, 4)),
        ("across", "<f4", 3),
        ("gain", "<f4"),
        ("upward", "<f4", 3),
        ("range", "<f4"),
        ("eye", "<f4", 4),
        ("corner", "<f4", 4),
    ]
)
"""Record of the struct Tile of shaders/include/tiles.glsl; matrices column by column."""

CUBE = 6
"""Number of pictures of an eye within the mesh."""

EYES_PER_BYTE = 8
"""Number of eyes of a group, whose answers share a byte on the GPU."""


@dataclass(frozen=True)
class Unit:
    """Unit space of a mesh: centred, and scaled by a power of two so that the diagonal is in [1/2, 1).

    Scaling by a power of two is exact, so masks do not change when everything is scaled by one.
    """

    centre: FloatArray
    scale: float

    @classmethod
    def from_box(cls, centre: FloatArray, diagonal: float) -> "Unit":
        """Return the unit space of a mesh from its bounding box."""  # 2^1023 is the largest power of two in float64
        return cls(centre, float(np.ldexp(1.0, min(-int(np.frexp(diagonal)[1]), 1023))) if diagonal > 0.0 else 1.0)

    def to(self, positions: FloatArray) -> FloatArray:
        """Return positions in unit space, (..., 3) float64."""
        return (positions - self.centre) * self.scale


@dataclass(frozen=True)
class Pictures:
    """Cameras of c pictures, one or six (`CUBE`) per eye, in the mesh's unit space.

    Depth is reversed: 1 at the near plane, 0 at the far plane (at infinity for cube faces). Floating-point numbers are
    dense near 0, where perspective compresses large distances.
    """

    views: FloatArray  # (c, 4, 4)
    frusta: Frusta
    projections: FloatArray  # (c, 4, 4)
    gains: FloatArray  # (c,) gain of depth per unit of inverse eye depth

    def __len__(self) -> int:
        return len(self.views)

    def select(self, which: slice | NDArray[np.int64]) -> "Pictures":
        """Return some of the pictures."""
        frusta = Frusta(*(bound[which] for bound in self.frusta))
        return Pictures(self.views[which], frusta, self.projections[which], self.gains[which])


def single_pictures(eyes: FloatArray, positions: FloatArray, resolution: int) -> tuple[BoolArray, Pictures]:
    """Fit a camera to the mesh's vertices for each eye; both in unit space.

    Returns which eyes fit, (k,) bool, and their pictures. Eyes within the mesh, or very near, need cube faces.
    """
    # an eye at the centre may look anywhere, since it does not fit
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
    """Return six pictures per eye, in the order of `camera.cube_view_matrices`."""
    views = cube_view_matrices(eyes).reshape(-1, 4, 4)
    radius = float(np.linalg.norm(positions, axis=1).max())
    far = np.repeat(np.linalg.norm(eyes, axis=1) + radius, CUBE)
    frusta = cube_frusta(len(views), NEAR, 1.0, margin=MARGIN / (resolution - 2.0 * MARGIN))._replace(far=far)
    projections = projection_matrices(frusta)
    projections[:, 2, 2], projections[:, 2, 3] = 0.0, NEAR
    return Pictures(views, frusta, projections, np.full(len(views), NEAR))


def arrange_tiles(pictures: Pictures, resolution: int, columns: int, batch: int) -> NDArray[np.void]:
    """Return the records of `TILE`, (c,), of pictures that are drawn `batch` at a time, each time into the first tiles.

    Picture c is in tile ``c % batch`` of the atlas, row by row.
    """
    tile = np.arange(len(pictures)) % batch
    corner = np.stack([tile % columns, tile // columns], axis=1) * float(resolution)
    to_pixels = np.zeros((len(tile), 4, 4))
    to_pixels[:, 0, 0] = to_pixels[:, 1, 1] = resolution / 2.0
    to_pixels[:, :2, 3] = corner + resolution / 2.0
    to_pixels[:, 2, 2] = to_pixels[:, 3, 3] = 1.0
    to_window = to_pixels @ pictures.projections @ pictures.views
    tiles = np.zeros(len(tile), dtype=TILE)
    tiles["to_window"] = to_window.transpose(0, 2, 1)
    # the plane of normal n through p has inverse eye depth n . ray / n . (p - eye) along a ray of eye depth 1
    rotations = pictures.views[:, :3, :3]
    frusta, gains = pictures.frusta, pictures.gains
    tiles["across"] = -(gains * (frusta.right - frusta.left) / resolution)[:, None] * rotations[:, 0]
    tiles["upward"] = -(gains * (frusta.top - frusta.bottom) / resolution)[:, None] * rotations[:, 1]
    tiles["gain"], tiles["range"] = gains, frusta.far - frusta.near
    # the eye is the origin of eye space
    tiles["eye"][:, :3] = -np.einsum("cij,ci->cj", rotations, pictures.views[:, :3, 3])
    tiles["corner"][:, :2], tiles["corner"][:, 2] = corner, resolution
    return tiles
