"""The API of one line: a mesh and a camera in, a partial cloud or a depth image out."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.arrays import LARGEST, FloatArray, IntArray, as_flag, as_number, as_numbers
from zbuf_occlude.dataset.records import draw
from zbuf_occlude.errors import ArgumentError, MeshError, check_choice, check_int
from zbuf_occlude.geometry.camera import field_of_view, picture_frusta
from zbuf_occlude.geometry.cloud import Cloud
from zbuf_occlude.geometry.colors import Bytes, barycentric
from zbuf_occlude.geometry.mesh import Mesh, MeshLike, as_mesh
from zbuf_occlude.geometry.sampling import Seed, SurfacePoints, sample_surface
from zbuf_occlude.provenance import generator
from zbuf_occlude.sensors import Sensor, scan
from zbuf_occlude.sensors.poses import pose_of_camera
from zbuf_occlude.views import PAPER_DISTANCE, Views, from_angles
from zbuf_occlude.views.model import MOST_PIXELS
from zbuf_occlude.visibility import check_keywords, find_method, prepare
from zbuf_occlude.visibility.interface import VisibilityQuery

N_POINTS = 2048
"""Of a partial cloud by default."""
FRAMES = ("object", "camera")
ROUNDS = 8
"""So often more points are sampled before those found are taken, and some repeated."""
PER_POINT = 4
"""So many points are sampled for each that is wanted, in the first round: most eyes see a third and more."""
LEAST_FRACTION = 0.02
"""No later round samples more than if this share were visible."""


@dataclass(frozen=True, eq=False, repr=False)
class PartialCloud(Cloud):
    """What one camera or sensor sees of a mesh. ``numpy.asarray(cloud)`` is its points.

    Parameters
    ----------
    points : (n, 3) float
        In the mesh's own coordinates, or the camera's (`occlude` with ``frame="camera"``). In random order.
    normals : (n, 3) float
        Unit, turned towards the eye.
    colors : (n, 3) uint8 or None
        Base colours, sRGB, where they were asked for.
    face_ids : (n,) int
        The face that each point lies on; of a file, of ``load_mesh(path).faces``.
    eye : (3,) float
        The centre of projection, in the frame of the points.
    visible_fraction : float or None
        Share of the sampled surface points that the eye sees; None of a sensor, which samples no surface.
    pose : (4, 4) float
        View matrix: the mesh's coordinates to the camera's (x right, y up, looking along -z).

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
        """Return all that is known, by name: the arrays of a .npz file."""
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
    up: str | None = None,
    unit: str | None = None,
    colors: bool = False,
    **options: Any,
) -> PartialCloud:
    """Return the partial point cloud that one camera sees of a mesh.

    Parameters
    ----------
    mesh : Mesh
        Or anything else that is one: a path, a mesh of trimesh or Open3D, (vertices, faces).
    azimuth, elevation : float
        Where the camera stands about the mesh's centre, at which it looks: degrees from +x towards +y, and above the
        xy plane.
    distance : float
        Of the camera from the centre, in multiples of the mesh's longest side.
    eye : (3,) float or Views, optional
        Instead of the angles: the camera's place in the mesh's own coordinates, from which it looks at the centre; or
        Views of one, such as ``zo.views.for_mesh(mesh, "paper100")[0]``.
    n_points : int, optional
        Points of the cloud, 2,048 by default (of a sensor: all its returns).
    density : float, optional
        Instead of `n_points`: points sampled per unit of area, in the mesh's unit; all visible ones are returned.
    seed : int, SeedSequence or Generator
        The same seed gives the same cloud.
    method : str
        A name of the table `METHODS`: who decides what is visible, or casts a sensor's rays.
    sensor : str or Sensor, optional
        The points are the first hits of its rays, as `zbuf_occlude.scan` makes them: the mesh's unit is the metre.
    frame : {"object", "camera"}
        Of points, normals and eye: the mesh's own coordinates, or the camera's (x right, y up, looking along -z).
    up : {"z", "y"}, optional
        Which way is up in the mesh. Here z is: one with y up is turned, (x, y, z) to (x, -z, y), and its own
        coordinates are then those. By default "y" for glTF files, and "z" for all else.
    unit : {"mm", "cm", "m", "in"}, optional
        Of the mesh, whose own coordinates are metres then. By default its numbers stay, whatever they are.
    colors : bool
        Read base colours too, of what has them; grey where it has not.
    **options
        The method's own; ``zbuf-occlude methods`` lists them.

    Returns
    -------
    PartialCloud

    Raises
    ------
    ArgumentError
        No mesh, no camera, both of two alternatives, or a value out of range.
    MeshError
        The mesh cannot be used, or the eye sees none of the points.
    OptionError, UnavailableError, GlError
        As `prepare`.

    Warns
    -----
    UserWarning
        The eye lies inside the mesh's bounding box.

    Notes
    -----
    How `n_points` come about: four points for each that is wanted are sampled uniformly over the whole surface, and
    the visible ones are kept. While these are too few, more are sampled, by the share that was visible so far, in at
    most eight rounds. Of all visible points `n_points` are drawn at random without repetition. Only where eight rounds
    give too few do points repeat. So a cloud is uniform over the visible surface.

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
    check_keywords(occlude, method, options)
    mesh = as_mesh(mesh, up=up, unit=unit, colors=as_flag(colors, "colors"))
    view, at = _view(mesh, azimuth, elevation, distance, eye)
    if n_points is not None and density is not None:
        raise ArgumentError(f"give n_points or density, not both; got {n_points} and {density}.")
    if n_points is not None:
        check_int("n_points", n_points, 1)
    rng = generator(seed)
    fraction = None
    if sensor is None:
        with prepare(mesh, method, **options) as occluder:
            found, fraction = _visible(mesh, occluder, view, at, n_points, density, rng)
    else:
        if density is not None:
            raise ArgumentError("density must go without a sensor, which decides itself. Leave it out.")
        found = _scanned(mesh, sensor, view, n_points, rng, method, options)
    points, normals, pose = found.positions, found.normals_towards(at), view.poses[0]
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
    """Return the depth image that one camera has of a mesh, by rays through the centres of the pixels.

    Parameters
    ----------
    mesh, azimuth, elevation, distance, eye, up, unit
        As in `occlude`.
    resolution : int
        Pixels along a side.
    fov : float, optional
        Field of view, degrees. By default the picture holds the mesh, with a small border.
    method : str
        Who casts the rays: a name of the table `METHODS` that can.
    **options
        The method's own.

    Returns
    -------
    (resolution, resolution) float64
        Eye depth, the distance along the camera's axis in the mesh's unit; infinite where no face is. The first row is
        the highest.

    Raises
    ------
    ArgumentError
        As `occlude`; an eye so near that no single picture holds the mesh.
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
    check_int("resolution", resolution, 1)
    if resolution**2 > MOST_PIXELS:
        raise ArgumentError(f"resolution must be at most {math.isqrt(MOST_PIXELS)} pixels; got {resolution}.")
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
    """Return the one view that a person described, world units, and its eye (3,)."""
    if eye is None and azimuth is None and elevation is None:
        raise ArgumentError("give azimuth and elevation, degrees, or eye: where the camera stands.")
    distance = as_number(distance, "distance", "a positive number", lambda number: number > 0.0)
    if eye is not None and (azimuth is not None or elevation is not None or distance != PAPER_DISTANCE):
        raise ArgumentError("azimuth, elevation and distance must go without eye, which says all. Leave them out.")
    if mesh.longest_side == 0.0:
        raise MeshError(f"a mesh must have an extent to be seen; all vertices of {mesh.name} coincide.")
    if eye is None:
        degrees = [0.0 if angle is None else angle for angle in (azimuth, elevation)]
        view = from_angles(degrees[0], degrees[1], distance).around(mesh.centre, mesh.longest_side)
        return view, view.eyes[0]
    if isinstance(eye, Views):
        if len(eye) != 1:
            raise ArgumentError(f"eye must be one view; got {len(eye)}. Take one: views[0].")
        return eye, eye.eyes[0]
    at = as_numbers(eye, "eye", (3,))
    if not (np.abs(at) <= LARGEST).all():  # NaN is not
        raise ArgumentError(f"eye must be finite and below {LARGEST:g}; got {at.tolist()}.")
    turned = Views.from_cameras(at[None], np.eye(3)[None], target=mesh.centre)
    if not turned.distance.all():
        raise ArgumentError(f"eye must not be the mesh's centre, at which it looks; got {at.tolist()}.")
    return Views(turned.azimuth, turned.elevation, turned.distance, mesh.centre), at


