"""Frames: depth, normals, faces and instances of each pixel, by rays through the pixels' centres; frames as files.

The depth is exact, or as a depth camera measures it. All else is of the first hits, exact.
"""

import io
import json
import os
import re
import warnings
from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray, as_flag, as_number
from zbuf_occlude.base.documents import as_new_path
from zbuf_occlude.base.errors import ArgumentError, OptionError, check_int
from zbuf_occlude.base.extras import importing
from zbuf_occlude.base.jit.compiler import njit
from zbuf_occlude.base.provenance import generator
from zbuf_occlude.geometry.camera import field_of_view
from zbuf_occlude.geometry.colors import GREY, Bytes, barycentric
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.conversion import MeshLike, as_mesh
from zbuf_occlude.sensors.casting import prepare_scene
from zbuf_occlude.sensors.catalog import make
from zbuf_occlude.sensors.noise import apply_noise
from zbuf_occlude.sensors.poses import pose_of_camera
from zbuf_occlude.sensors.scanning import noiseless_scan
from zbuf_occlude.sensors.scenes.scene import Scene
from zbuf_occlude.sensors.sensor import Sensor
from zbuf_occlude.views import Views
from zbuf_occlude.views.model import MAX_PIXELS, check_views
from zbuf_occlude.visibility import find_method, prepare
from zbuf_occlude.visibility.interface import VisibilityQuery

