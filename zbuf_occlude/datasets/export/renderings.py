"""Views of a pinhole camera: frames as readers of NeRF's renderings have them, BOP's scenes, clouds for PCL and ROS."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import OptionError, UnavailableError
from zbuf_occlude.base.extras import missing
from zbuf_occlude.datasets.export import Exported, Layout, check_as_they_are, incomplete, names_of, whole_objects
from zbuf_occlude.datasets.pipeline import scanned_scenes
from zbuf_occlude.datasets.plan import Numbers, Plan
from zbuf_occlude.datasets.source import CloudReader
from zbuf_occlude.sensors.bop import BopWriter
from zbuf_occlude.sensors.casting import prepare_scene
from zbuf_occlude.sensors.frames import DEPTH_LEVELS, Frame, check_pinhole, depth_unit, frame_at, frame_files
from zbuf_occlude.sensors.ros import mcap_file, organized_files
from zbuf_occlude.sensors.scan_config import ScanConfig
from zbuf_occlude.sensors.scenes.scene import Scene

PATHS = "valid_paths.json"
"""The folders of all objects, a list, as Zero-1-to-3's loader wants it."""


def export_frames(source: CloudReader, out: Path) -> Exported:
    """Write the files of `write_frames` for each object. Without `depth_unit` each object has its own unit of depth."""

    def write(folder: Path, of_views: Numbers) -> list[str]:
        unit = source.plan.config.depth_unit
        unit = unit or depth_unit(max(_depths(record).max() for record in records_of(source, of_views)))
        return frame_files(folder, _frames(source, of_views), unit)

    return _export_objects(source, out, write)


def export_organized(source: CloudReader, out: Path) -> Exported:
    """Write the files of `organized_files` for each object."""
    return _export_objects(source, out, lambda folder, of_views: organized_files(folder, _frames(source, of_views)))


def export_mcap(source: CloudReader, out: Path) -> Exported:
    """Write the file of `mcap_file` for each object."""
    return _export_objects(source, out, lambda folder, of_views: mcap_file(folder, _frames(source, of_views)))


def _frames(source: CloudReader, of_views: Numbers) -> Iterator[Frame]:
    return (frame for _, frame in measured_frames(source, of_views))


def _export_objects(source: CloudReader, out: Path, write: Callable[[Path, Numbers], list[str]]) -> Exported:
    """Write SPLIT/CLASS/OBJECT[-VARIATION]/ for each object, 000 the first view; and valid_paths.json.

    `write` writes the files of some clouds into a folder and returns their names. World space is that of the scans:
    metres, the middle of the object's box at the origin, z up. Instance 0 is the object. Objects that some view does
    not meet are left out.
    """
    plan, names, files, paths = source.plan, names_of(source.plan), dict[str, list[str]](), list[str]()
    n_clouds, n_views = dict[str, int](), len(source.plan.views)
    for split, numbers in whole_objects(source).items():
        files[split], n_clouds[split] = [], numbers.size
        for of_views in numbers.reshape(-1, n_views):
            first = source.take(of_views[:1])[0]
            mesh_id, variation = int(first["mesh_id"]), int(first["variation"])
            name = names.objects[mesh_id] + (f"-{variation}" if plan.config.variations > 1 else "")
            paths.append(f"{split}/{names.classes[mesh_id]}/{name}")
            files[split] += [f"{paths[-1]}/{each}" for each in write(out / paths[-1], of_views)]
    atomic.write_json(out / PATHS, paths)
    return Exported(files, n_clouds, left_out=incomplete(source))


def records_of(source: CloudReader, numbers: Numbers) -> Iterator[Any]:
    """Yield the records of some clouds, one at a time: each has a row per pixel."""
    for number in numbers:
        yield source.take(np.array([number]))[0]


def _depths(record: Any) -> FloatArray:
    return np.asarray(-(record["data"].astype(np.float64) @ record["pose"][2, :3] + record["pose"][2, 3]))


