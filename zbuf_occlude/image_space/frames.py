"""Frames: the projections through which an eye looks at the scene; one for an eye outside, six for one inside."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray

OUTSIDE = 1.5
"""An eye farther from the centre than this times the farthest point sees everything in one frame."""

GUARD = 1.05
"""Half-width of a cube face's window; more than 1, so that rounding loses no point between two faces."""

NO_WINDOW = 1e30


class Frames(NamedTuple):
    """How k eyes look at the scene.

    Parameters
    ----------
    matrices : (k, 6, 12) float32
        Rows x, y, w of 3 x 4 matrices of positive determinant: scene space to homogeneous coordinates of the image.
        What lies before the eye has w > 0, and is seen at (x / w, y / w).
    n_frames : (k,) int64
        1: the eye is outside, w is 1 at the scene's centre. 6: faces of a cube about the eye, w is scene units.
    windows : (k,) float32
        Only what has |x|, |y| <= window x w belongs to a frame.
    eyes : (k, 3) float64, scene space
    world_eyes : (k, 3) float64
        The caller's own, for float64: an eye that went through scene space and back has been rounded, and is on the
        other side of planes that it lies in.
    """

    matrices: NDArray[np.float32]
    n_frames: NDArray[np.int64]
    windows: NDArray[np.float32]
    eyes: FloatArray
    world_eyes: FloatArray


def make_frames(world_eyes: FloatArray, centre: FloatArray, scale: float, radius: float) -> Frames:
    """Place a frame, or the six faces of a cube, before each eye.

    Parameters
    ----------
    world_eyes : (k, 3) float64
    centre, scale : (3,) float64 and float
        The scene's.
    radius : float
        Of a sphere about the scene's centre that holds the mesh and all points, scene units.

    Notes
    -----
    A frame from outside keeps coordinates about the scene's centre and divides by the distance: float32 resolves the
    scene equally well from any distance. From inside coordinates are about the eye; the cube's faces are those of
    the axes.
    """
    eyes = (world_eyes - centre) * scale
    distances = np.linalg.norm(eyes, axis=1)
    outside = distances > OUTSIDE * radius
    matrices = np.zeros((len(eyes), 6, 3, 4))
    matrices[outside, 0] = _look_at(eyes[outside], distances[outside])
    matrices[~outside] = _cube(eyes[~outside])
    return Frames(
        matrices.reshape(len(eyes), 6, 12).astype(np.float32),
        np.where(outside, 1, 6).astype(np.int64),
        np.where(outside, NO_WINDOW, GUARD).astype(np.float32),
        eyes,
        world_eyes,
    )


def _look_at(eyes: FloatArray, distances: FloatArray) -> FloatArray:
    """Look at the centre, world z upwards where that can be. (k, 3, 4)."""
    forward = -eyes / distances[:, None]
    pole = np.abs(forward[:, 2:]) > 0.999
    right = np.cross(forward, np.where(pole, [[0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0]]))
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    matrices = np.zeros((len(eyes), 3, 4))
    matrices[:, 0, :3] = right
    matrices[:, 1, :3] = np.cross(forward, right)
    matrices[:, 2, :3] = forward / distances[:, None]
    matrices[:, 2, 3] = 1.0
    return matrices


def _cube(eyes: FloatArray) -> FloatArray:
    """Look along +x, -x, +y, -y, +z, -z from the eye. (k, 6, 3, 4)."""
    rotations = np.zeros((6, 3, 3))
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        rotations[2 * axis, [0, 1, 2], [i, j, axis]] = [1.0, 1.0, 1.0]
        rotations[2 * axis + 1, [0, 1, 2], [j, i, axis]] = [1.0, 1.0, -1.0]
    matrices = np.zeros((len(eyes), 6, 3, 4))
    matrices[..., :3] = rotations
    matrices[..., 3] = -np.einsum("fij,kj->kfi", rotations, eyes)
    return matrices
