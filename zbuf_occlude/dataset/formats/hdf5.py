"""The PointNet layout: ply_data_train0.h5 and so on, 2,048 clouds per file, listed in train_files.txt.

Of clouds of unequal size the points stand one after the other; those of cloud i are offsets[i] to offsets[i + 1].
"""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.folder import list_of
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.records import IDS, OFFSETS, Records, laid_out, taken
from zbuf_occlude.dataset.source import Source, source_of_files

UNITS = {
    OFFSETS: "points of cloud i are those from offsets[i] to offsets[i + 1]",
    "data": "(p - centre) * factor, p the visible points in the frame of attribute `frame`",
    "label": "index into shape_names.txt",
    "face_ids": "index into the faces of the cleaned mesh",
    "mesh_id": "index into mesh_keys.txt",
    "view": "azimuth and elevation in radians, distance in the mesh's units",
    "pose": "view matrix: world space to eye space (x right, y up, looking along -z)",
    "n_visible": "visible points before the subset was drawn",
    "visible_fraction": "of the points sampled on the object",
}

AT_ONCE = 2**20
"""Bytes of a field that are copied and written at a time: they fit in a cache."""


def file_name(split: str, number: int) -> str:
    """Return the name of a file."""
    return f"ply_data_{split}{number}.h5"


def finish(out: Path, plan: Plan, names: dict[str, list[str]]) -> None:
    """Write the lists of files that the loaders begin with."""
    for split, names_of_split in names.items():
        atomic.write_lines(out / list_of(split), names_of_split)


def write(path: Path, records: Records, plan: Plan, number: int = 0) -> None:
    """Write one file: a dataset for each field of the records, its meaning in the attribute `meaning`."""

    def fill(file: Any) -> None:
        with h5py.File(file, "w", track_order=True) as h5:
            h5.attrs["frame"] = plan.recipe.frame
            h5.attrs["scale"] = plan.recipe.scale
            h5.attrs["fingerprint"] = plan.fingerprint
            for name, values in laid_out(records, plan.recipe).items():
                dataset = h5.create_dataset(name, values.shape, values.dtype, track_times=False)
                n_rows = max(1, AT_ONCE // max(1, values[:1].nbytes))
                for first in range(0, len(values), n_rows):
                    dataset[first : first + n_rows] = values[first : first + n_rows]
                if name in UNITS:
                    dataset.attrs["meaning"] = UNITS[name]

    atomic.write(path, fill)


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the clouds of these files."""

    def load(path: Path, rows: NDArray[np.intp]) -> Records:
        with h5py.File(path) as h5:
            return taken(h5, rows, plan.recipe)

    return source_of_files(plan, out, files, lambda path: len(_read_ids(path)), load, read_ids=_read_ids)


def _read_ids(path: Path) -> NDArray[Any]:
    with h5py.File(path) as h5:
        ids = np.empty(len(h5["label"]), IDS)
        for name in IDS.names or ():
            ids[name] = h5[name][:]
        return ids