def measured_frames(source: CloudReader, of_views: Numbers) -> Iterator[tuple[Scene, Frame]]:
    """Yield the scene of each view of an object, and what a camera sees there; the depth is the sensor's."""
    plan, scan, first = source.plan, _pinhole_scans(source.plan), source.take(of_views[:1])[0]
    mesh_id = int(first["mesh_id"])
    views, colored = plan.views_of(plan.meshes[mesh_id].key), "colors" in plan.config.attributes
    scenes = scanned_scenes(plan, scan, mesh_id, int(first["variation"]))
    last, occluder = None, None
    with ExitStack() as opened:
        for scene, record in zip(scenes, records_of(source, of_views), strict=True):
            if scene is not last or occluder is None:
                opened.close()
                last, occluder = scene, opened.enter_context(prepare_scene(scene, scan.method))
            sensor = scan.sensor.of_view(views, int(record["view_id"]))
            size = sensor.pattern["height"], sensor.pattern["width"]
            frame = frame_at(scene, occluder, sensor.intrinsics, record["pose"], size, colored=colored)
            yield scene, frame.with_depths(record["ring"], record["column"], record["data"])


def _pinhole_scans(plan: Plan) -> ScanConfig:
    """Return the scans of a plan; OptionError unless a pinhole camera makes them."""
    scan = plan.config.scan
    if scan is None:
        raise OptionError(f"{plan.format} must be of a pinhole camera; got --sensor surface. Leave it out.")
    check_pinhole(scan.sensor)
    return scan


def check_camera(plan: Plan) -> None:
    """Raise OptionError unless the clouds are all that a pinhole camera's rays meet, at rest, as they are."""
    scan = _pinhole_scans(plan)
    check_as_they_are(plan)
    if scan.takes_time and scan.sensor.rays().times is not None:
        raise OptionError(f"{plan.format} must be of a camera and objects at rest; they move. Give readout=0.")
    if scan.keep != "all":
        raise OptionError(f"{plan.format} must have the pixels of all objects, --keep all; got {scan.keep}.")


def check_frames(plan: Plan) -> None:
    """Raise as `check_camera`, or OptionError where depths may exceed the steps of a depth image.

    UnavailableError where pictures cannot be written.
    """
    if lacking := missing("PIL"):
        raise UnavailableError(f"--format {plan.format} {lacking}")
    check_camera(plan)
    unit, sensor = plan.config.depth_unit, _pinhole_scans(plan).sensor
    if unit is not None and sensor.noise_model.range_max > unit * DEPTH_LEVELS:
        end = unit * DEPTH_LEVELS
        raise OptionError(
            f"--depth-unit must reach as far as the sensor measures; {DEPTH_LEVELS:,} steps of {unit:g} end at "
            f"{end:.4g} m, {sensor.name} measures up to {sensor.noise_model.range_max:g} m. Give a larger unit, or "
            f"--set-sensor range_max={0.99 * end:.3g}."
        )


def check_mcap(plan: Plan) -> None:
    """Raise as `check_camera`; UnavailableError where messages cannot be written."""
    if lacking := missing("mcap_ros2"):
        raise UnavailableError(f"--format {plan.format} {lacking}")
    check_camera(plan)


def export_bop(source: CloudReader, out: Path) -> Exported:
    """Write SPLIT/SCENE/ with the files of `write_bop`; a scene is a variation of an object, its images are the views.

    Scenes that hide a drawn share of the object differ by view: each image lists its objects. Models are the meshes of
    the collection, and the objects that fill scenes without one.
    """
    plan, n_views = source.plan, len(source.plan.views)
    writer = BopWriter(out, background=(), unit=plan.config.depth_unit, method=_pinhole_scans(plan).method)
    names, n_clouds = dict[str, list[str]](), dict[str, int]()
    for split, numbers in whole_objects(source).items():
        names[split], n_clouds[split] = [], numbers.size
        for number, of_views in enumerate(numbers.reshape(-1, n_views)):
            writer.write_scene(f"{split}/{number:06d}", measured_frames(source, of_views))
    of_all = writer.finish()
    for split in names:
        names[split] = [name for name in of_all if name.startswith(f"{split}/")]
    return Exported(names, n_clouds, left_out=incomplete(source))


def check_bop(plan: Plan) -> None:
    """Raise as `check_frames`; UnavailableError where models cannot be measured."""
    check_frames(plan)
    if lacking := missing("scipy"):
        raise UnavailableError(f"--format bop {lacking}")


FRAMES = Layout(export_frames, check_frames)
BOP = Layout(export_bop, check_bop)
ORGANIZED = Layout(export_organized, check_camera)
MCAP = Layout(export_mcap, check_mcap)
