"""Frames of scenes in the format of BOP, the benchmark for 6D object poses: models, poses, exact masks."""

import json
import os
from collections.abc import Collection, Iterable, Sequence, Set
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import BoolArray, FloatArray, as_number
from zbuf_occlude.base.documents import as_new_path
from zbuf_occlude.base.errors import ArgumentError, escape_control, shown
from zbuf_occlude.base.extras import importing
from zbuf_occlude.base.provenance import generator
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.sensors.frames import Frame, depth_steps, depth_unit, farthest, frames, pixel_rays, png
from zbuf_occlude.sensors.scenes.scene import Scene
from zbuf_occlude.sensors.sensor import Sensor
from zbuf_occlude.views import Views
from zbuf_occlude.views.model import check_views
from zbuf_occlude.visibility import prepare
from zbuf_occlude.visibility.interface import VisibilityQuery

BACKGROUND = ("ground", "room", "wall")
"""Labels of the objects that have no model by default."""
MILLIMETRES = 1000.0
"""Millimetres per metre: BOP's models and translations are in millimetres."""
NO_BOX = [-1, -1, -1, -1]
"""Bounding box of an object without a visible pixel."""
PER_BLOCK = 512
"""Vertices whose distances from all others are computed at once."""
ROUNDING = 1e-9
"""Tolerance of the positions of equal models, over the model's diagonal."""
LONGEST_NAME = 60
"""Maximum characters of a split's name; a file system takes 255 bytes."""
RIGID = 1e-6
"""Tolerance of a rotation matrix, that of single precision."""


