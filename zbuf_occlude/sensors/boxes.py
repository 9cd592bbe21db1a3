"""What the camera on a car with a LiDAR shows of a scene: its picture, and a box for each object as KITTI labels it."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.geometry.colors import Bytes
from zbuf_occlude.scenes.kinds import METHOD, ready
from zbuf_occlude.scenes.scene import Placed, Scene
from zbuf_occlude.sensors.bop import silhouette
from zbuf_occlude.sensors.casting import prepare_scene
from zbuf_occlude.sensors.frames import TO_OPENCV, Frame, box_corners, frames
from zbuf_occlude.sensors.motion import Motion
from zbuf_occlude.sensors.scanning import Scan
from zbuf_occlude.views import Views
from zbuf_occlude.visibility.interface import VisibilityQuery

WIDTH, HEIGHT = 1242, 375
FOCAL, CENTRE = 721.5377, (609.5593, 172.854)
"""Pixels, the first pixel's centre at (0, 0): KITTI's rectified cameras on most days (Geiger and others, CVPR 2012)."""
TO_CAMERA = np.array([[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, -0.08], [1.0, 0.0, 0.0, -0.27]])
"""LiDAR (x forward, y left, z up) to camera (x right, y down, z forward), metres: KITTI's, without the angles that
differ from day to day."""
BOX = np.dtype([
    ("label", "S32"), ("centre", "<f8", (3,)), ("sides", "<f8", (3,)), ("yaw", "<f8"), ("window", "<f4", (4,)),
    ("hidden", "<f4"), ("truncated", "<f4"),
])  # fmt: skip
"""An object of a scene: class; middle, length, width and height in metres, and heading in radians, world space; first
column and row in the picture, last ones, also of what others hide; share of its pixels there that others hide; share of
its pixels that lie outside. Where the picture has nothing of it, `truncated` is 1 and `window` 0."""


def boxes_of(scene: Scene, occluder: VisibilityQuery, pose: FloatArray, found: Scan) -> tuple[NDArray[Any], Bytes]:
    """Return the boxes (o,) of a scene's objects, as `BOX`, and the picture (375, 1242), grey; none of background.

    Parameters
    ----------
    scene : Scene
        Of objects whose poses do not scale.
    occluder : VisibilityQuery
        The scene made ready.
    pose : (4, 4) float
        LiDAR to world.
    found : Scan
        Of the scene. Objects that move stand where they are at the median time of their points, in the picture too.

    Notes
    -----
    A box fits the mesh and is upright where the object's pose is. Its length is the longer of the horizontal sides. The
    heading is +x of a mesh that is longer along x, else -y, as of the built-in cars. Shares count pixels by exact rays;
    what lies outside is counted up to a width and a height from the picture.
    """
    if scene.moving:
        scene = _stilled(scene, found)
        occluder = prepare_scene(scene, METHOD)
    frame = next(frames(scene, _camera(pose), width=WIDTH, height=HEIGHT, occluder=occluder))
    boxes = np.zeros(len(scene.placed), BOX)
    for row, (box, each) in enumerate(zip(boxes, scene.placed, strict=True)):
        if each.is_background:
            continue
        low, high = each.mesh.bounds
        sides, turn = high - low, float(np.arctan2(each.pose[1, 0], each.pose[0, 0]))
        if sides[1] > sides[0]:
            sides, turn = sides[[1, 0, 2]], turn - np.pi / 2
        box["label"], box["sides"], box["yaw"] = as_label(each.label), sides, (turn + np.pi) % (2 * np.pi) - np.pi
        box["centre"] = each.pose[:3, :3] @ ((low + high) / 2) + each.pose[:3, 3]
        whole, visible = _whole(each, frame), frame.instances == row
        inside = whole[HEIGHT : 2 * HEIGHT, WIDTH : 2 * WIDTH] | visible
        box["truncated"] = 1.0 - inside.sum() / max(whole.sum(), inside.sum(), 1)
        if inside.any():
            rows, columns = (np.flatnonzero(inside.any(axis=axis)) for axis in (1, 0))
            box["window"] = columns[0], rows[0], columns[-1], rows[-1]
            box["hidden"] = 1.0 - visible.sum() / inside.sum()
    return boxes, frame.picture[..., 0]


def as_label(name: str) -> bytes:
    """Return a class as `BOX` holds it, cut at a character where it is too long."""
    return name.encode()[: BOX["label"].itemsize].decode(errors="ignore").encode()


def _stilled(scene: Scene, found: Scan) -> Scene:
    """Return a scene whose moving objects stand where they are at the median time of their points."""
    placed = list(scene.placed)
    for number, each in scene.moving.items():
        times = found.times[found.instances == number]
        if len(times):
            rotations, places = Motion(each.velocity, each.turn).poses(np.median(times, keepdims=True))
            pose = each.pose.copy()
            pose[:3] = np.column_stack([rotations[0] @ pose[:3, :3], pose[:3, 3] + places[0]])
            placed[number] = replace(each, pose=pose)
        placed[number] = replace(placed[number], velocity=(0.0, 0.0, 0.0), turn=0.0)
    return Scene.joined(placed)


def _camera(pose: FloatArray) -> Views:
    rotation = TO_OPENCV @ TO_CAMERA[:, :3] @ pose[:3, :3].T
    eye = pose[:3, 3] - pose[:3, :3] @ TO_CAMERA[:, :3].T @ TO_CAMERA[:, 3]
    (x, y), sides = CENTRE, np.array([-0.5, WIDTH - 0.5, HEIGHT - 0.5, -0.5])
    window = (sides - [x, x, y, y]) / [FOCAL, FOCAL, -FOCAL, -FOCAL]
    return Views.of_cameras(eye[None], rotation[None], window[None])


def _whole(placed: Placed, frame: Frame) -> BoolArray:
    """Return the pixels of three by three pictures that show an object alone; none of what lies behind the camera."""
    bounds, pose = placed.mesh.bounds, frame.pose @ placed.pose
    if (box_corners(bounds) @ pose[2, :3] + pose[2, 3] >= 0.0).all():
        return np.zeros((3 * HEIGHT, 3 * WIDTH), dtype=bool)
    return silhouette(ready(placed.mesh), bounds, replace(frame, pose=pose))