WIDTH, HEIGHT = 640, 480
MARGIN = 1.05
"""Width of an image over that of the mesh, where the field of view is chosen."""
BALL_LIMIT = 0.9
"""Largest radius of the mesh's bounding ball, over the camera's distance, for a field of view that fits the ball.

Nearer cameras get one that fits the vertices."""
WIDEST = 10.0
"""Tangent of half the widest field of view that is chosen: 169 degrees."""
TO_OPENCV = np.diag([1.0, -1.0, -1.0])
"""Matrix from eye space (x right, y up, looking along -z) to OpenCV's (x right, y down, looking along z)."""
DEPTH_LEVELS = 2**16 - 1
TRANSFORMS, CAMERAS = "transforms.json", "cameras.json"
_WRITTEN = re.compile(r"\d{3,}((_depth|_mask|_normal|_instance)?\.png|\.npy)|transforms\.json|cameras\.json")
"""Names of the files of frames."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One image of a pinhole camera, (h, w); the first row is the uppermost.

    Parameters
    ----------
    depth : (h, w) float32
        Depth along the camera's axis, world units; infinite where nothing is hit, or where a sensor measures nothing.
    face_ids : (h, w) int32
        Face of the mesh or scene; -1 where nothing is hit.
    instances : (h, w) int32
        Object of the scene; -1 where nothing is hit.
    normals : (h, w, 3) float32
        Unit normal of the face, world space, turned towards the camera; 0 where nothing is hit.
    colors : (h, w, 3) uint8 or None
        Base colours, sRGB; None for a mesh without colours.
    intrinsics : (3, 3) float
        K, pixels; the centre of the first pixel is (0.5, 0.5).
    pose : (4, 4) float
        View matrix: world space to eye space (x right, y up, looking along -z).

    Examples
    --------
    >>> frame = next(zo.frames("chair.off", zo.views.from_angles(30, 20), width=64, height=48))
    >>> frame.depth.shape, frame.normals.shape
    ((48, 64), (48, 64, 3))
    >>> bool(len(frame.points) == frame.mask.sum())
    True
    """

    depth: NDArray[np.float32]
    face_ids: IntArray
    instances: IntArray
    normals: NDArray[np.float32]
    colors: Bytes | None
    intrinsics: FloatArray
    pose: FloatArray

    def __repr__(self) -> str:
        height, width = self.depth.shape
        return f"Frame({width} x {height}, {self.mask.mean():.1%} covered)"

    @property
    def mask(self) -> BoolArray:
        """True where a pixel hits something, (h, w), whether or not a sensor measures it."""
        return np.asarray(self.face_ids >= 0)

    @property
    def extrinsics(self) -> FloatArray:
        """[R | t] (3, 4): world space to OpenCV's camera space (x right, y down, looking along z)."""
        return np.asarray(TO_OPENCV @ self.pose[:3])

    @property
    def camera_to_world(self) -> FloatArray:
        """Inverse of `pose` (4, 4): NeRF's ``transform_matrix``."""
        found = np.eye(4)
        found[:3, :3] = self.pose[:3, :3].T
        found[:3, 3] = -self.pose[:3, :3].T @ self.pose[:3, 3]
        return found

    @property
    def points(self) -> FloatArray:
        """Centres of the measured pixels at their depths, world space, (n, 3), row by row."""
        rotation, origin = self.extrinsics[:, :3], self.extrinsics[:, 3]
        return np.asarray((self.organized[np.isfinite(self.depth)] - origin) @ rotation)

    @property
    def organized(self) -> FloatArray:
        """Points of all pixels, (h, w, 3), OpenCV's camera space; NaN where there is no depth."""
        (fx, _, cx), (_, fy, cy), _ = self.intrinsics
        height, width = self.depth.shape
        depth = np.where(np.isfinite(self.depth), self.depth, np.nan).astype(np.float64)
        x, y = (np.arange(width) + 0.5 - cx) / fx, (np.arange(height) + 0.5 - cy) / fy
        return np.stack([x * depth, y[:, None] * depth, depth], axis=-1)

    @property
    def opencv_intrinsics(self) -> FloatArray:
        """K (3, 3) with the centre of the first pixel at (0, 0), as OpenCV, ROS, BOP and Open3D have it."""
        return self.intrinsics - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])

    @property
    def camera(self) -> dict[str, Any]:
        """K, R and t (world space to OpenCV's camera space), width and height as plain data, as `from_json` reads.

        The centre of the first pixel is (0.5, 0.5) in K.
        """
        height, width = self.depth.shape
        matrices = {"K": self.intrinsics, "R": self.extrinsics[:, :3], "t": self.extrinsics[:, 3]}
        return {**{name: values.tolist() for name, values in matrices.items()}, "width": width, "height": height}

    def with_depths(self, rows: IntArray, columns: IntArray, points: FloatArray) -> "Frame":
        """Return the frame with the depths of points (n, 3), world space, at pixels; the nearest of each pixel."""
        depth = np.full(self.depth.shape, np.inf, np.float32)
        away = -(points.astype(np.float64) @ self.pose[2, :3] + self.pose[2, 3])
        np.minimum.at(depth, (rows, columns), away.astype(np.float32))
        return replace(self, depth=depth)

    @property
    def rgba(self) -> Bytes:
        """Image (h, w, 4): base colours, or grey lit from the camera; transparent where nothing is hit."""
        found = np.zeros((*self.depth.shape, 4), np.uint8)
        if self.colors is not None:
            found[..., :3] = self.colors
        else:
            facing = np.abs(self.normals @ self.camera_to_world[:3, 2].astype(np.float32))
            found[..., :3] = (GREY + (235 - GREY) * facing[..., None]).astype(np.uint8)
        found[..., 3] = 255
        found[~self.mask] = 0
        return found

    def to_open3d(self) -> Any:
        """Return an ``open3d.geometry.RGBDImage`` and its ``PinholeCameraIntrinsic``; depth 0 where there is none.

        Raises
        ------
        UnavailableError
            Open3D is not installed, or cannot be imported.
        """
        with importing("open3d", "Frame.to_open3d"):
            import open3d
        height, width = self.depth.shape
        pixels: list[Any] = [
            np.ascontiguousarray(self.rgba[..., :3]),
            np.where(np.isfinite(self.depth), self.depth, np.float32(0)),
        ]
        color, depth = (open3d.geometry.Image(each) for each in pixels)
        image = open3d.geometry.RGBDImage.create_from_color_and_depth(color, depth, 1.0, np.inf, False)
        (fx, _, cx), (_, fy, cy), _ = self.opencv_intrinsics.tolist()
        return image, open3d.camera.PinholeCameraIntrinsic(width, height, fx, fy, cx, cy)


