"""The second camera of a triangulating sensor: the returns that both cameras see, and that stereo can match."""

import numpy as np

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray, unit_vectors
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.sensors.echoes import Echoes
from zbuf_occlude.sensors.noise import EDGE
from zbuf_occlude.sensors.rays import Rays
from zbuf_occlude.sensors.sensor import Sensor
from zbuf_occlude.visibility.interface import VisibilityQuery

EYES_PER_QUERY = 16
"""Eyes that share one visibility query, about the points of all of them, where each ray has its own eye."""


def select_triangulated(
    found: Echoes,
    occluder: VisibilityQuery,
    mesh: Mesh,
    rays: Rays,
    points: FloatArray,
    starts: FloatArray,
    rotation: FloatArray,
    sensor: Sensor,
) -> Echoes:
    """Return the echoes that a second camera sees too and, in a stereo camera, that matching finds.

    `points` (m, 3) are those of the echoes, `starts` (m, 3) those of their rays, world space; `rotation` is from the
    sensor's frame to the world.
    """
    model = sensor.noise_model
    visible = visible_to_second_camera(occluder, mesh, points, found.face_ids, starts, rotation, sensor)
    if model.match_window > 1 and model.noise and sensor.kind == "pinhole":
        depths = found.ranges * rays.directions[found.rays, 0]
        visible &= _matched(rays.rings[found.rays], rays.columns[found.rays], depths, visible, sensor)
    return found.select(visible)


def visible_to_second_camera(
    occluder: VisibilityQuery,
    mesh: Mesh,
    points: FloatArray,
    face_ids: IntArray,
    starts: FloatArray,
    rotation: FloatArray,
    sensor: Sensor,
) -> BoolArray:
    """Return which points (n,) met from `starts` a second camera sees from the same side of the face."""
    model, visible = sensor.noise_model, np.zeros(len(points), dtype=bool)
    normals = unit_vectors(mesh.face_normals[face_ids])
    side = np.einsum("ij,ij->i", normals, starts - points)
    least = np.cos(np.radians(model.baseline_incidence_max if model.noise else 90.0))
    for baseline in model.baselines:
        eyes = starts + rotation @ baseline
        towards = eyes - points
        height = np.einsum("ij,ij->i", normals, towards)
        cosine = np.abs(height) / np.maximum(np.linalg.norm(towards, axis=1), np.finfo(np.float64).tiny)
        candidates = ~visible & (side * height > 0.0) & (cosine >= least)
        if sensor.kind == "pinhole":
            candidates &= sensor.covers(-towards @ rotation)
        some = np.flatnonzero(candidates)
        queried = SurfacePoints(points[some], face_ids[some], normals[some])
        visible[some] = visible_from_own_eyes(occluder, queried, eyes[some])
    return visible


def visible_from_own_eyes(occluder: VisibilityQuery, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
    """Return which points (n,) are visible, each from its own eye (n, 3). Fast where few eyes differ."""
    unique, eye_of = np.unique(eyes, axis=0, return_inverse=True)
    order = np.argsort(eye_of.reshape(-1), kind="stable")
    eye_of, visible = eye_of.reshape(-1)[order], np.zeros(len(points), dtype=bool)
    for first in range(0, len(unique), EYES_PER_QUERY):
        begin, end = np.searchsorted(eye_of, [first, first + EYES_PER_QUERY])
        mine = order[begin:end]
        mask = occluder.visible(points.select(mine), unique[first : first + EYES_PER_QUERY])
        visible[mine] = mask[eye_of[begin:end] - first, np.arange(len(mine))]
    return visible


def _matched(rows: IntArray, columns: IntArray, depths: FloatArray, visible: BoolArray, sensor: Sensor) -> BoolArray:
    """Return which pixels (n,) stereo matching finds.

    A pixel is lost where its matching window has a depth nearer by `EDGE`, or an equally near one that only one camera
    sees. The depth of a pixel with several echoes is that of the nearest.
    """
    half = int(sensor.noise_model.match_window) // 2
    shape = sensor.pattern["height"] + 2 * half, sensor.pattern["width"] + 2 * half
    at, own, nearest = (rows + half, columns + half), np.full(shape, np.inf), np.full(shape, np.inf)
    np.minimum.at(own, at, depths)
    np.minimum.at(nearest, at, depths * np.where(visible, 1.0, (1.0 - EDGE) / (1.0 + EDGE)))
    for axis in (0, 1):
        nearest = np.lib.stride_tricks.sliding_window_view(nearest, 2 * half + 1, axis=axis).min(axis=-1)
    return np.asarray(nearest[rows, columns] >= (1.0 - EDGE) * own[at])
