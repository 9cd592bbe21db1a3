"""Partial clouds and depth images of one mesh from one camera, in one call."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.base.arrays import LARGEST, FloatArray, IntArray, as_flag, as_number, as_numbers
from zbuf_occlude.base.errors import ArgumentError, MeshError, check_choice, check_int
from zbuf_occlude.base.provenance import generator
from zbuf_occlude.datasets.records import draw_points
from zbuf_occlude.geometry.camera import field_of_view, picture_frusta
from zbuf_occlude.geometry.cloud import Cloud
from zbuf_occlude.geometry.colors import Bytes, barycentric
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.conversion import MeshLike, as_mesh
from zbuf_occlude.meshes.sampling import MAX_POINTS, Seed, SurfacePoints, sample_surface
from zbuf_occlude.sensors import Sensor, scan
from zbuf_occlude.sensors.poses import pose_of_camera
from zbuf_occlude.views import PAPER_DISTANCE, Views, from_angles
from zbuf_occlude.views.model import AXES, MAX_PIXELS, with_axes
from zbuf_occlude.visibility import check_keywords, find_method, precompile, prepare
from zbuf_occlude.visibility.interface import VisibilityQuery

N_POINTS = 2048
"""Default number of points of a partial cloud."""
FRAMES = ("object", "camera")
ROUNDS = 8
"""Maximum sampling rounds; after them points are repeated."""
PER_POINT = 4
"""Points sampled in the first round per point wanted: most eyes see a third of the surface or more."""
MIN_FRACTION = 0.02
"""Smallest visible share assumed for the sample size of later rounds."""


@dataclass(frozen=True, eq=False, repr=False)
class PartialCloud(Cloud):
    """The visible points of a mesh from one camera or sensor. ``numpy.asarray(cloud)`` returns the points.

    Parameters
    ----------
    points : (n, 3) float
        Points in random order, in the mesh's coordinates or the camera's (`occlude` with ``frame="camera"``).
    normals : (n, 3) float
        Unit normals, turned towards the eye.
    colors : (n, 3) uint8 or None
        Base colours, sRGB, if they were requested.
    face_ids : (n,) int
        Face of each point; for a file, index of ``load_mesh(path).faces``.
    eye : (3,) float
        Centre of projection, in the frame of the points.
    visible_fraction : float or None
        Share of the sampled surface points that the eye sees; None for a sensor, which samples no surface.
    pose : (4, 4) float
        View matrix: the mesh's coordinates to the camera's, with the axes that were asked for.

    Examples
    --------
    >>> cloud = zo.occlude("chair.off", azimuth=30, elevation=20)
    >>> cloud.save("partial.ply")
    >>> np.asarray(cloud).shape
    (2048, 3)
    """

    points: FloatArray
    normals: FloatArray
    colors: Bytes | None
    face_ids: IntArray
    eye: FloatArray
    visible_fraction: float | None
    pose: FloatArray

    def __repr__(self) -> str:
        seen = "" if self.visible_fraction is None else f", {self.visible_fraction:.1%} of the surface visible"
        x, y, z = self.eye
        return f"PartialCloud({len(self)} points{seen}, eye ({x:.4g}, {y:.4g}, {z:.4g}))"

    def arrays(self) -> dict[str, Any]:
        """Return all arrays by name, as a .npz file has them."""
        more = {name: getattr(self, name) for name in ("face_ids", "eye", "visible_fraction", "pose")}
        return super().arrays() | {name: value for name, value in more.items() if value is not None}


def occlude(
    mesh: MeshLike,
    *,
    azimuth: float | None = None,
    elevation: float | None = None,
    distance: float = PAPER_DISTANCE,
    eye: ArrayLike | Views | None = None,
    n_points: int | None = None,
    density: float | None = None,
    seed: Seed = 0,
    method: str = "exact",
    sensor: str | Path | Sensor | None = None,
    frame: str = "object",
    axes: str = "opengl",
    up: str | None = None,
    unit: str | None = None,
    colors: bool = False,
    **options: Any,
) -> PartialCloud:
    """Return the partial point cloud of a mesh that one camera sees.

    Parameters
    ----------
    mesh : Mesh
        Or anything else that is a mesh: a path, a mesh of trimesh or Open3D, (vertices, faces).
    azimuth, elevation : float
        Direction from the mesh's centre to the camera, which looks at the centre: degrees from +x towards +y, and above
        the xy plane.
    distance : float
        Distance of the camera from the centre, in multiples of the mesh's longest side.
    eye : (3,) float or Views, optional
        Instead of the angles: the camera's position in the mesh's coordinates, from which it looks at the centre; or
        one view, such as ``zo.views.for_mesh(mesh, "paper100")[0]``.
    n_points : int, optional
        Points of the cloud. Default: 2,048, or all returns of a sensor.
    density : float, optional
        Instead of `n_points`: points sampled per unit of area, in the mesh's unit; all visible ones are returned.
    seed : int, SeedSequence or Generator
        The same seed gives the same cloud.
    method : str
        Visibility method, or ray caster of a sensor: a name of the table `METHODS`.
    sensor : str or Sensor, optional
        The points are the returns of this sensor, as of `zbuf_occlude.scan`; the mesh is in metres.
    frame : {"object", "camera"}
        Frame of points, normals and eye: the mesh's coordinates, or the camera's.
    axes : {"opengl", "opencv"}
        Axes of the camera: x right, y up, looking along -z; or x right, y down, looking along z.
    up : {"z", "y"}, optional
        Axis that points up in the mesh. A mesh with y up is turned, (x, y, z) to (x, -z, y), which are then its
        coordinates. By default "y" for glTF files, and "z" for all others.
    unit : {"mm", "cm", "m", "in"}, optional
        Unit of the mesh, whose coordinates are then metres. By default they stay as they are.
    colors : bool
        Read base colours too; surfaces without a colour are grey.
    **options
        Options of the method; ``zbuf-occlude methods`` lists them.

    Returns
    -------
    PartialCloud

    Raises
    ------
    ArgumentError
        No mesh; no camera; both of two alternatives; a value out of range.
    MeshError
        The mesh cannot be used, or no point of it is visible.
    OptionError, UnavailableError, GlError
        As `prepare`.

    Warns
    -----
    UserWarning
        The eye lies inside the mesh's bounding box.

    Notes
    -----
    Four points for each one wanted are sampled uniformly over the whole surface, and the visible ones are kept. If
    these are too few, more are sampled according to the visible share so far, in at most eight rounds. `n_points` of
    the visible points are drawn at random without repetition; points repeat only where eight rounds give too few. A
    cloud is therefore uniform over the visible surface.

    Examples
    --------
    >>> cloud = zo.occlude("chair.off", azimuth=30, elevation=20, n_points=2048)
    >>> cloud.points.shape, cloud.normals.shape
    ((2048, 3), (2048, 3))
    >>> 0 < cloud.visible_fraction < 1
    True
    >>> zo.occlude("car.obj", eye=(9, 2, 3), sensor="vlp-16", frame="camera").eye.tolist()
    [0.0, 0.0, 0.0]
    """
    check_choice("frame", frame, FRAMES)
    check_choice("axes", axes, AXES)
    check_keywords(occlude, method, options)
    mesh = as_mesh(mesh, up=up, unit=unit, colors=as_flag(colors, "colors"))
    if sensor is None:
        precompile(method, "points")
    view, at = _view(mesh, azimuth, elevation, distance, eye)
    if n_points is not None and density is not None:
        raise ArgumentError(f"give n_points or density, not both; got {n_points} and {density}.")
    if n_points is not None:
        check_int("n_points", n_points, 1)
        if n_points > MAX_POINTS // PER_POINT:
            raise ArgumentError(f"n_points must be at most {MAX_POINTS // PER_POINT:,}; got {n_points:,}.")
    rng = generator(seed)
    fraction = None
    if sensor is None:
        with prepare(mesh, method, **options) as occluder:
            found, fraction = _visible(mesh, occluder, view, at, n_points, density, rng)
    else:
        if density is not None:
            raise ArgumentError("density must not be given with a sensor, whose rays sample the mesh. Leave it out.")
        found = _scanned(mesh, sensor, view, n_points, rng, method, options)
    points, normals, pose = found.positions, found.normals_towards(at), with_axes(view.poses[0], axes)
    if frame == "camera":
        points, normals, at = points @ pose[:3, :3].T + pose[:3, 3], normals @ pose[:3, :3].T, np.zeros(3)
    return PartialCloud(points, normals, found.colors, found.face_ids, at, fraction, pose)


def depth_image(
    mesh: MeshLike,
    *,
    azimuth: float | None = None,
    elevation: float | None = None,
    distance: float = PAPER_DISTANCE,
    eye: ArrayLike | Views | None = None,
    resolution: int = 512,
    fov: float | None = None,
    up: str | None = None,
    unit: str | None = None,
    method: str = "exact",
    **options: Any,
) -> FloatArray:
    """Return the depth image of a mesh from one camera, by rays through the centres of the pixels.

    Parameters
    ----------
    mesh, azimuth, elevation, distance, eye, up, unit
        As in `occlude`.
    resolution : int
        Pixels along a side.
    fov : float, optional
        Field of view, degrees. By default the image contains the mesh with a small border.
    method : str
        Ray caster, a name of the table `METHODS`.
    **options
        Options of the method.

    Returns
    -------
    (resolution, resolution) float64
        Eye depth, the distance along the camera's axis in the mesh's unit; infinite where there is no face. The first
        row is the uppermost.

    Raises
    ------
    ArgumentError
        As `occlude`; an eye so near that no image contains the mesh.
    OptionError, UnavailableError, GlError
        As `prepare`; a method that casts no rays.

    Examples
    --------
    >>> depth = zo.depth_image("chair.off", azimuth=30, elevation=20, resolution=64)
    >>> depth.shape, bool(np.isinf(depth[0, 0]))
    ((64, 64), True)
    """
    check_keywords(depth_image, method, options)
    find_method(method).check_first_hits()
    mesh = as_mesh(mesh, up=up, unit=unit)
    precompile(method, "rays")
    check_int("resolution", resolution, 1)
    if resolution**2 > MAX_PIXELS:
        raise ArgumentError(f"resolution must be at most {math.isqrt(MAX_PIXELS)} pixels; got {resolution}.")
    view, at = _view(mesh, azimuth, elevation, distance, eye)
    if fov is not None:
        view = view.looking(None, field_of_view(fov))
    frusta = picture_frusta(view.poses, mesh.vertices[np.unique(mesh.faces)], view.fov_bounds)
    left, right, bottom, top = (float(side[0]) for side in frusta[:4])
    centres = (np.arange(resolution) + 0.5) / resolution
    x, y = np.meshgrid(left + centres * (right - left), top - centres * (top - bottom))
    directions = np.stack([x, y, np.full_like(x, -1.0)], axis=-1).reshape(-1, 3)
    with prepare(mesh, method, **options) as occluder:
        distances = occluder.first_hits(at[None], directions @ view.poses[0, :3, :3]).distances
    return np.asarray(distances / np.linalg.norm(directions, axis=1)).reshape(resolution, resolution)


def _view(
    mesh: Mesh, azimuth: float | None, elevation: float | None, distance: float, eye: ArrayLike | Views | None
) -> tuple[Views, FloatArray]:
    """Return the view of `occlude`'s arguments, world units, and its eye (3,)."""
    if eye is None and azimuth is None and elevation is None:
        raise ArgumentError("give azimuth and elevation, degrees, or eye: the camera's position.")
    distance = as_number(distance, "distance", "a positive number", lambda number: number > 0.0)
    if eye is not None and (azimuth is not None or elevation is not None or distance != PAPER_DISTANCE):
        raise ArgumentError("azimuth, elevation and distance must not be given with eye. Leave them out.")
    if mesh.longest_side == 0.0:
        raise MeshError(f"{mesh.name} has no extent: all its vertices coincide.")
    if eye is None:
        degrees = [0.0 if angle is None else angle for angle in (azimuth, elevation)]
        view = from_angles(degrees[0], degrees[1], distance).around(mesh.centre, mesh.longest_side)
        return view, view.eyes[0]
    if isinstance(eye, Views):
        if len(eye) != 1:
            raise ArgumentError(f"eye must be one view; got {len(eye)}. Take one: views[0].")
        return eye, eye.eyes[0]
    at = as_numbers(eye, "eye", (3,))
    if not (np.abs(at) <= LARGEST).all():  # False for NaN
        raise ArgumentError(f"eye must be finite and below {LARGEST:g}; got {at.tolist()}.")
    unturned = Views.from_cameras(at[None], np.eye(3)[None], target=mesh.centre)
    if not unturned.distance.all():
        raise ArgumentError(f"eye must not be the mesh's centre, at which it looks; got {at.tolist()}.")
    return Views(unturned.azimuth, unturned.elevation, unturned.distance, mesh.centre), at


