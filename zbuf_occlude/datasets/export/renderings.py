"""Pictures of a pinhole camera: frames, as readers of renderings for NeRF have them, and scenes of BOP's benchmark."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import OptionError, UnavailableError
from zbuf_occlude.base.extras import missing
from zbuf_occlude.datasets.export import Exported, Layout, check_as_they_are, incomplete, names_of, whole_objects
from zbuf_occlude.datasets.pipeline import scanned_scenes
from zbuf_occlude.datasets.plan import Numbers, Plan
from zbuf_occlude.datasets.source import CloudReader
from zbuf_occlude.sensors.bop import BopWriter
from zbuf_occlude.sensors.frames import Frame, depth_unit, frame_at, frame_files
from zbuf_occlude.sensors.scan_config import ScanConfig
from zbuf_occlude.sensors.scenes.scene import Scene
from zbuf_occlude.visibility import prepare

PATHS = "valid_paths.json"
"""The folders of all objects, a list, as Zero-1-to-3's loader wants it."""


def export_frames(source: CloudReader, out: Path) -> Exported:
    """Write SPLIT/CLASS/OBJECT[-VARIATION]/ with the files of `write_frames`, 000 the first view; and valid_paths.json.

    World space is that of the scans: metres, the middle of the object's box at the origin, z up. Instance 0 is the
    object. The depth pictures of a dataset have one unit for each object. Objects that some view does not meet are left
    out."""
    plan, names, files, paths = source.plan, names_of(source.plan), dict[str, list[str]](), list[str]()
    n_clouds, n_views = dict[str, int](), len(source.plan.views)
    for split, numbers in whole_objects(source).items():
        files[split], n_clouds[split] = [], numbers.size
        for of_views in numbers.reshape(-1, n_views):
            first = source.take(of_views[:1])[0]
            mesh_id, variation = int(first["mesh_id"]), int(first["variation"])
            name = names.objects[mesh_id] + (f"-{variation}" if plan.config.variations > 1 else "")
            paths.append(f"{split}/{names.classes[mesh_id]}/{name}")
            unit = depth_unit(max(_depths(record).max() for record in records_of(source, of_views)))
            frames = (frame_of(plan, record) for record in records_of(source, of_views))
            written = frame_files(out / paths[-1], frames, unit)
            files[split] += [f"{paths[-1]}/{each}" for each in written]
    atomic.write_json(out / PATHS, paths)
    return Exported(files, n_clouds, left_out=incomplete(source))


def records_of(source: CloudReader, numbers: Numbers) -> Iterator[Any]:
    """Yield the records of some clouds, one at a time: each has a row per pixel."""
    for number in numbers:
        yield source.take(np.array([number]))[0]


def _depths(record: Any) -> FloatArray:
    return np.asarray(-(record["data"].astype(np.float64) @ record["pose"][2, :3] + record["pose"][2, 3]))


def frame_of(plan: Plan, record: Any) -> Frame:
    """Return all that a pinhole camera's rays met as a frame; of a pixel with several echoes the first."""
    views, view = plan.views_of(plan.meshes[int(record["mesh_id"])].key), int(record["view_id"])
    sensor = _pinhole_scans(plan).sensor_of(views, view)
    size, depths = (sensor.pattern["height"], sensor.pattern["width"]), _depths(record)
    nearest = np.argsort(depths, kind="stable")
    _, first = np.unique((record["ring"] * size[1] + record["column"])[nearest], return_index=True)
    kept = nearest[first]
    pixels = record["ring"][kept], record["column"][kept]
    depth, normals, colors = np.full(size, np.inf, np.float32), np.zeros((*size, 3), np.float32), None
    face_ids, instances = np.full((2, *size), -1, np.int32)
    depth[pixels], normals[pixels] = depths[kept], record["normal"][kept]
    face_ids[pixels], instances[pixels] = record["face_ids"][kept], record["instance"][kept]
    if "color" in record.dtype.names:
        colors = np.zeros((*size, 3), np.uint8)
        colors[pixels] = record["color"][kept]
    return Frame(depth, face_ids, instances, normals, colors, sensor.intrinsics, record["pose"])


def _pinhole_scans(plan: Plan) -> ScanConfig:
    """Return the scans of a plan; OptionError unless a pinhole camera makes them."""
    scan = plan.config.scan
    if scan is None or scan.sensor.kind != "pinhole":
        named = "surface" if scan is None else scan.sensor.name
        raise OptionError(
            f"{plan.format} must be of a pinhole camera; got --sensor {named}. `zbuf-occlude sensors` lists some."
        )
    return scan


def check_frames(plan: Plan) -> None:
    """Raise OptionError unless the clouds are all that a pinhole camera's rays meet, with normals, as they are.

    UnavailableError where pictures cannot be written.
    """
    if lacking := missing("PIL"):
        raise UnavailableError(f"--format {plan.format} {lacking}")
    _pinhole_scans(plan)
    check_as_they_are(plan)
    if "normals" not in plan.config.attributes:
        raise OptionError(f"{plan.format} must have normals; got none. Give --with normals.")


def export_bop(source: CloudReader, out: Path) -> Exported:
    """Write SPLIT/SCENE/ with the files of `write_bop`; a scene is a variation of an object, its images are the views.

    Scenes that hide a drawn share of the object differ by view: each image lists its objects. Models are the meshes of
    the collection, and the objects that fill scenes without one. `depth` has the sensor's noise, masks and `rgb` have
    none."""
    scan, n_views = _pinhole_scans(source.plan), len(source.plan.views)
    writer = BopWriter(out, background=(), method=scan.method)
    names, n_clouds = dict[str, list[str]](), dict[str, int]()
    for split, numbers in whole_objects(source).items():
        names[split], n_clouds[split] = [], numbers.size
        for number, of_views in enumerate(numbers.reshape(-1, n_views)):
            writer.write_scene(f"{split}/{number:06d}", _images(source, of_views, scan))
    of_all = writer.finish()
    for split in names:
        names[split] = [name for name in of_all if name.startswith(f"{split}/")]
    return Exported(names, n_clouds, left_out=incomplete(source))


def _images(
    source: CloudReader, of_views: Numbers, scan: ScanConfig
) -> Iterator[tuple[Scene, Frame, NDArray[np.float32]]]:
    """Yield the scene of each view, what a camera without noise sees of it, and the sensor's depth."""
    first = source.take(of_views[:1])[0]
    scenes = scanned_scenes(source.plan, scan, int(first["mesh_id"]), int(first["variation"]))
    last, occluder = None, None
    with ExitStack() as opened:
        for scene, record in zip(scenes, records_of(source, of_views), strict=True):
            if scene is not last or occluder is None:
                opened.close()
                last, occluder = scene, opened.enter_context(prepare(scene.mesh, scan.method, warn=False))
            noisy = frame_of(source.plan, record)
            clean = frame_at(scene, occluder, noisy.intrinsics, noisy.pose, noisy.depth.shape)
            yield scene, replace(clean, colors=noisy.colors), noisy.depth


def check_bop(plan: Plan) -> None:
    """Raise OptionError unless the clouds are all that a pinhole camera's rays meet, in metres, of all objects.

    UnavailableError where pictures cannot be written, or models measured.
    """
    check_frames(plan)
    if lacking := missing("scipy"):
        raise UnavailableError(f"--format bop {lacking}")
    scan = _pinhole_scans(plan)
    if scan.keep != "all":
        raise OptionError(f"bop must have the pixels of all objects, --keep all; got {scan.keep}.")


FRAMES = Layout(export_frames, check_frames)
BOP = Layout(export_bop, check_bop)
