"""Cameras as matrices, in OpenGL's conventions: view, off-centre frustum fitted to a mesh, cube faces, window space.

Eye space is right-handed: x right, y up, the camera looks along -z. NDC is [-1, 1] on all three axes, -1 at the near
plane. Window space is in pixels from the lower left corner, pixel (0, 0) has its centre at (0.5, 0.5), depth is in
[0, 1]. Matrices multiply columns from the left, ``clip = projection @ view @ world``; the last axes are the matrix,
all leading axes are a batch of cameras. Eye depth is the distance along the axis, positive in front: ``-z``.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.base.arrays import LARGEST, BoolArray, FloatArray, as_number, as_numbers, as_vectors
from zbuf_occlude.base.errors import ArgumentError

WIDEST = 1.5
"""Maximum tangent to either side of a single frustum (56 degrees); beyond it cube faces use their pixels better."""

MARGIN = 0.05
"""Border around the positions that a picture is fitted to, as a fraction of their extent."""

_CUBE_AXES = np.array(
    # rows of the rotation from world to eye space: right, up, backward
    [
        [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],  # looks along +x
        [[0, 0, -1], [0, 1, 0], [1, 0, 0]],  # -x
        [[1, 0, 0], [0, 0, 1], [0, -1, 0]],  # +y
        [[1, 0, 0], [0, 0, -1], [0, 1, 0]],  # -y
        [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],  # +z
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]],  # -z
    ],
    dtype=np.float64,
)


def as_rigid(pose: ArrayLike, name: str, within: float = 1e-5) -> FloatArray:
    """Return a pose (4, 4) as float64.

    Raises ArgumentError unless it is a rigid motion, to within `within` per entry, with the last row 0 0 0 1.
    """
    matrix = as_numbers(pose, name, (4, 4))
    if not (np.abs(matrix) <= LARGEST).all():
        raise ArgumentError(f"{name} must be finite, and at most {LARGEST:g} in size; it is not. Repair it.")
    rotation = matrix[:3, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > within or np.linalg.det(rotation) < 0.0:
        raise ArgumentError(f"{name} must be a rigid motion, without scale or reflection; it is not. Scale the mesh.")
    if np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max() > within:
        raise ArgumentError(f"{name} must have the last row 0 0 0 1; it has {' '.join(f'{x:g}' for x in matrix[3])}.")
    return matrix


def unit_quaternions(quaternions: ArrayLike) -> FloatArray:
    """Return the quaternions (..., 4) scaled to length 1; raise ArgumentError if one is 0 or not finite."""
    given = np.asarray(quaternions, dtype=np.float64)
    largest = np.abs(given).max(axis=-1, keepdims=True)
    if not (np.isfinite(largest) & (largest > 0.0)).all():
        raise ArgumentError("a quaternion must be finite and not zero; one is not. Repair it.")
    given = given / largest  # the square of a large component would overflow, that of a small one would be 0
    return np.asarray(given / np.linalg.norm(given, axis=-1, keepdims=True))


FIELDS_OF_VIEW = 1e-3, 179.9
"""Bounds of a field of view, degrees: beyond them float32 cannot represent its tangents."""


def field_of_view(degrees: float) -> float:
    """Return a field of view in radians; raise ArgumentError if it is out of bounds."""
    low, high = FIELDS_OF_VIEW
    want = f"a number from {low:g} to {high:g}, degrees"
    return math.radians(as_number(degrees, "fov", want, lambda number: low <= number <= high))


def rotations_of(quaternions: ArrayLike) -> FloatArray:
    """Return the rotations (..., 3, 3) of unit quaternions (..., 4), x y z w."""
    x, y, z, w = np.moveaxis(np.asarray(quaternions, dtype=np.float64), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def quaternion_of(rotation: ArrayLike) -> FloatArray:
    """Return the unit quaternion (4,), w x y z, of a rotation (3, 3)."""
    from trimesh.transformations import quaternion_from_matrix  # late: few need it, and the import takes a moment

    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    return np.asarray(quaternion_from_matrix(matrix))


class Frusta(NamedTuple):
    """Off-centre frusta, one for each of k cameras; each field is (k,).

    `left`, `right`, `bottom`, `top` are tangents (eye x or y over eye depth), `near` and `far` eye depths, positive.
    """

    left: FloatArray
    right: FloatArray
    bottom: FloatArray
    top: FloatArray
    near: FloatArray
    far: FloatArray


def view_matrices(eyes: ArrayLike, targets: ArrayLike, ups: ArrayLike | None = None) -> FloatArray:
    """Return the matrices from world space to eye space.

    Parameters
    ----------
    eyes : (k, 3) float
        Centres of projection, world space.
    targets : (3,) or (k, 3) float
        Points that the cameras look at, world space.
    ups : (3,) or (k, 3) float, optional
        Up vectors. By default +z, or +y for a camera that looks along z.

    Returns
    -------
    (k, 4, 4) float64, rigid motions.

    Raises
    ------
    ArgumentError
        An eye coincides with its target, or an up vector is zero or parallel to the line of sight.
    """
    eyes = as_vectors(eyes, "eyes")
    backward = eyes - np.broadcast_to(np.asarray(targets, dtype=np.float64), eyes.shape)
    distances = np.linalg.norm(backward, axis=1)
    if not (distances > 0).all():
        raise ArgumentError(f"Eye {int(np.argmin(distances))} coincides with its target.")
    backward = backward / distances[:, None]
    if ups is None:
        along_z = np.abs(backward[:, 2:]) > 1.0 - 1e-6
        ups = np.where(along_z, [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    right = np.cross(np.broadcast_to(np.asarray(ups, dtype=np.float64), eyes.shape), backward)
    lengths = np.linalg.norm(right, axis=1)
    if not (lengths > 1e-9).all():
        raise ArgumentError(
            f"The up vector of eye {int(np.argmin(lengths))} is parallel to its line of sight, or zero."
        )
    right /= lengths[:, None]
    return rigid_matrices(np.stack([right, np.cross(backward, right), backward], axis=1), eyes)


def cube_view_matrices(eyes: ArrayLike) -> FloatArray:
    """Return six view matrices per eye, looking along +x, -x, +y, -y, +z, -z: (k, 6, 4, 4) float64."""
    eyes = as_vectors(eyes, "eyes")
    rotations = np.broadcast_to(_CUBE_AXES, (len(eyes), 6, 3, 3))
    return rigid_matrices(rotations, np.broadcast_to(eyes[:, None], (len(eyes), 6, 3)))


def cube_faces(directions: ArrayLike) -> FloatArray:
    """Return the index of the cube face that each direction (..., 3) falls on, in the order of `cube_view_matrices`."""
    directions = np.asarray(directions, dtype=np.float64)
    axis = np.abs(directions).argmax(axis=-1)
    negative = np.take_along_axis(directions, axis[..., None], axis=-1)[..., 0] < 0
    return np.asarray(2 * axis + negative)


def rigid_matrices(rotations: FloatArray, eyes: FloatArray) -> FloatArray:
    """Return the view matrices (..., 4, 4) of cameras at `eyes` (..., 3) turned by `rotations` (..., 3, 3)."""
    matrices = np.zeros((*rotations.shape[:-2], 4, 4))
    matrices[..., :3, :3] = rotations
    matrices[..., :3, 3] = -np.einsum("...ij,...j->...i", rotations, eyes)
    matrices[..., 3, 3] = 1.0
    return matrices


def fitted_frusta(views: ArrayLike, positions: ArrayLike, margin: float = 0.0) -> tuple[BoolArray, Frusta]:
    """Fit each camera's frustum tightly around a set of points.

    Parameters
    ----------
    views : (k, 4, 4) float
        View matrices.
    positions : (m, 3) float
        World space; a mesh's vertices, or those of its convex hull.
    margin : float
        Border on every side, as a fraction of the opening; 2 / resolution leaves a border of two pixels.

    Returns
    -------
    fits : (k,) bool
        False if a single frustum cannot hold the points (one of them is not in front of the eye), or would open wider
        than `WIDEST`. Its row of the frusta is then undefined; use cube faces.
    frusta : Frusta
        The near plane is 0.1 % nearer than the points, the far plane 0.1 % farther.
    """
    from zbuf_occlude.geometry.extents import extents  # late: describing cameras must not import numba

    views = np.asarray(views, dtype=np.float64)
    bounds = extents(views, np.ascontiguousarray(positions, dtype=np.float64))
    nearest, farthest, low, high = bounds[:, 0], bounds[:, 1], bounds[:, 2:4], bounds[:, 4:6]
    in_front = nearest > 0
    # a flat mesh seen edge-on has no width; give it some, relative to its other side
    opening = np.maximum(high - low, 1e-3 * (high - low).max(axis=1, keepdims=True) + 1e-9)
    middle = (low + high) / 2
    low, high = middle - opening * (0.5 + margin), middle + opening * (0.5 + margin)
    fits = in_front & (np.maximum(-low, high) <= WIDEST).all(axis=1)
    return fits, Frusta(low[:, 0], high[:, 0], low[:, 1], high[:, 1], nearest * (1 - 1e-3), farthest * (1 + 1e-3))


def picture_frusta(views: FloatArray, positions: FloatArray, windows: FloatArray | None = None) -> Frusta:
    """Return each camera's frustum for a picture with square pixels.

    Parameters
    ----------
    views : (k, 4, 4) float
        View matrices.
    positions : (m, 3) float
        Points that the pictures hold, with a border of `MARGIN`, world space.
    windows : (k, 4) float, optional
        Fields of view in place of this fit: tangents left, right, bottom, top. The shorter side is widened to a square.

    Raises
    ------
    ArgumentError
        An eye is so near that no single picture holds the positions; with `windows`, a point is not in front of it.
    """
    fits, frusta = fitted_frusta(views, positions, margin=MARGIN)
    if windows is not None:
        left, right, bottom, top = windows.T
        fits, frusta = frusta.near > 0, frusta._replace(left=left, right=right, bottom=bottom, top=top)
    if not fits.all():
        raise ArgumentError(
            "the mesh must lie in front of the camera; it does not. Raise the distance, or turn the camera to it."
        )
    x, y = (frusta.left + frusta.right) / 2.0, (frusta.bottom + frusta.top) / 2.0
    half = np.maximum(frusta.right - frusta.left, frusta.top - frusta.bottom) / 2.0
    return frusta._replace(left=x - half, right=x + half, bottom=y - half, top=y + half)


def cube_frusta(n: int, near: float, far: float, margin: float = 0.0) -> Frusta:
    """Return n equal frusta of 90 degrees, widened on every side by `margin` times the opening."""
    side = np.full(n, 1.0 + 2.0 * margin)
    return Frusta(-side, side, -side, side, np.full(n, near), np.full(n, far))


def projection_matrices(frusta: Frusta) -> FloatArray:
    """Return the perspective matrices of frusta, as by glFrustum: (k, 4, 4) float64, eye space to clip space.

    Raises
    ------
    ArgumentError
        A frustum has no opening, or its near plane is not between the eye and the far plane.
    """
    left, right, bottom, top, near, far = (np.asarray(bound, dtype=np.float64) for bound in frusta)
    if not ((left < right) & (bottom < top) & (near > 0) & (near < far)).all():
        raise ArgumentError("a frustum must have left < right, bottom < top and 0 < near < far; one does not.")
    matrices = np.zeros((*left.shape, 4, 4))
    matrices[..., 0, 0] = 2.0 / (right - left)
    matrices[..., 0, 2] = (right + left) / (right - left)
    matrices[..., 1, 1] = 2.0 / (top - bottom)
    matrices[..., 1, 2] = (top + bottom) / (top - bottom)
    matrices[..., 2, 2] = -(far + near) / (far - near)
    matrices[..., 2, 3] = -2.0 * far * near / (far - near)
    matrices[..., 3, 2] = -1.0
    return matrices
