"""Poses of sensors: rigid transforms from the sensor's frame to the world."""

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.base.arrays import FloatArray, as_vector
from zbuf_occlude.base.errors import ArgumentError


def look_at(position: ArrayLike, target: ArrayLike, up: ArrayLike | None = None) -> FloatArray:
    """Return the pose (4, 4) of a sensor at `position` that looks at `target`.

    The sensor's z axis is as near to `up` (3,) as possible: +z by default, or +y for a target straight above or below.

    Raises
    ------
    ArgumentError
        The position coincides with the target, or `up` is parallel to the line of sight.

    Examples
    --------
    >>> zo.sensors.look_at([10, 0, 2], [0, 0, 2])[:3, 0].tolist()
    [-1.0, 0.0, 0.0]
    """
    at, towards = as_vector(position, "position"), as_vector(target, "target")
    forward = towards - at
    if not forward.any():
        raise ArgumentError(f"The sensor coincides with its target: both are at {at.tolist()}. Move one.")
    forward = forward / np.linalg.norm(forward)
    default = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 1.0 - 1e-9 else np.array([0.0, 1.0, 0.0])
    left = np.cross(default if up is None else as_vector(up, "up"), forward)
    if not np.linalg.norm(left) > 0.0:
        raise ArgumentError("up must not be parallel to the line of sight. Give another.")
    left /= np.linalg.norm(left)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([forward, left, np.cross(forward, left)], axis=1)
    pose[:3, 3] = at
    return pose


def pose_of_camera(view_matrix: FloatArray) -> FloatArray:
    """Return the pose (4, 4) of a sensor with the position and orientation of a camera, given its view matrix."""
    rotation = view_matrix[:3, :3]
    pose = np.eye(4)
    pose[:3, :3] = np.stack([-rotation[2], -rotation[0], rotation[1]], axis=1)
    pose[:3, 3] = -rotation.T @ view_matrix[:3, 3]
    return pose