def write_bop(
    folder: str | os.PathLike[str],
    scenes: Scene | Sequence[Scene],
    views: Views | Sequence[Views],
    *,
    width: int | None = None,
    height: int | None = None,
    fov: float | None = None,
    background: str | Collection[str] = BACKGROUND,
    split: str = "train",
    method: str = "exact",
    sensor: Sensor | str | Path | None = None,
    seed: int | np.random.SeedSequence | np.random.Generator = 0,
    unit: float | None = None,
    **options: Any,
) -> list[str]:
    """Write images, depths, masks and poses of scenes in the format of BOP (BOP-scenewise).

    ==============================  ===================================================================================
    models/obj_000001.ply           the first object: millimetres, the centre of its box at the origin
    models/models_info.json         diameter, corner and sides of each model's box
    camera.json                     the camera of the first image
    SPLIT/000000/rgb/000000.png     first scene, first view: base colours, or grey lit from the camera
    .../depth/000000.png            16 bits: depth along the axis over ``depth_scale``, millimetres; 0: none
    .../mask/000000_000001.png      255 where the scene's second object would be hit if it were alone
    .../mask_visib/...              255 where it is hit
    .../scene_camera.json           K, R, t (world to camera) and ``depth_scale`` of each view
    .../scene_gt.json               ``obj_id`` and the pose, model to camera, of each object
    .../scene_gt_info.json          pixels and boxes of the masks, ``visib_fract``
    ==============================  ===================================================================================

    Parameters
    ----------
    folder : path-like
        Created where it is missing. It must not contain models, camera.json or the split.
    scenes : Scene or sequence of Scene
        Metres. ``obj_id`` numbers the models from 1 through all scenes. Objects that are the same mesh in other poses
        (`Scene.joined`) share one model.
    views : Views or sequence of Views
        World units. One for all scenes, or one for each.
    width, height, fov
        As in `frames`.
    background : str or collection of str
        Labels of objects that hide others but have no model, pose or mask. Objects with `Placed.is_background` have
        none either.
    split : str
        Name of the folder of scenes.
    method : str
        Ray caster. The masks of ``exact`` have no error.
    sensor, seed
        As in `frames`: a depth camera whose noise is in the depth alone.
    unit : float, optional
        Step of all depth images, metres. By default the smallest power of ten that covers the depths of an image.
    **options
        Options of the method.

    Returns
    -------
    list of str
        The names of the files.

    Raises
    ------
    ArgumentError
        A scene with nothing but background; a value out of range; a folder with older output.
    OptionError, UnavailableError, GlError
        As `frames`; SciPy, trimesh or Pillow is not installed.

    Notes
    -----
    A pixel belongs to the object that the ray through its centre hits first. The ``mask_visib`` of different objects
    therefore share no pixel; with the background they cover all pixels with a hit. bop_toolkit compares depths with a
    tolerance of 15 mm. BOP's origin is the centre of the first pixel: its cx and cy are smaller than those of
    `Frame.intrinsics` by 0.5. ``px_count_all`` and ``bbox_obj`` include pixels outside the image, up to its width and
    height away.

    Examples
    --------
    >>> scene = zo.Scene.joined([zo.scenes.Placed(zo.load_mesh("chair.off"), "chair")])
    >>> views = zo.views.for_mesh(scene.mesh, "ring:2@30")
    >>> zo.write_bop("bop", scene, views, width=64, height=48)[:3]
    ['models/obj_000001.ply', 'camera.json', 'train/000000/rgb/000000.png']
    """
    scenes = list(scenes) if isinstance(scenes, Sequence) else [scenes]
    placed = list(views) if isinstance(views, Sequence) and not isinstance(views, str) else [views] * len(scenes)
    background = [background] if isinstance(background, str) else background
    if not isinstance(background, Sequence | Set) or not all(isinstance(each, str) for each in background):
        raise ArgumentError(f"background must be labels of objects; got {shown(background)}.")
    if strange := [each for each in scenes if not isinstance(each, Scene)]:
        raise ArgumentError(f"scenes must be Scene; got {type(strange[0]).__name__}. Make one: Scene.from_mesh(mesh).")
    for each in placed:
        check_views("views", each)
    if not (
        isinstance(split, str)
        and split
        and Path(split).name == escape_control(split) == split
        and split not in ("..", "models")
        and len(split) <= LONGEST_NAME
    ):
        raise ArgumentError(f"split must be the name of a folder other than models; got {shown(split)}.")
    if not scenes or len(placed) != len(scenes):
        raise ArgumentError(f"views must be one for all scenes or one for each; got {len(placed)} for {len(scenes)}.")
    if not all(map(len, placed)):
        raise ArgumentError("each scene must have at least one view; one has none. Give some.")
    for number, scene in enumerate(scenes):
        if not _foreground(scene, background):
            words = ", ".join(scene.labels)
            raise ArgumentError(f"scene {number} must have an object beside the background; it has {words}.")
    folder = as_new_path(folder, "folder")
    if older := [name for name in ("models", "camera.json", split) if (folder / name).exists()]:
        raise ArgumentError(f"a BOP folder must be new; {folder} has {', '.join(older)}. Remove them, or give another.")
    rng = generator(seed)
    size: dict[str, Any] = {"width": width, "height": height, "fov": fov}
    writer = BopWriter(folder, background=background, unit=unit, method=method, **options)
    for number, (scene, eyes) in enumerate(zip(scenes, placed, strict=True)):
        found = frames(scene, eyes, **size, method=method, sensor=sensor, seed=rng, **options)
        writer.write_scene(f"{split}/{number:06d}", ((scene, frame) for frame in found))
    return writer.finish()


class _Object(NamedTuple):
    """An object of a scene."""

    instance: int  # its number in the scene
    obj_id: int  # its model
    pose: FloatArray  # (4, 4), model to world, metres
    bounds: FloatArray  # (2, 3), world space
    alone: VisibilityQuery  # the object without the others


