"""Inspection: the shares of faces and of a whole surface that eyes or a sensor see, and the best order of views.

A point counts as seen by a sensor where it is visible, within the field of view, the limits of range and of incidence,
and dense enough. Losses at random, noise and the matching of stereo pictures are left out.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray, as_flag, as_number, unit_vectors
from zbuf_occlude.base.errors import ArgumentError, MeshError, check_int
from zbuf_occlude.base.provenance import generator
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.conversion import MeshLike, as_mesh
from zbuf_occlude.meshes.sampling import Seed, SurfacePoints, error_of_share, points_in_triangles, sample_surface
from zbuf_occlude.sensors.casting import prepare_scene
from zbuf_occlude.sensors.catalog import make
from zbuf_occlude.sensors.poses import look_at, pose_of_camera
from zbuf_occlude.sensors.scenes.scene import Scene
from zbuf_occlude.sensors.second_camera import visible_from_own_eyes, visible_to_second_camera
from zbuf_occlude.sensors.sensor import Sensor
from zbuf_occlude.views import Views
from zbuf_occlude.visibility import check_keywords, find_method
from zbuf_occlude.visibility.interface import CONTACT, VisibilityQuery, as_eyes
from zbuf_occlude.visibility.visible_surface import WHOLE


class VisibleFaces(NamedTuple):
    """Share of each face that each eye sees.

    fraction : (k, f) float64, share of the face's area
    standard_error : (k, f) float64, of `fraction`: the posterior standard deviation of the share, from a uniform prior;
        0 exactly if the face is cut
    n_points : (f,) int64, number of sampled points on the face
    proved : (k, f) bool, True if the face is cut and the eye sees all of it, `fraction` 1, or nothing, 0. False without
        `exactly`.
    """

    fraction: FloatArray
    standard_error: FloatArray
    n_points: IntArray
    proved: BoolArray


class Coverage(NamedTuple):
    """Share of a surface that a sequence of views sees.

    order : (k,) int64, number of each view of the sequence: 0 to k - 1, or with `greedy` the order chosen
    alone : (k,) float64, share of the area that the view sees
    gain : (k,) float64, share that the view sees and none before it in the sequence
    together : (k,) float64, share that this view and the ones before it see together
    standard_error : (k,) float64, of `together`: above 0 even if no sampled point, or every one, is seen
    """

    order: NDArray[np.intp]
    alone: FloatArray
    gain: FloatArray
    together: FloatArray
    standard_error: FloatArray


class _Inspected(NamedTuple):
    """A surface in question, within all that can hide it."""

    scene: Scene
    face_ids: IntArray  # of the surface, in the scene's mesh
    mesh: Mesh  # those faces


def visible_faces(
    scene: Scene | MeshLike,
    eyes: ArrayLike | Views,
    *,
    sensor: Sensor | str | Path | None = None,
    min_density: float = 0.0,
    points_per_face: int = 16,
    n_points: int = 100_000,
    seed: Seed = 0,
    exactly: bool = False,
    method: str = "exact",
    **options: Any,
) -> VisibleFaces:
    """Return the share of each face's area that each eye sees: estimated from random points on it, or cut exactly.

    Parameters
    ----------
    scene : Scene or Mesh
        Of a scene, the faces of the target (``scene.instances == 0``, in that order), which all of the scene hides; its
        transparent faces hide nothing. Or any other mesh (`as_mesh`), opaque.
    eyes : (3,) or (k, 3) float, or Views
        World space. As of `coverage`.
    sensor, min_density
        As of `coverage`.
    points_per_face : int
        Minimum number of points on each face.
    n_points : int
        Number of additional points, distributed by area for the accuracy of large faces.
    seed : int
    exactly : bool
        Cut the faces along the edges of the shadows, as `visible_mesh`: exact except for rounding, and for other faces
        nearer than the contact tolerance. Shares within 1e-9 of 0 or 1 become 0 or 1. Faces that are edge-on or needles
        to within 1e-9 are still sampled, as are all faces for an eye in the plane and the box of a face.
    method : str
        Name in the table of methods. With an exact method the only error is that of sampling.
    **options
        Options of the method.

    Raises
    ------
    ArgumentError
        A number is out of range; `exactly` with a method that is not exact, a sensor, fields of view or transparent
        faces.
    MeshError
        The mesh, or the target, has no area.
    OptionError, UnavailableError, GlError
        As `prepare`, `VisibilityQuery.visible` and `sensors.make`.

    Examples
    --------
    >>> mesh = zo.load_mesh("chair.off")
    >>> found = zo.visible_faces(mesh, zo.views.for_mesh(mesh, "paper100").eyes[:4])
    >>> found.fraction.shape == (4, len(mesh.faces))
    True
    """
    check_keywords(visible_faces, method, options)
    target = _inspected(scene)
    check_int("points_per_face", points_per_face, 1)
    check_int("n_points", n_points, 0)
    counts = points_per_face + np.floor(n_points * target.mesh.areas / target.mesh.areas.sum()).astype(np.int64)
    places = points_in_triangles(target.mesh.corners, counts, generator(seed))
    which = np.repeat(target.face_ids, counts)
    points = SurfacePoints.of_checked(places, which, target.scene.mesh.face_normals[which])
    if as_flag(exactly, "exactly"):
        if not find_method(method).exact:
            raise ArgumentError(f"exactly needs an exact method, exact or oracle; got {method}.")
        has_lenses = isinstance(eyes, Views) and eyes.fov_bounds is not None
        if sensor is not None or has_lenses or target.scene.transmittance is not None:
            raise ArgumentError(
                "exactly must go with eyes alone: sensors, fields of view and transparent faces are sampled. Leave it "
                "out."
            )
    seen = _seen(target, points, eyes, sensor, min_density, method, options)
    n_seen = np.add.reduceat(seen, np.cumsum(counts) - counts, axis=1, dtype=np.int64)
    fraction, error = n_seen / counts, error_of_share(n_seen, counts)
    proved = np.zeros(fraction.shape, dtype=bool)
    if exactly:
        from zbuf_occlude.visibility.shadow_cuts import seen_shares  # late: it imports numba

        contact = float(options.get("contact", CONTACT)) * target.scene.mesh.diagonal
        positions = eyes.eyes if isinstance(eyes, Views) else as_eyes(eyes)
        shares = seen_shares(target.scene.mesh, positions, contact)[:, target.face_ids]
        cut, nothing, all_of_it = np.isfinite(shares), shares < WHOLE, shares > 1 - WHOLE
        proved = nothing | all_of_it
        fraction[cut], error[cut] = shares[cut], 0.0
        fraction[nothing], fraction[all_of_it] = 0.0, 1.0
    return VisibleFaces(fraction, error, counts, proved)


def coverage(
    scene: Scene | MeshLike,
    eyes: ArrayLike | Views,
    *,
    sensor: Sensor | str | Path | None = None,
    min_density: float = 0.0,
    greedy: bool = False,
    n_points: int = 20_000,
    seed: Seed = 0,
    method: str = "exact",
    **options: Any,
) -> Coverage:
    """Estimate the share of a surface that views see, each alone and together with those before it.

    Parameters
    ----------
    scene : Scene or Mesh
        Of a scene, the surface of the target, which all of the scene hides; its transparent faces hide nothing, and
        objects that move are where they start. Or any other mesh (`as_mesh`), opaque.
    eyes : (3,) or (k, 3) float, or Views
        World space. Of Views with fields of view, only these are seen. A sensor has its own field of view. It takes the
        poses of Views, and looks from other eyes at the centre of the surface.
    sensor : Sensor, str or Path, optional
        As of `scan`; lengths are then metres. A point counts as seen within its field of view and its limits of range
        and incidence, where its second camera, if it has one, sees it too. A list of rays has no field of view.
    min_density : float
        Smallest number of rays of the sensor per square metre of the surface, from one view, at which a point counts as
        seen. It falls with the square of the range, and with the incidence.
    greedy : bool
        Order the views: next comes the one that sees most of what none before it sees, the first of equals. For each
        number of views, these see at least 1 - 1/e of what any as many see (Nemhauser, Wolsey, Fisher 1978).
    n_points : int
        Number of random points on the surface.
    seed : int
    method : str
        Name in the table of methods.
    **options
        Options of the method.

    Raises
    ------
    ArgumentError
        A number is out of range; `min_density` without a sensor; an eye at the centre that a sensor would look at.
    MeshError
        The mesh, or the target, has no area.
    OptionError, UnavailableError, GlError
        As `prepare`, `VisibilityQuery.visible` and `sensors.make`; `min_density` of a sensor of unknown spacing.

    Examples
    --------
    >>> mesh = zo.load_mesh("chair.off")
    >>> found = zo.coverage(mesh, zo.views.for_mesh(mesh, "paper100"), greedy=True)
    >>> bool(found.together[-1] >= found.alone.max() == found.gain[0])
    True
    """
    check_keywords(coverage, method, options)
    target = _inspected(scene)
    sample = sample_surface(target.mesh, n_points=n_points, seed=seed)
    points = SurfacePoints.of_checked(sample.positions, target.face_ids[sample.face_ids], sample.normals)
    seen = _seen(target, points, eyes, sensor, min_density, method, options)
    order = _greedy_order(seen) if as_flag(greedy, "greedy") else np.arange(len(seen))
    seen = seen[order]
    n_together = np.logical_or.accumulate(seen, axis=0).sum(axis=1)
    gain = np.diff(n_together, prepend=0) / n_points
    return Coverage(order, seen.mean(axis=1), gain, n_together / n_points, error_of_share(n_together, n_points))


def _inspected(scene: Scene | MeshLike) -> _Inspected:
    """Return the target of a scene, or a whole mesh; raise MeshError where it has no area."""
    if not isinstance(scene, Scene):
        mesh = as_mesh(scene, name="scene")  # opaque, whatever its colours
        scene = Scene(mesh, np.zeros(len(mesh.faces), np.int32), (mesh.name,), np.zeros(1))
    whole, face_ids = scene.mesh, np.flatnonzero(scene.instances == 0).astype(np.int32)
    alone = whole if len(face_ids) == len(whole.faces) else Mesh(whole.vertices, whole.faces[face_ids], scene.labels[0])
    if not alone.areas.any():
        raise MeshError(f"{alone.name} has no area.")
    return _Inspected(scene, face_ids, alone)


def _seen(
    target: _Inspected,
    points: SurfacePoints,
    eyes: ArrayLike | Views,
    sensor: Sensor | str | Path | None,
    min_density: float,
    method: str,
    options: dict[str, Any],
) -> BoolArray:
    """Return which points each eye or sensor sees, (k, n)."""
    density = as_number(min_density, "min_density", "points per square metre, at least 0", lambda number: number >= 0.0)
    if sensor is None and density:
        raise ArgumentError(f"min_density must go with a sensor; it is {density:g} without. Give sensor=.")
    places = eyes if isinstance(eyes, Views) else as_eyes(eyes)
    with prepare_scene(target.scene, method, **options) as query:
        query.warn_once(far_faces="contact" not in options)
        if sensor is None:
            return query.visible(points, places)
        model = make(sensor)
        if isinstance(places, Views):
            poses = [pose_of_camera(matrix) for matrix in places.poses]
        else:
            poses = [look_at(eye, target.mesh.centre) for eye in places]
        seen = np.zeros((len(poses), len(points)), dtype=bool)
        for row, pose in zip(seen, poses, strict=True):
            row[:] = _measured(query, points, pose, model, density)
    return seen


def _measured(
    query: VisibilityQuery, points: SurfacePoints, pose: FloatArray, sensor: Sensor, min_density: float
) -> BoolArray:
    """Return which points (n,) a sensor at a pose (4, 4) measures."""
    model, rotation, origin = sensor.noise_model, pose[:3, :3], pose[:3, 3]
    local = (points.positions - origin) @ rotation
    offsets = sensor.ray_starts(local)
    towards = local - offsets
    ranges = np.maximum(np.linalg.norm(towards, axis=1), np.finfo(np.float64).tiny)
    cosines = np.abs(np.einsum("ij,ij->i", unit_vectors(points.normals) @ rotation, towards)) / ranges
    measured = towards[:, 0] if model.axial else ranges
    seen = sensor.covers(local) & (measured >= model.range_min) & (measured <= model.range_max)
    seen &= cosines >= np.cos(np.radians(model.incidence_max if model.noise else 90.0))
    if min_density:
        seen &= cosines * sensor.ray_density(local) >= min_density
    some = np.flatnonzero(seen)
    asked, starts = points.select(some), origin + offsets[some] @ rotation.T
    if offsets.any():
        seen[some] = visible_from_own_eyes(query, asked, starts)
    else:
        seen[some] = query.visible(asked, origin)
    if len(model.baselines):
        seen[some] &= visible_to_second_camera(
            query, query.mesh, asked.positions, asked.face_ids, starts, rotation, sensor
        )
    return seen


def _greedy_order(seen: BoolArray) -> NDArray[np.intp]:
    """Return the numbers of views (k,) in the greedy order of a mask (k, n) of what each sees.

    Views that add nothing come last, in their own order.
    """
    order, rest = list[int](), seen
    while (gains := rest.sum(axis=1)).any():
        order.append(int(gains.argmax()))
        rest = rest[:, ~rest[order[-1]]]
    others = np.setdiff1d(np.arange(len(seen)), order)
    return np.concatenate([np.array(order, dtype=np.intp), others])
