"""Table of boxes, CSV or JSON: clouds in any format of `cloud_files`, and a box per row.

file                      the cloud, from the table's folder on: PLY, PCD, .bin, .npy, .npz
label                     or class, or category
x, y, z                   centre of the box, metres, in the frame of the LiDAR, z up
length, width, height     sides, metres
yaw                       heading of the length's axis about z, degrees; 0 where it is left out
track                     name of the object, the same in all clouds; may be left out

A CSV file has these columns in any order. A JSON file is a list of objects with these names. Other names are errors.
objects.csv of crops is no such table: its boxes lie in the frame of the sweep, its clouds do not.
"""

from collections import defaultdict
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.base.arrays import LARGEST
from zbuf_occlude.base.documents import Number, parse_document, parse_line, read_limited
from zbuf_occlude.base.errors import DatasetError, OptionError, did_you_mean, escape_control
from zbuf_occlude.datasets.cloud_files import read_points
from zbuf_occlude.datasets.real.sweeps import LabelledBox, Loader, Sweep

LABELS = ("label", "class", "category")
SIDES = ("length", "width", "height")
COLUMNS = ("file", *LABELS, "x", "y", "z", *SIDES, "yaw", "track")
OTHER_NAMES = dict.fromkeys(("heading", "rotation", "rotation_y", "rotation_z"), "yaw")
"""Names that other tables have for these columns."""
_SIDE = Number(0.0, LARGEST, "metres")


def find(root: Path) -> list[Loader]:
    """Return a loader for each cloud that a table names."""
    if not root.is_file() or root.suffix.lower() not in (".csv", ".json"):
        return []
    try:
        return _clouds(root)
    except OptionError as error:
        raise DatasetError(f"{error} See zbuf-occlude crop --help.") from None


def _clouds(path: Path) -> list[Loader]:
    boxes: dict[str, list[LabelledBox]] = defaultdict(list)
    for number, row in enumerate(_rows(path), 1):
        name = f"row {number} of {path}"
        for column in filter(None, row):  # tables of spreadsheets may have a column without a name
            if column not in COLUMNS:
                said = f"{name} must have no other columns than {', '.join(COLUMNS)}; it has {escape_control(column)}"
                meant = did_you_mean(OTHER_NAMES.get(column, column), COLUMNS)
                raise OptionError(f"{said}.{meant} Lengths are metres, yaw is degrees.")
        cloud = _word(row, "file", name)
        boxes[cloud].append(_box(row, name))
    return [partial(_read, path.parent, cloud, of_cloud) for cloud, of_cloud in boxes.items()]


def _rows(path: Path) -> list[Mapping[str, Any]]:
    """Return the rows of a table by the names of its columns."""
    form = path.suffix[1:].upper()
    document = parse_document(form, read_limited(path), path)
    if form == "CSV":
        names = list(document)
        return [dict(zip(names, row, strict=True)) for row in zip(*document.values(), strict=True)]
    if not isinstance(document, list) or not document or not all(isinstance(row, dict) for row in document):
        raise OptionError(f"{path} must be a list of objects, a box each; it is {type(document).__name__}.")
    return document


def _box(row: Mapping[str, Any], name: str) -> LabelledBox:
    column = next((each for each in LABELS if each in row), LABELS[0])
    label = _word(row, column, name)
    centre = [Number().read(f"{axis} in {name}", row.get(axis)) for axis in "xyz"]
    size = [_SIDE.read(f"{side} in {name}", row.get(side)) for side in SIDES]
    yaw = np.radians(Number(unit="degrees").read(f"yaw in {name}", row.get("yaw") or 0.0))
    cos, sin = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    track = row.get("track")
    return LabelledBox(label, np.array(centre), rotation, np.array(size), "" if track is None else str(track))


def _word(row: Mapping[str, Any], column: str, name: str) -> str:
    """Return the text of a column, which must not be blank."""
    word = parse_line(f"{column} in {name}", row.get(column))
    if not word.strip():
        raise OptionError(f"{column} in {name} must not be blank.")
    return word


def _read(folder: Path, cloud: str, boxes: list[LabelledBox]) -> Sweep:
    return Sweep(cloud, read_points(folder / cloud), boxes)