def frames(
    mesh: Scene | MeshLike,
    views: Views,
    *,
    width: int | None = None,
    height: int | None = None,
    fov: float | None = None,
    method: str = "exact",
    occluder: VisibilityQuery | None = None,
    colors: bool = False,
    sensor: Sensor | str | Path | None = None,
    seed: int | np.random.SeedSequence | np.random.Generator = 0,
    **options: Any,
) -> Iterator[Frame]:
    """Yield a frame for each view: depth, normal, face and instance of the first hit of each pixel.

    With a sensor, the depth is what it measures: with noise, limits of range and lost pixels. All else stays exact.

    Parameters
    ----------
    mesh : Scene or Mesh
        Or anything else that is a mesh (`as_mesh`): a path, a mesh of trimesh or Open3D, (vertices, faces).
    views : Views
        World units. Cameras of a file (`Views.fov_bounds`) have their own fields of view; others have square pixels.
    width, height : int, optional
        Pixels. By default those of the cameras' file (`Views.sizes`), else 640 x 480.
    fov : float, optional
        Horizontal field of view, degrees. By default one for all views, which contains the whole mesh in each of them;
        at most 169 for the shorter side.
    method : str
        Ray caster, a name of the table `METHODS`. ``exact``: on the CPU, without error; ``depth_buffer``: on the GPU.
    occluder : VisibilityQuery, optional
        The prepared mesh.
    colors : bool
        Read the mesh's base colours too; of a scene, show those of its objects.
    sensor : Sensor or str, optional
        Depth camera, or what `zbuf_occlude.sensors.make` takes, such as ``realsense-d435``. Its numbers give size and
        field of view, unless the cameras are of a file. World units are then metres.
    seed : int, SeedSequence or Generator
        Of the sensor's noise. The same seed gives the same frames, byte for byte.
    **options
        Options of the method.

    Yields
    ------
    Frame
        In the order of the views.

    Raises
    ------
    ArgumentError
        A size or field of view out of range, or beside a sensor; no `Views`; an occluder of another mesh; `colors` that
        is no bool.
    OptionError, UnavailableError, GlError
        As `prepare`; a method that casts no rays; a sensor that is no pinhole.

    Warns
    -----
    UserWarning
        Without a field of view: a camera is inside the mesh, or so near that no image shows all of it.

    Examples
    --------
    >>> views = zo.views.for_mesh("chair.off", "ring:8@30")
    >>> found = list(zo.frames("chair.off", views, width=320, height=240, fov=40))
    >>> found[0].depth.dtype, len(found)
    (dtype('float32'), 8)
    """
    check_views("views", views)
    cameras = None if sensor is None else _cameras(make(sensor), views, width, height, fov)
    sizes = _sizes(views, width, height) if cameras is None else _sizes_of(cameras)
    scene = mesh if isinstance(mesh, Scene) else Scene.from_mesh(as_mesh(mesh, colors=as_flag(colors, "colors")))
    find_method(method).check_first_hits()
    if occluder is not None:
        occluder.check_is_of(scene.mesh)
    intrinsics = _intrinsics(scene, views, sizes, fov) if cameras is None else [each.intrinsics for each in cameras]
    rng = generator(seed)

    def prepared() -> Any:
        if occluder is not None:
            return nullcontext(occluder)
        if cameras is not None and not scene.is_opaque_and_static:  # rays pass windows, and meet what moves in time
            return prepare_scene(scene, method, **options)
        return prepare(scene.mesh, method, **options)

    def generate() -> Iterator[Frame]:  # apart, so that wrong arguments are reported before the first frame
        with prepared() as opened:
            for view, (pose, (across, along)) in enumerate(zip(views.poses, sizes.tolist(), strict=True)):
                frame = frame_at(scene, opened, intrinsics[view], pose, (along, across), colored=colors)
                yield frame if cameras is None else _measured(frame, scene, opened, cameras[view], rng)

    return generate()


def _cameras(sensor: Sensor, views: Views, *given: float | None) -> list[Sensor]:
    """Return the sensor of each view; `given` are the arguments that a sensor takes the place of."""
    check_pinhole(sensor)
    if any(each is not None for each in given):
        raise ArgumentError(
            f"width, height and fov must be those of the sensor {sensor.name}. Leave them out, or change its numbers: "
            f"sensors.make({sensor.name!r}, width=...)."
        )
    return [sensor.of_view(views, view) for view in range(len(views))]


