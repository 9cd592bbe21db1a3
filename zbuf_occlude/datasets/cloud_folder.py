"""Folders of cloud files by class, as `crop` writes them and others have them, read like a dataset.

    CLASS/FILE, or SPLIT/CLASS/FILE     .ply, .pcd, .bin, .npy, .npz, in metres or any unit
    objects.csv                         optional: file, class, sweep, range and so on of each cloud

A cloud without a row has the class of its folder, and no known sensor. A row without its cloud is an error.
A folder without split folders is one set: train and test are both all of it.
"""

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.documents import Number, parse_document, read_limited
from zbuf_occlude.base.errors import DatasetError, MeshError, OptionError, escape_control
from zbuf_occlude.base.provenance import seed_of
from zbuf_occlude.datasets.cloud_files import READABLE, read_points
from zbuf_occlude.datasets.plan import DatasetConfig, Numbers, Plan
from zbuf_occlude.datasets.records import IDS, Records, record_type
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.collection import SPLITS, MeshCollection, MeshEntry
from zbuf_occlude.meshes.labels import SPLIT_WORDS

OBJECTS = "objects.csv"
"""Name of the table of a folder's clouds."""
_ANGLES = ("azimuth", "elevation")
_CONFIG = DatasetConfig(method="none", views="ring:1@0", n_points=1, sample_size=None, scale="mesh")
"""Settings of clouds that were not generated: every point of each, as in its file."""


def cloud_files(folder: Path) -> list[Path]:
    """Return the cloud files two or three levels below a folder, in order; none where there is no such folder."""
    found = (path for depth in ("*/*", "*/*/*") for path in folder.glob(depth))
    return sorted(path for path in found if path.suffix.lower() in READABLE and path.is_file())


class CloudFolder:
    """Clouds of a folder as records of a dataset.

    Raises DatasetError where files lie neither in CLASS nor in SPLIT/CLASS, or where objects.csv cannot be read or
    names a file that is gone.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.paths = folder, cloud_files(folder)
        self.about = _read_table(folder)
        entries = [self._entry(path) for path in self.paths]
        if gone := sorted(set(self.about) - {entry.key for entry in entries}):
            several = f" and {len(gone) - 1} more" if len(gone) > 1 else ""
            raise DatasetError(
                f"{folder / OBJECTS} must list clouds of its folder; {gone[0]!r}{several} is not there. "
                "Copy the clouds again, or delete their rows."
            )
        self.plan = Plan(MeshCollection(entries), _CONFIG, "ply")
        numbers = np.arange(len(entries))
        if any(len(path.relative_to(folder).parts) == 3 for path in self.paths):
            splits = {split: numbers[self.plan.split_of == SPLITS.index(split)] for split in self.plan.splits}
        else:
            splits = {"train": numbers, "test": numbers}
        self.order: dict[str, Numbers] = splits

    def _entry(self, path: Path) -> MeshEntry:
        *above, label, name = path.relative_to(self.folder).parts
        if above and above[0].lower() not in SPLIT_WORDS:
            raise DatasetError(
                f"{escape_control(str(path))} must lie in CLASS or in SPLIT/CLASS of {self.folder}, SPLIT one of "
                f"{', '.join(SPLITS)}; it lies in {'/'.join((*above, label))}. Move it, or give the folder above it."
            )
        key = escape_control("/".join((*above, label, name)))
        label = self.about.get(key, {}).get("class") or escape_control(label)
        split = SPLIT_WORDS[above[0].lower()] if above else "train"
        return MeshEntry(key, label, split, partial(_no_mesh, key))

    @property
    def origins(self) -> list[str]:
        """Name of the sweep of each cloud; where none is known, of its file."""
        keys = (entry.key for entry in self.plan.meshes)
        return [self.about.get(key, {}).get("sweep") or f"{self.folder.absolute()}/{key}" for key in keys]

    def take(self, numbers: Numbers) -> Records:
        """Return the records of some clouds; their points are in random order, unknown views NaN.

        The middle of the box of each is its `centre`: float32 would round the shape of a georeferenced cloud.
        """
        records = np.zeros(len(numbers), record_type(_CONFIG))
        for row, number in enumerate(numbers.tolist()):
            entry = self.plan.meshes[number]
            points = read_points(self.paths[number])
            rng = np.random.default_rng(seed_of(0, entry.key))
            records["centre"][row] = (points.min(axis=0) + points.max(axis=0)) / 2.0
            records["data"][row] = rng.permutation(points - records["centre"][row]).astype(np.float32)
            records["face_ids"][row] = np.full(len(points), -1, np.int32)
            records["label"][row] = self.plan.classes.index(entry.label)
            records["mesh_id"][row], records["n_visible"][row] = number, len(points)
            records["view"][row] = self._view(entry.key)
        records["pose"], records["factor"], records["visible_fraction"] = np.eye(4), 1.0, np.nan
        return records

    def _view(self, key: str) -> list[float]:
        """Return azimuth and elevation (radians) and range (metres) of the sensor of a cloud."""
        row = self.about.get(key, {})
        angles = [math.radians(_number(row, name, key)) for name in _ANGLES]
        return [*angles, _number(row, "range", key)]

    def ids(self) -> NDArray[Any]:
        """Return what each cloud is of, (n,) of `IDS`."""
        found = np.zeros(len(self.paths), IDS)
        found["mesh_id"] = np.arange(len(self.paths))
        return found


def _number(row: Mapping[str, str], name: str, key: str) -> float:
    """Return a number of a row of objects.csv, NaN where it has none."""
    try:
        return float(Number().read(name, row[name])) if row.get(name) else math.nan
    except OptionError as error:
        raise DatasetError(f"{OBJECTS}, {key}: {error} Crop the sweeps again.") from None


def _read_table(folder: Path) -> dict[str, dict[str, str]]:
    """Return the rows of objects.csv by file; none where it is missing."""
    path = folder / OBJECTS
    if not path.exists():
        return {}
    try:
        columns = parse_document("CSV", read_limited(path), path)
    except OptionError as error:
        raise DatasetError(f"{error} Crop the sweeps again.") from None
    if "file" not in columns:
        raise DatasetError(f"{path} must have the column file; it has {', '.join(columns)}. Crop the sweeps again.")
    names = list(columns)
    return {row[names.index("file")]: dict(zip(names, row, strict=True)) for row in zip(*columns.values(), strict=True)}


def _no_mesh(key: str) -> Mesh:
    raise MeshError(f"{key} is a cloud; it has no mesh.")