class BopWriter:
    """Writer of one BOP folder: the scenes one by one, then ``models_info.json``. Parameters as of `write_bop`."""

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        background: Collection[str],
        unit: float | None,
        method: str,
        **options: Any,
    ) -> None:
        if unit is not None:
            unit = as_number(unit, "unit", "a length above 0", lambda length: length > 0.0)
        self._unit = unit
        self._folder, self._background = as_new_path(folder, "folder"), background
        self._method, self._options = method, options
        self._models, self._info, self._names = list[Mesh](), dict[str, Any](), list[str]()

    def write_scene(self, subfolder: str, images: Iterable[tuple[Scene, Frame]]) -> None:
        """Write the images of one scene into a subfolder; the scenes of the images may differ."""
        cameras, poses, counts = dict[str, Any](), dict[str, Any](), dict[str, Any]()
        with ExitStack() as opened:
            last, objects = None, list[_Object]()
            for view, (scene, frame) in enumerate(images):
                if scene is not last:
                    opened.close()
                    last = scene
                    objects = [self._object(scene, i, opened) for i in _foreground(scene, self._background)]
                unit = self._unit or depth_unit(farthest(frame))
                if "camera.json" not in self._names:
                    self._write("camera.json", _json(_lens(frame, unit)))
                self._write(f"{subfolder}/rgb/{view:06d}.png", png(np.ascontiguousarray(frame.rgba[..., :3])))
                self._write(f"{subfolder}/depth/{view:06d}.png", png(depth_steps(frame.depth, unit)))
                lens = {"cam_K": frame.opencv_intrinsics.ravel().tolist(), "depth_scale": unit * MILLIMETRES}
                cameras[str(view)] = {**lens, **_pose(frame, np.eye(4), "w2c")}
                poses[str(view)] = [{**_pose(frame, each.pose, "m2c"), "obj_id": each.obj_id} for each in objects]
                counts[str(view)] = [
                    self._write_masks(subfolder, view, row, each, frame) for row, each in enumerate(objects)
                ]
        for name, document in (("camera", cameras), ("gt", poses), ("gt_info", counts)):
            self._write(f"{subfolder}/scene_{name}.json", _json(document))

    def finish(self) -> list[str]:
        """Write ``models_info.json``; return the names of all files."""
        self._write("models/models_info.json", _json(self._info))
        return self._names

    def _write(self, name: str, content: bytes) -> None:
        (self._folder / name).parent.mkdir(parents=True, exist_ok=True)
        (self._folder / name).write_bytes(content)
        self._names.append(name)

    def _write_masks(self, subfolder: str, view: int, row: int, each: _Object, frame: Frame) -> dict[str, Any]:
        """Write both masks of an object; return its entry of scene_gt_info.json."""
        whole, visible = silhouette(each.alone, each.bounds, frame), frame.instances == each.instance
        height, width = visible.shape
        inside = whole[height : 2 * height, width : 2 * width]
        inside |= visible  # the rays of `whole` differ in the last bit
        for name, mask in (("mask", inside), ("mask_visib", visible)):
            self._write(f"{subfolder}/{name}/{view:06d}_{row:06d}.png", png(mask.astype(np.uint8) * np.uint8(255)))
        return _gt_info(whole, inside & np.isfinite(frame.depth), visible)

    def _object(self, scene: Scene, i: int, opened: ExitStack) -> _Object:
        own, pose = _used(scene.mesh, scene.instances == i), np.eye(4)
        mesh = own
        if scene.placed and _is_rigid(scene.placed[i].pose):
            mesh, pose = _used(scene.placed[i].mesh, slice(None)), scene.placed[i].pose
        middle = mesh.bounds.mean(axis=0)
        moved = np.eye(4)
        moved[:3, 3] = middle
        alone = opened.enter_context(prepare(own, self._method, warn=False, **self._options))
        obj_id = self._model_of(Mesh((mesh.vertices - middle) * MILLIMETRES, mesh.faces, mesh.name))
        return _Object(i, obj_id, pose @ moved, own.bounds, alone)

    def _model_of(self, model: Mesh) -> int:
        """Return the number of a model, millimetres; write it unless an equal one, but for rounding, was written."""
        for number, other in enumerate(self._models, 1):
            if (
                other.vertices.shape == model.vertices.shape
                and np.array_equal(other.faces, model.faces)
                and np.abs(other.vertices - model.vertices).max() <= ROUNDING * model.diagonal
            ):
                return number
        self._models.append(model)
        number, sides = len(self._models), np.ptp(model.bounds, axis=0)
        text = model.to_trimesh().export(file_type="ply", encoding="ascii", vertex_normal=True)
        self._write(f"models/obj_{number:06d}.ply", text if isinstance(text, bytes) else text.encode())
        info = {"diameter": _diameter(model.vertices)}
        info |= {f"min_{axis}": -float(side) / 2 for axis, side in zip("xyz", sides, strict=True)}
        info |= {f"size_{axis}": float(side) for axis, side in zip("xyz", sides, strict=True)}
        self._info[str(number)] = info
        return number