def check_pinhole(sensor: Sensor) -> None:
    """Raise OptionError unless a sensor has the pixels of a pinhole camera."""
    if sensor.kind != "pinhole":
        raise OptionError(
            f"frames must be of a pinhole camera; got the sensor {sensor.name}, of the kind {sensor.kind}. "
            "`zbuf-occlude sensors` lists some."
        )


def _measured(frame: Frame, scene: Scene, occluder: VisibilityQuery, sensor: Sensor, rng: np.random.Generator) -> Frame:
    """Return a frame with the depths that a sensor measures there."""
    place = pose_of_camera(frame.pose)
    returns = noiseless_scan(scene, sensor, place[:3, :3], place[:3, 3], occluder=occluder)
    found = apply_noise(returns, sensor, rng)
    return frame.with_depths(found.rings, found.columns, found.points)


def frame_at(
    scene: Scene,
    occluder: VisibilityQuery,
    matrix: FloatArray,
    pose: FloatArray,
    size: tuple[int, int],
    *,
    colored: bool = False,
) -> Frame:
    """Return the frame of one camera, `size` (h, w) pixels; `matrix` is K, `pose` the view matrix.

    With `colored` the objects of a scene show their base colours.
    """
    mesh, colors, eye = scene.mesh, None, -pose[:3, :3].T @ pose[:3, 3]
    of_objects = colored and any(each.mesh.colors is not None for each in scene.placed)
    depth, normals = np.full(size, np.inf, np.float32), np.zeros((*size, 3), np.float32)
    face_ids, instances = np.full((2, *size), -1, np.int32)
    if mesh.colors is not None or of_objects:
        colors = np.zeros((*size, 3), np.uint8)
    part, y, x, directions = pixel_rays(mesh.bounds, matrix, pose, size)
    if directions.size:
        hits = occluder.first_hits(eye[None], directions.reshape(-1, 3))
        filled = depth[part], face_ids[part], instances[part], normals[part]
        _fill_frame(x, y, directions, *hits, mesh.face_normals, scene.instances, *filled)
        if colors is not None:
            hit = np.nonzero(face_ids[part] >= 0)
            faces, points = face_ids[part][hit], eye + directions[hit] * depth[part][hit][:, None]
            colors[part][hit] = _base_colors(scene, faces, barycentric(mesh.corners[faces], points))
    return Frame(depth, face_ids, instances, normals, colors, matrix, pose)


def _base_colors(scene: Scene, faces: IntArray, weights: FloatArray) -> Bytes:
    """Return the base colours (n, 3) at barycentric coordinates (n, 3) of faces; grey for objects without colours."""
    if scene.mesh.colors is not None:
        return scene.mesh.colors.at(faces, weights)
    found, owners = np.full((len(faces), 3), GREY, np.uint8), scene.instances[faces]
    for number, each in enumerate(scene.placed):
        if each.mesh.colors is not None:
            mine, first = np.flatnonzero(owners == number), int(np.searchsorted(scene.instances, number))
            found[mine] = each.mesh.colors.at(faces[mine] - first, weights[mine])
    return found


def pixel_rays(
    bounds: FloatArray, matrix: FloatArray, pose: FloatArray, size: tuple[int, int]
) -> tuple[tuple[slice, slice], FloatArray, FloatArray, FloatArray]:
    """Return the rays through the pixels of an image (h, w) that may show any part of a box (2, 3).

    `matrix` is K, `pose` the view matrix. The result is the rows and columns of these pixels, their coordinates y (h',)
    and x (w',) at depth 1, and the rays of depth 1 (h', w', 3), world space.
    """
    part = _pixels_of_box(bounds, matrix, pose, size)
    (fx, _, cx), (_, fy, cy), _ = matrix
    y, x = (
        (np.arange(each.start, each.stop) + 0.5 - c) / f for each, c, f in zip(part, (cy, cx), (fy, fx), strict=True)
    )
    directions = np.empty((len(y), len(x), 3))
    _fill_rays(x, y, TO_OPENCV @ pose[:3, :3], directions)
    return part, y, x, directions


