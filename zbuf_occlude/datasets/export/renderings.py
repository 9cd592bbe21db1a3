"""Pictures of a pinhole camera: frames, as readers of renderings for NeRF have them, and scenes of BOP's benchmark."""

from collections.abc import Iterator
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
from zbuf_occlude.sensors.scenes.scene import Scene

PATHS = "valid_paths.json"
"""The folders of all objects, a list, as Zero-1-to-3's loader wants it."""


def export_frames(source: CloudReader, out: Path) -> Exported:
    """Write SPLIT/CLASS/OBJECT[-VARIATION]/ with the files of `write_frames`, 000 the first view; and valid_paths.json.

    World space is the scans': metres, the middle of the object's box at the origin, z up. Instance 0 is the object.
    Without `depth_unit` the depth images have one unit for each object. Objects of which a view meets nothing are left
    out.
    """
    plan, names, files, paths = source.plan, names_of(source.plan), dict[str, list[str]](), list[str]()
    n_clouds, n_views = dict[str, int](), len(source.plan.views)
    for split, numbers in whole_objects(source).items():
        files[split], n_clouds[split] = [], numbers.size
        for of_views in numbers.reshape(-1, n_views):
            first = source.take(of_views[:1])[0]
            mesh_id, variation = int(first["mesh_id"]), int(first["variation"])
            name = names.objects[mesh_id] + (f"-{variation}" if plan.recipe.variations > 1 else "")
            paths.append(f"{split}/{names.classes[mesh_id]}/{name}")
            unit = plan.recipe.depth_unit
            unit = unit or depth_unit(max(_depths(record).max() for record in records_of(source, of_views)))
            frames = (frame for _, frame in measured_frames(source, of_views))
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


def measured_frames(source: CloudReader, of_views: Numbers) -> Iterator[tuple[Scene, Frame]]:
    """Yield the scene of each view of an object, and what a camera sees there; the depth is the sensor's."""
    plan, first = source.plan, source.take(of_views[:1])[0]
    setup, mesh_id = plan.recipe.setup, int(first["mesh_id"])
    assert setup is not None
    views, colored = plan.views_of(plan.meshes[mesh_id].key), "colors" in plan.recipe.attributes
    scenes = scanned_scenes(plan, mesh_id, int(first["variation"]))
    last, occluder = None, None
    with ExitStack() as opened:
        for scene, record in zip(scenes, records_of(source, of_views), strict=True):
            if scene is not last or occluder is None:
                opened.close()
                last, occluder = scene, opened.enter_context(prepare_scene(scene, setup.method))
            sensor = setup.sensor_model.of_view(views, int(record["view_id"]))
            size = sensor.pattern["height"], sensor.pattern["width"]
            frame = frame_at(scene, occluder, sensor.intrinsics, record["pose"], size, colored=colored)
            yield scene, frame.with_depths(record["ring"], record["column"], record["data"])


def check_frames(plan: Plan) -> None:
    """Raise OptionError unless the clouds are all that a pinhole camera's rays meet, at rest, as they are.

    UnavailableError where pictures cannot be written.
    """
    recipe = plan.recipe
    if lacking := missing("PIL"):
        raise UnavailableError(f"--format {plan.format} {lacking}")
    if recipe.setup is None:
        raise OptionError(f"{plan.format} must be of a pinhole camera; got --sensor surface. Leave it out.")
    check_pinhole(recipe.setup.sensor_model)
    check_as_they_are(plan)
    if recipe.setup.takes_time and recipe.setup.sensor_model.rays().times is not None:
        raise OptionError(f"{plan.format} must be of a camera and objects at rest; they move. Give readout=0.")
    reach, unit = recipe.setup.sensor_model.noise_model.range_max, recipe.depth_unit
    if unit is not None and reach > unit * DEPTH_LEVELS:
        raise OptionError(
            f"--depth-unit must reach as far as the sensor measures; {DEPTH_LEVELS:,} steps of {unit:g} end at "
            f"{unit * DEPTH_LEVELS:.4g} m, {recipe.setup.sensor_model.name} measures up to {reach:g} m. Give a larger "
            f"unit, or --set-sensor range_max={0.99 * unit * DEPTH_LEVELS:.3g}."
        )
    if recipe.setup.keep != "all":
        raise OptionError(f"{plan.format} must have the pixels of all objects, --keep all; got {recipe.setup.keep}.")


def export_bop(source: CloudReader, out: Path) -> Exported:
    """Write SPLIT/SCENE/ with the files of `write_bop`; a scene is a variation of an object, its images are the views.

    Scenes that hide a drawn share of the object differ by view: each image lists what stands there. Models are the
    meshes of the collection, and what fills scenes without one.
    """
    plan, n_views = source.plan, len(source.plan.views)
    assert plan.recipe.setup is not None
    writer = BopWriter(out, background=(), unit=plan.recipe.depth_unit, method=plan.recipe.setup.method)
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