def _visible(
    mesh: Mesh,
    occluder: VisibilityQuery,
    view: Views,
    eye: FloatArray,
    n_points: int | None,
    density: float | None,
    rng: np.random.Generator,
) -> tuple[SurfacePoints, float]:
    """Return visible points in random order, sampled as the notes of `occlude` say, and the visible share."""
    wanted = n_points or N_POINTS
    parts, n_sampled, n_found = list[SurfacePoints](), 0, 0
    size: dict[str, Any] = {"n_points": PER_POINT * wanted} if density is None else {"density": density}
    for _ in range(ROUNDS if density is None else 1):
        points = sample_surface(mesh, seed=rng, **size)
        parts.append(points[occluder.visible(points, eye) & view.in_frustum(points.positions)[0]])
        n_sampled, n_found = n_sampled + len(points), n_found + len(parts[-1])
        if n_found >= wanted:
            break
        share = max(n_found / max(n_sampled, 1), MIN_FRACTION)
        size = {"n_points": min(math.ceil(1.15 * (wanted - n_found) / share), MAX_POINTS)}
    if not n_sampled:
        raise MeshError(f"density {density:g} gives no point on an area of {mesh.areas.sum():g}. Raise it.")
    if not n_found:
        raise MeshError(f"No point of mesh {mesh.name} is visible from this view ({n_sampled} sampled).")
    chosen = draw_points(np.arange(n_found), None if density is not None else wanted, rng)
    return SurfacePoints.joined(parts)[chosen], n_found / n_sampled


def _scanned(
    mesh: Mesh,
    sensor: str | Path | Sensor,
    view: Views,
    n_points: int | None,
    rng: np.random.Generator,
    method: str,
    options: dict[str, Any],
) -> SurfacePoints:
    """Return the returns of a sensor at the camera's pose, in random order."""
    found = scan(mesh, sensor, pose_of_camera(view.poses[0]), seed=rng, method=method, **options)
    if not len(found):
        away = float(np.linalg.norm(view.eyes[0] - mesh.centre))
        raise MeshError(
            f"The sensor has no return of {mesh.name}, {mesh.longest_side:.4g} m long and {away:.4g} m away. Move it "
            "nearer, or give unit= if the mesh is not in metres."
        )
    found = found.select(draw_points(np.arange(len(found)), n_points, rng))
    colors = None
    if mesh.colors is not None:
        met = found.starts + found.clean_ranges[:, None] * found.directions
        colors = mesh.colors.at(found.face_ids, barycentric(mesh.corners[found.face_ids], met))
    return SurfacePoints(found.points, found.face_ids, found.normals, colors)