@njit(cache=True, nogil=True)
def _fill_rays(x: Any, y: Any, axes: Any, directions: Any) -> None:
    """Write the rays (h, w, 3) of depth 1 through image coordinates x (w,) and y (h,); `axes` are the camera's."""
    for row in range(len(y)):
        for column in range(len(x)):
            for axis in range(3):
                directions[row, column, axis] = x[column] * axes[0, axis] + y[row] * axes[1, axis] + axes[2, axis]


@njit(cache=True, nogil=True)
def _fill_frame(
    x: Any,
    y: Any,
    directions: Any,
    hit_ids: Any,
    distances: Any,
    face_normals: Any,
    instance_of: Any,
    depth: Any,
    face_ids: Any,
    instances: Any,
    normals: Any,
) -> None:
    """Write a part of a frame from the hits of its rays."""
    for row in range(len(y)):
        for column in range(len(x)):
            face = hit_ids[row * len(x) + column]
            if face < 0:
                continue
            face_ids[row, column], instances[row, column] = face, instance_of[face]
            slope = 1.0 + x[column] * x[column] + y[row] * y[row]
            depth[row, column] = distances[row * len(x) + column] / np.sqrt(slope)
            towards = length = 0.0
            for axis in range(3):
                towards += face_normals[face, axis] * directions[row, column, axis]
                length += face_normals[face, axis] * face_normals[face, axis]
            scale = (-1.0 if towards > 0.0 else 1.0) / np.sqrt(length)  # a face without area is never hit
            for axis in range(3):
                normals[row, column, axis] = face_normals[face, axis] * scale


def _pixels_of_box(
    bounds: FloatArray, matrix: FloatArray, pose: FloatArray, size: tuple[int, int]
) -> tuple[slice, slice]:
    """Return the rows and columns of the pixels that may show a box; all where a corner is not in front of the eye."""
    corners = box_corners(bounds) @ pose[:3, :3].T + pose[:3, 3]
    if not (corners[:, 2] < -1e-6 * np.abs(corners).max()).all():
        return slice(0, size[0]), slice(0, size[1])
    pixels = corners @ TO_OPENCV @ matrix.T
    positions = np.nan_to_num(pixels[:, 1::-1] / pixels[:, 2:])
    first = np.clip(np.floor(positions.min(axis=0)) - 1, 0, size).astype(int).tolist()
    last = np.clip(np.ceil(positions.max(axis=0)) + 1, first, size).astype(int).tolist()
    return slice(first[0], last[0]), slice(first[1], last[1])


def box_corners(bounds: FloatArray) -> FloatArray:
    """Return the corners (8, 3) of a box (2, 3)."""
    return np.stack(np.meshgrid(*bounds.T), axis=-1).reshape(-1, 3)


def _sizes(views: Views, width: int | None, height: int | None) -> IntArray:
    """Return width and height of each view's image, (k, 2): those given, else the file's, else the default."""
    for name, value in (("width", width), ("height", height)):
        if value is not None:
            check_int(name, value, 1)
    if views.sizes is not None and (width is None) != (height is None):
        raise ArgumentError("width and height must be given together for cameras that have a size of their own.")
    if views.sizes is not None and width is None:
        return views.sizes
    width, height = width or WIDTH, height or HEIGHT
    if width * height > MAX_PIXELS:
        raise ArgumentError(f"an image must have at most {MAX_PIXELS:,} pixels; got {width} x {height}.")
    return np.tile(np.array([width, height], np.int32), (len(views), 1))


def _sizes_of(cameras: list[Sensor]) -> IntArray:
    """Return width and height of each sensor's image, (k, 2)."""
    found = [[each.pattern["width"], each.pattern["height"]] for each in cameras]
    return np.array(found, np.int32).reshape(-1, 2)


