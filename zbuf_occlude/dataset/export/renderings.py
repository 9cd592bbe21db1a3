"""Frames: the pictures of a pinhole camera, a folder for each object, as readers of renderings for NeRF have them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.export import Exported
from zbuf_occlude.dataset.export.shared import names_of, whole_objects
from zbuf_occlude.dataset.plan import Numbers, Plan
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.errors import OptionError
from zbuf_occlude.sensors.frames import Frame, depth_unit, write_frames

PATHS = "valid_paths.json"
"""The folders of all objects, a list, as Zero-1-to-3's loader wants it."""


def export(source: Source, out: Path) -> Exported:
    """Write SPLIT/CLASS/OBJECT[-VARIATION]/ with the files of `write_frames`, 000 the first view; and valid_paths.json.

    World space is the scans': metres, the middle of the object's box at the origin, z up. Instance 0 is the object.
    The depth pictures of a dataset have one unit for each object. Objects of which a view meets nothing are left out.
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
            unit = depth_unit(max(_depths(record).max() for record in records_of(source, of_views)))
            frames = (frame_of(plan, record) for record in records_of(source, of_views))
            written = write_frames(out / paths[-1], frames, unit=unit)
            files[split] += [f"{paths[-1]}/{each}" for each in written]
    atomic.write_json(out / PATHS, paths)
    return Exported(files, n_clouds)


def records_of(source: Source, numbers: Numbers) -> Iterator[Any]:
    """Yield the records of some clouds, one at a time: each has a row per pixel."""
    for number in numbers:
        yield source.take(np.array([number]))[0]


def _depths(record: Any) -> FloatArray:
    return np.asarray(-(record["data"].astype(np.float64) @ record["pose"][2, :3] + record["pose"][2, 3]))


def frame_of(plan: Plan, record: Any) -> Frame:
    """Return all that a pinhole camera's rays met as a frame."""
    assert plan.recipe.setup is not None
    views, view = plan.views_of(plan.meshes[int(record["mesh_id"])].key), int(record["view_id"])
    sensor = plan.recipe.setup.sensor_of(views, view)
    size, pixels = (sensor.pattern["height"], sensor.pattern["width"]), (record["ring"], record["column"])
    depth, normals, colors = np.full(size, np.inf, np.float32), np.zeros((*size, 3), np.float32), None
    face_ids, instances = np.full((2, *size), -1, np.int32)
    depth[pixels], normals[pixels] = _depths(record), record["normal"]
    face_ids[pixels], instances[pixels] = record["face_ids"], record["instance"]
    if "color" in record.dtype.names:
        colors = np.zeros((*size, 3), np.uint8)
        colors[pixels] = record["color"]
    return Frame(depth, face_ids, instances, normals, colors, sensor.intrinsics, record["pose"])


def check(plan: Plan) -> None:
    """Raise OptionError unless the clouds are all that a pinhole camera's rays meet, with normals, as they are."""
    recipe = plan.recipe
    if recipe.setup is None or recipe.setup.made_sensor.kind != "pinhole":
        named = "surface" if recipe.setup is None else recipe.setup.made_sensor.name
        raise OptionError(
            f"{plan.format} must be of a pinhole camera; got --sensor {named}. `zbuf-occlude sensors` lists some."
        )
    for option, found, wanted in (
        ("--sample-size", recipe.sample_size, None),
        ("--scale", recipe.scale, "mesh"),
        ("--frame", recipe.frame, "object"),
    ):
        if found != wanted:
            raise OptionError(
                f"{plan.format} must have all points as they are, {option} {wanted or 'all'}; got {found}."
            )
    if "normals" not in recipe.attributes:
        raise OptionError(f"{plan.format} must have normals; got none. Give --with normals.")