def _visible(
    mesh: Mesh,
    occluder: VisibilityQuery,
    view: Views,
    eye: FloatArray,
    n_points: int | None,
    density: float | None,
    rng: np.random.Generator,
) -> tuple[SurfacePoints, float]:
    """Return visible points, in random order, as the notes of `occlude` say, and the share of points that are."""
    wanted = n_points or N_POINTS
    parts, n_sampled, n_found = list[SurfacePoints](), 0, 0
    asked: dict[str, Any] = {"n_points": PER_POINT * wanted} if density is None else {"density": density}
    for _ in range(ROUNDS if density is None else 1):
        points = sample_surface(mesh, seed=rng, **asked)
        parts.append(points[occluder.visible(points, eye) & view.in_frustum(points.positions)[0]])
        occluder.warns = False  # once is enough
        n_sampled, n_found = n_sampled + len(points), n_found + len(parts[-1])
        if n_found >= wanted:
            break
        share = max(n_found / max(n_sampled, 1), LEAST_FRACTION)
        asked = {"n_points": math.ceil(1.15 * (wanted - n_found) / share)}
    if not n_sampled:
        raise MeshError(
            f"density must give a point at least; {density:g} gives none on an area of {mesh.areas.sum():g}."
        )
    if not n_found:
        raise MeshError(f"a mesh must show something to the eye; of {n_sampled} points of {mesh.name} none is visible.")
    chosen = draw(np.arange(n_found), None if density is not None else wanted, rng)
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
    """Return what a sensor in the camera's place measures, in random order."""
    found = scan(mesh, sensor, pose_of_camera(view.poses[0]), seed=rng, method=method, **options)
    if not len(found):
        away = float(np.linalg.norm(view.eyes[0] - mesh.centre))
        raise MeshError(
            f"a mesh must return some ray of the sensor; {mesh.name}, {mesh.longest_side:.4g} m long and {away:.4g} m "
            "away, returns none. Move it nearer, or give unit= if these are no metres."
        )
    found = found.select(draw(np.arange(len(found)), n_points, rng))
    colors = None
    if mesh.colors is not None:
        met = found.starts + found.clean_ranges[:, None] * found.directions
        colors = mesh.colors.at(found.face_ids, barycentric(mesh.corners[found.face_ids], met))
    return SurfacePoints(found.points, found.face_ids, found.normals, colors)