def _intrinsics(scene: Scene, views: Views, sizes: IntArray, fov: float | None) -> FloatArray:
    if views.fov_bounds is not None:
        if fov is not None:
            raise ArgumentError("fov must not be given for cameras that have a field of view. Leave it out.")
        return views.intrinsics(*sizes.T)
    if not len(views):
        return np.empty((0, 3, 3))
    width, height = sizes[0].tolist()
    if fov is None:
        tangent = _tangent_around(scene.mesh, views) * width / min(width, height)
    else:
        tangent = np.tan(field_of_view(fov) / 2.0)
    across, along = float(tangent), float(tangent) * height / width
    bounds = np.tile([-across, across, -along, along], (len(views), 1))
    return replace(views, fov_bounds=bounds).intrinsics(width, height)


def _tangent_around(mesh: Mesh, views: Views) -> float:
    """Return the tangent of half the field of view of square images that contain a mesh in all views.

    Warn where there is none.
    """
    away = np.linalg.norm(views.eyes - mesh.centre, axis=1).min()
    off = np.linalg.norm(np.asarray(views.target) - mesh.centre)
    if away > 0.0 and MARGIN * (mesh.diagonal / 2 + off) <= BALL_LIMIT * away:
        return float(np.tan(np.arcsin(MARGIN * (mesh.diagonal / 2 + off) / away)))  # of the bounding ball
    widest, vertices = 0.0, mesh.vertices[np.unique(mesh.faces)]
    for pose in views.poses:
        x, y, z = (vertices @ pose[:3, :3].T + pose[:3, 3]).T
        beside, ahead = np.maximum(np.abs(x), np.abs(y)), -z
        widest = max(widest, float((beside / ahead).max()) if (ahead > 0.0).all() else np.inf)
    if not widest <= WIDEST / MARGIN:
        warnings.warn(
            "no image shows the whole mesh: a camera is inside it, or very near. Move the cameras, or give fov.",
            stacklevel=4,
        )
        return WIDEST
    return MARGIN * widest


def farthest(frame: Frame) -> float:
    """Return the greatest depth that a frame has, world units; 0 where it has none."""
    return float(frame.depth[np.isfinite(frame.depth)].max(initial=0.0))


def depth_unit(largest: float) -> float:
    """Return the smallest power of ten of which 65,535 steps cover a depth, world units; 0.001 up to 65.5."""
    return float(10.0 ** np.ceil(np.log10(largest / DEPTH_LEVELS))) if largest > 0 else 1.0


def depth_steps(depth: NDArray[np.float32], unit: float) -> NDArray[np.uint16]:
    """Return depths (h, w) in steps of `unit`, rounded, at least 1; 0 where they are infinite.

    Raises
    ------
    ArgumentError
        A depth above 65,535 steps, or all depths below half a step.
    """
    hit, steps = np.isfinite(depth), np.zeros(depth.shape, np.uint16)
    if 0.0 < (largest := depth[hit].max(initial=0.0)) < unit / 2.0:
        raise ArgumentError(
            f"a depth unit must be less than the depths, here at most {largest:g}; got {unit:g}. Give a smaller one."
        )
    levels = np.maximum(np.round(depth[hit].astype(np.float64) / unit), 1.0)
    if levels.max(initial=0.0) > DEPTH_LEVELS:
        raise ArgumentError(f"depths must be at most {DEPTH_LEVELS} steps of {unit:g}; one is {levels.max():.0f}.")
    steps[hit] = levels
    return steps


