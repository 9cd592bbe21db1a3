"""Bounding boxes of a scene's objects as KITTI labels them, and the image of the camera beside the LiDAR."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.geometry.colors import Bytes
from zbuf_occlude.sensors.bop import silhouette
from zbuf_occlude.sensors.casting import placed_at, prepare_scene
from zbuf_occlude.sensors.frames import TO_OPENCV, Frame, box_corners, frames
from zbuf_occlude.sensors.returns import Scan
from zbuf_occlude.sensors.scenes.kinds import METHOD, prepared
from zbuf_occlude.sensors.scenes.scene import Placed, Scene
from zbuf_occlude.views import Views
from zbuf_occlude.visibility.interface import VisibilityQuery

WIDTH, HEIGHT = 1242, 375
FOCAL, CENTRE = 721.5377, (609.5593, 172.854)
"""Focal length and principal point of KITTI's rectified cameras on most days, pixels (Geiger and others, CVPR 2012).

The origin is the first pixel's centre."""
TO_CAMERA = np.array([[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, -0.08], [1.0, 0.0, 0.0, -0.27]])
"""LiDAR (x forward, y left, z up) to camera (x right, y down, z forward), metres: KITTI's, without the angles that
differ from day to day."""
BOX = np.dtype([
    ("label", "S32"), ("centre", "<f8", (3,)), ("sides", "<f8", (3,)), ("yaw", "<f8"), ("bbox", "<f4", (4,)),
    ("hidden", "<f4"), ("truncated", "<f4"),
])  # fmt: skip
"""The box of an object.

label : class
centre, sides, yaw : centre; length, width and height; heading. World space, metres and radians.
bbox : first column and row, last column and row of its pixels in the image, hidden ones too
hidden : share of its pixels in the image that others hide
truncated : share of its pixels outside the image

An object without a pixel in the image has `truncated` 1 and `bbox` 0."""


def boxes_of(scene: Scene, occluder: VisibilityQuery, pose: FloatArray, found: Scan) -> tuple[NDArray[Any], Bytes]:
    """Return the boxes (o,) of a scene's objects, as `BOX`, and the grey image (375, 1242). Background has no box.

    Parameters
    ----------
    scene : Scene
        The poses of its objects must not scale.
    occluder : VisibilityQuery
        The prepared scene.
    pose : (4, 4) float
        LiDAR to world.
    found : Scan
        A scan of the scene. Moving objects have their pose at the median time of their points, in the image too.

    Notes
    -----
    A box fits the mesh and is upright where the object's pose is. Its length is the longer of the horizontal sides. The
    heading is +x for a mesh that is longer along x, else -y, as in the built-in cars. Shares count pixels by exact
    rays; pixels outside the image count up to its width and height away.
    """
    if scene.moving:
        scene = _at_scan_time(scene, found)
        occluder = prepare_scene(scene, METHOD)
    frame = next(frames(scene, _camera(pose), width=WIDTH, height=HEIGHT, occluder=occluder))
    boxes = np.zeros(len(scene.placed), BOX)
    for row, (box, each) in enumerate(zip(boxes, scene.placed, strict=True)):
        if each.is_background:
            continue
        box["label"] = as_label(each.label)
        box["centre"], box["sides"], box["yaw"] = box_of(each)
        whole, visible = _whole(each, frame), frame.instances == row
        inside = whole[HEIGHT : 2 * HEIGHT, WIDTH : 2 * WIDTH] | visible
        box["truncated"] = 1.0 - inside.sum() / max(whole.sum(), inside.sum(), 1)
        if inside.any():
            rows, columns = (np.flatnonzero(inside.any(axis=axis)) for axis in (1, 0))
            box["bbox"] = columns[0], rows[0], columns[-1], rows[-1]
            box["hidden"] = 1.0 - visible.sum() / inside.sum()
    return boxes, frame.rgba[..., 0]


class ObjectBox(NamedTuple):
    """The box of an object: centre; length, width and height; heading, radians. World space, metres."""

    centre: FloatArray
    sides: FloatArray
    yaw: float


def box_of(placed: Placed) -> ObjectBox:
    """Return the box that fits an object's mesh, upright where its pose is; its length is the longer side."""
    low, high = placed.mesh.bounds
    sides, turn = high - low, float(np.arctan2(placed.pose[1, 0], placed.pose[0, 0]))
    if sides[1] > sides[0]:
        sides, turn = sides[[1, 0, 2]], turn - np.pi / 2
    centre = placed.pose[:3, :3] @ ((low + high) / 2) + placed.pose[:3, 3]
    return ObjectBox(centre, sides, (turn + np.pi) % (2 * np.pi) - np.pi)


def placed_at_points(placed: Placed, times: FloatArray) -> Placed:
    """Return an object as it is at the median time of its points (n,), seconds; as it is where there are none."""
    return placed_at(placed, float(np.median(times))) if placed.moves and len(times) else placed


def as_label(name: str) -> bytes:
    """Return a class name as `BOX` stores it, cut at a whole character where it is too long."""
    return name.encode()[: BOX["label"].itemsize].decode(errors="ignore").encode()


def _at_scan_time(scene: Scene, found: Scan) -> Scene:
    """Return a static scene in which each moving object has its pose at the median time of its points."""
    placed = list(scene.placed)
    for number, each in scene.moving.items():
        then = placed_at_points(each, found.times[found.instances == number])
        placed[number] = replace(then, velocity=(0.0, 0.0, 0.0), turn=0.0)
    return Scene.joined(placed)


def _camera(pose: FloatArray) -> Views:
    rotation = TO_OPENCV @ TO_CAMERA[:, :3] @ pose[:3, :3].T
    eye = pose[:3, 3] - pose[:3, :3] @ TO_CAMERA[:, :3].T @ TO_CAMERA[:, 3]
    (x, y), sides = CENTRE, np.array([-0.5, WIDTH - 0.5, HEIGHT - 0.5, -0.5])
    fov_bounds = (sides - [x, x, y, y]) / [FOCAL, FOCAL, -FOCAL, -FOCAL]
    return Views.from_cameras(eye[None], rotation[None], fov_bounds[None])


def _whole(placed: Placed, frame: Frame) -> BoolArray:
    """Return the `silhouette` of an object; empty where the object lies behind the camera."""
    bounds, pose = placed.mesh.bounds, frame.pose @ placed.pose
    if (box_corners(bounds) @ pose[2, :3] + pose[2, 3] >= 0.0).all():
        return np.zeros((3 * HEIGHT, 3 * WIDTH), dtype=bool)
    return silhouette(prepared(placed.mesh), bounds, replace(frame, pose=pose))
