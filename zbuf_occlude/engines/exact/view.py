"""Views of an eye: one frame for an eye outside the scene, the six faces of a cube about an eye inside."""

import math
from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.jit.compiler import device_function, njit
from zbuf_occlude.engines.exact.bvh import Bvh
from zbuf_occlude.engines.exact.layout import ONE, ZERO, Float32, Int64

OUTSIDE = 1.5
"""Distance from the centre, in radii of the scene, beyond which an eye sees everything in one frame."""
GUARD = np.float32(1.05)
"""Half-width of a cube face; more than 1, so that rounding loses no point between two faces."""
UNBOUNDED = np.float32(1e30)
"""Half-width of a frame from outside."""
NEAR = np.float32(1e-3)
"""Distance from an eye inside, in magnitudes of the point, below which float64 alone decides."""

_X, _Y, _Z = np.eye(3)
SIDES = np.concatenate([_Y, _Z, _X, _Z, _Y, -_X, _Z, _X, _Y, _X, _Z, -_Y, _X, _Y, _Z, _Y, _X, -_Z]) + 0.0
"""(54,): rows x, y, w of the frames that look along +x, -x, +y, -y, +z, -z."""


class EyeViews(NamedTuple):
    """Frames of k eyes. A point in front of an eye has w > 0; its position in the image is (x / w, y / w)."""

    matrices: Float32  # (k, 6, 12) rows x, y, w of 3 x 4 matrices of positive determinant: scene space to the image
    axes: FloatArray  # (k, 6, 3, 3) left parts of the matrices, not rounded
    n_frames: Int64  # (k,) 1: eye outside, w is 1 at the scene's centre; 6: cube about the eye, w in scene units
    eyes: FloatArray  # (k, 3) scene space
    world_eyes: FloatArray  # (k, 3) the caller's own, for float64: an eye that went through scene space and back has
    # been rounded, and may fall off a plane it lies on


class View(NamedTuple):
    """One frame of one eye."""

    number: int  # index of the frame among those of all eyes
    matrix: Float32  # (12,) as in `EyeViews`
    half_width: np.float32  # the frame shows only |x|, |y| <= half_width x w
    near: np.float32  # least w of a point in the frame, in magnitudes; 0 for an eye outside
    eye: tuple[np.float32, np.float32, np.float32]  # scene space
    world_eye: tuple[float, float, float]
    magnitude: np.float32  # largest operand of projected coordinates: 1, or the eye's distance for an eye inside


def project_eyes(bvh: Bvh, world_eyes: FloatArray, radius: float) -> EyeViews:
    """Make the frame, or the six faces of a cube, of each eye.

    Parameters
    ----------
    bvh : Bvh
    world_eyes : (k, 3) float64, world space
    radius : float
        Radius of a sphere about the scene's centre that holds the mesh and all points, scene units.

    Notes
    -----
    A frame from outside keeps coordinates relative to the scene's centre and divides by the distance: float32 resolves
    the scene equally well from any distance. From inside, coordinates are relative to the eye, and the cube's faces are
    perpendicular to the axes.
    """
    k, world_eyes = len(world_eyes), np.ascontiguousarray(world_eyes)
    eyes, n_frames = np.empty(3 * k), np.empty(k, dtype=np.int64)
    matrices, axes = np.zeros(72 * k, dtype=np.float32), np.zeros(54 * k)
    _place_frames(world_eyes.reshape(-1), bvh.centre, bvh.scale, OUTSIDE * radius, eyes, matrices, axes, n_frames)
    return EyeViews(matrices.reshape(k, 6, 12), axes.reshape(k, 6, 3, 3), n_frames, eyes.reshape(k, 3), world_eyes)


@device_function
def view_of(views, k, frame):
    """Return a frame of eye k."""
    eye, world_eye = views.eyes[k], views.world_eyes[k]
    inside = views.n_frames[k] > 1
    distance = np.float32(1.001 * np.sqrt(eye[0] * eye[0] + eye[1] * eye[1] + eye[2] * eye[2]))
    return View(
        number=6 * k + frame,
        matrix=views.matrices[k, frame],
        half_width=GUARD if inside else UNBOUNDED,
        near=NEAR if inside else ZERO,
        eye=(np.float32(eye[0]), np.float32(eye[1]), np.float32(eye[2])),
        world_eye=(world_eye[0], world_eye[1], world_eye[2]),
        magnitude=max(ONE, distance) if inside else ONE,
    )


@njit(cache=True)
def _place_frames(world_eyes, centre, scale, outside, eyes, matrices, axes, n_frames):
    """Fill in the fields of `EyeViews`, flat, zero before. (NumPy is slow for a single eye.)

    An eye farther than `outside` looks at the centre, world z upwards where possible; a nearer one looks along the
    axes.
    """
    for k in range(len(n_frames)):
        for axis in range(3):
            eyes[3 * k + axis] = (world_eyes[3 * k + axis] - centre[axis]) * scale
        x, y, z = eyes[3 * k], eyes[3 * k + 1], eyes[3 * k + 2]
        distance = math.sqrt(x * x + y * y + z * z)
        if distance > outside:
            n_frames[k] = 1
            x, y, z = -x / distance, -y / distance, -z / distance
            pole = abs(z) > 0.999
            a, b, c = (-z if pole else y), (0.0 if pole else -x), (x if pole else 0.0)  # forward x upwards
            length = math.sqrt(a * a + b * b + c * c)
            a, b, c = a / length, b / length, c / length
            _put_row(matrices, axes, 18 * k, (a, b, c), 0.0)
            _put_row(matrices, axes, 18 * k + 1, (y * c - z * b, z * a - x * c, x * b - y * a), 0.0)
            _put_row(matrices, axes, 18 * k + 2, (x / distance, y / distance, z / distance), 1.0)
        else:
            n_frames[k] = 6
            for row in range(18):
                a, b, c = SIDES[3 * row], SIDES[3 * row + 1], SIDES[3 * row + 2]
                _put_row(matrices, axes, 18 * k + row, (a, b, c), -(a * x + b * y + c * z))


@device_function
def _put_row(matrices, axes, row, along, constant):
    for i in range(3):
        axes[3 * row + i] = along[i]
        matrices[4 * row + i] = along[i]
    matrices[4 * row + 3] = constant