def _foreground(scene: Scene, background: Collection[str]) -> list[int]:
    """Return the numbers of the objects of a scene that have a face and are not background."""
    present = set(np.unique(scene.instances).tolist())
    present -= {i for i, each in enumerate(scene.placed) if each.is_background}
    return [i for i, label in enumerate(scene.labels) if label not in background and i in present]


def _is_rigid(pose: FloatArray) -> bool:
    turn = pose[:3, :3]
    return bool(np.abs(turn @ turn.T - np.eye(3)).max() <= RIGID and np.linalg.det(turn) > 0)


def _pose(frame: Frame, to_world: FloatArray, name: str) -> dict[str, list[float]]:
    """Return rotation and translation (millimetres) to the camera from a space with the rigid pose `to_world`."""
    rotation, translation = frame.extrinsics[:, :3], frame.extrinsics[:, 3]
    moved = (rotation @ to_world[:3, 3] + translation) * MILLIMETRES
    return {f"cam_R_{name}": (rotation @ to_world[:3, :3]).ravel().tolist(), f"cam_t_{name}": moved.tolist()}


def silhouette(occluder: VisibilityQuery, bounds: FloatArray, frame: Frame) -> BoolArray:
    """Return the mask (3 h, 3 w) of a mesh alone in an image enlarged threefold, with the frame's in the middle."""
    height, width = frame.depth.shape
    found = np.zeros((3 * height, 3 * width), dtype=bool)
    matrix = frame.intrinsics + np.array([[0, 0, width], [0, 0, height], [0, 0, 0]])
    part, _, _, directions = pixel_rays(bounds, matrix, frame.pose, found.shape)
    if directions.size:
        face_ids = occluder.first_hits(frame.camera_to_world[None, :3, 3], directions.reshape(-1, 3)).face_ids
        found[part] = (face_ids >= 0).reshape(directions.shape[:2])
    return found


def _gt_info(whole: BoolArray, valid: BoolArray, visible: BoolArray) -> dict[str, Any]:
    """Return the entry of an object in scene_gt_info.json, for one image."""
    n_all, n_visible = int(whole.sum()), int(visible.sum())
    return {
        "px_count_all": n_all,
        "px_count_valid": int(valid.sum()),
        "px_count_visib": n_visible,
        "visib_fract": n_visible / n_all if n_all else 0.0,
        "bbox_obj": _box(whole, visible.shape) if n_visible else NO_BOX,
        "bbox_visib": _box(visible) if n_visible else NO_BOX,
    }


def _box(mask: BoolArray, offset: tuple[int, ...] = (0, 0)) -> list[int]:
    """Return x, y, and the distances from the first to the last pixel along both axes, as bop_toolkit does."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    x, y = int(columns[0]), int(rows[0])
    return [x - offset[1], y - offset[0], int(columns[-1]) - x, int(rows[-1]) - y]


def _used(mesh: Mesh, which: Any) -> Mesh:
    """Return a mesh of some faces and the vertices that they use."""
    used, faces = np.unique(mesh.faces[which], return_inverse=True)
    return Mesh(mesh.vertices[used], faces.reshape(-1, 3).astype(np.int32), mesh.name)


def _diameter(vertices: FloatArray) -> float:
    """Return the largest distance between two vertices."""
    with importing("scipy", "write_bop"):
        from scipy.spatial import ConvexHull, QhullError
    try:
        ends = vertices[ConvexHull(vertices).vertices]
    except QhullError:  # coplanar, or fewer than four
        ends = vertices
    blocks = (ends[i : i + PER_BLOCK, None] - ends for i in range(0, len(ends), PER_BLOCK))
    return float(max(np.linalg.norm(block, axis=2).max() for block in blocks))


def _lens(frame: Frame, unit: float) -> dict[str, Any]:
    (fx, _, cx), (_, fy, cy), _ = frame.opencv_intrinsics.tolist()
    height, width = frame.depth.shape
    return {
        "cx": cx, "cy": cy, "fx": fx, "fy": fy, "width": width, "height": height, "depth_scale": unit * MILLIMETRES
    }  # fmt: skip


def _json(document: Any) -> bytes:
    return json.dumps(document, indent=1).encode()