def write_frames(folder: str | os.PathLike[str], found: Iterable[Frame], *, unit: float | None = None) -> list[str]:
    """Write the frames of an object into a folder, in the layout of renderings for NeRF and of Objaverse.

    ===================  =====================================================================================
    000.png              red, green, blue, alpha
    000.npy              (3, 4) float64, world space to eye space (x right, y up, looking along -z)
    000_depth.png        16 bits: depth over `unit`, rounded; 0 where there is none
    000_mask.png         8 bits: 255 or 0
    000_normal.png       8 bits: 255 (n + 1) / 2, world space; 0 where nothing is hit
    000_instance.png     16 bits: instance + 1; 0 where nothing is hit
    transforms.json      intrinsics, and for each frame its files and ``transform_matrix``: camera (x right, y up,
                         looking along -z) to world
    cameras.json         for each frame K, R, t, width, height as `Frame.camera`, and the unit of its depth
    ===================  =====================================================================================

    Parameters
    ----------
    folder : path-like
        Created where it is missing. It must not contain frames.
    found : iterable of Frame
    unit : float, optional
        Step of the depth images, world units. By default the smallest power of ten that covers the greatest depth.

    Returns
    -------
    list of str
        The names of the files.

    Raises
    ------
    ArgumentError
        A depth above 65,535 steps; a `unit` that is no length above 0, or more than twice all depths of a frame; a
        folder that contains frames.
    UnavailableError
        Pillow is not installed.

    Examples
    --------
    >>> views = zo.views.for_mesh("chair.off", "ring:2@30")
    >>> zo.write_frames("chair", zo.frames("chair.off", views, width=64, height=64))[:3]
    ['000.png', '000_depth.png', '000_mask.png']
    """
    folder = as_new_path(folder, "folder")
    if unit is not None:
        as_number(unit, "unit", "a length above 0", lambda length: length > 0.0)
    if folder.is_dir() and (older := sorted(path.name for path in folder.iterdir() if _WRITTEN.fullmatch(path.name))):
        raise ArgumentError(
            f"the folder of frames must be new; {folder} has {len(older)} files of older frames, such as {older[0]}. "
            "Remove them, or give another folder."
        )
    if unit is None:
        found = list(found)
        unit = depth_unit(max(map(farthest, found), default=0.0))
    return frame_files(folder, found, float(unit))


def frame_files(folder: Path, found: Iterable[Frame], unit: float) -> list[str]:
    """Write frames as `write_frames` does, with depths in steps of `unit`; older files are overwritten."""
    names = list[str]()
    lenses, placed, cameras = (list[dict[str, Any]]() for _ in range(3))
    folder.mkdir(parents=True, exist_ok=True)
    files = {"file_path": "", "depth_file_path": "_depth", "depth_path": "_depth", "mask_path": "_mask"}
    for number, frame in enumerate(found):
        stem = f"{number:03d}"
        for name, content in _files(frame, stem, unit).items():
            (folder / name).write_bytes(content)
            names.append(name)
        height, width = frame.depth.shape
        (fx, _, cx), (_, fy, cy), _ = frame.intrinsics.tolist()
        lenses.append({"fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, "w": width, "h": height})
        placed.append({key: f"{stem}{end}.png" for key, end in files.items()})
        placed[-1]["transform_matrix"] = frame.camera_to_world.tolist()
        cameras.append({**frame.camera, "depth_unit": unit})
    one = lenses[0] if lenses and all(lens == lenses[0] for lens in lenses) else {}
    if one:
        one = {"camera_angle_x": 2.0 * np.arctan(one["w"] / (2.0 * one["fl_x"])), **one}
    about = {"camera_model": "PINHOLE", **one, "integer_depth_scale": unit}
    frames = placed if one else [{**lens, **each} for lens, each in zip(lenses, placed, strict=True)]
    for name, document in ((TRANSFORMS, {**about, "frames": frames}), (CAMERAS, {"cameras": cameras})):
        (folder / name).write_text(json.dumps(document, indent=1))
    return [*names, TRANSFORMS, CAMERAS]


def _files(frame: Frame, stem: str, unit: float) -> dict[str, bytes]:
    """Return the files of one frame, by name."""
    mask, normals = frame.mask, np.zeros(frame.normals.shape, np.uint8)
    normals[mask] = np.round((frame.normals[mask] + 1.0) * 127.5)
    pictures: dict[str, NDArray[Any]] = {
        f"{stem}.png": frame.rgba,
        f"{stem}_depth.png": depth_steps(frame.depth, unit),
        f"{stem}_mask.png": mask.astype(np.uint8) * np.uint8(255),
        f"{stem}_normal.png": normals,
        f"{stem}_instance.png": (frame.instances + 1).astype(np.uint16),
    }
    matrix = io.BytesIO()
    np.save(matrix, frame.pose[:3])
    return {**{name: png(pixels) for name, pixels in pictures.items()}, f"{stem}.npy": matrix.getvalue()}


def png(pixels: NDArray[Any]) -> bytes:
    """Return an image as PNG."""
    with importing("PIL", "frames as files"):
        from PIL import Image
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG", compress_level=1)
    return file.getvalue()
