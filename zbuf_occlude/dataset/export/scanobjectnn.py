"""ScanObjectNN's layout, its variant PB_T50_RS: {training,test,val}_objectdataset_augmentedrot_scale75.h5.

data   (n, size, 3) float32, y up
label  (n,) int64, by its list of 15 names
mask   (n, size) int64: -1 of points that are not the object's (`--keep box` or `all`), else 0
"""

from pathlib import Path

import h5py
import numpy as np

from zbuf_occlude.dataset.export import Exported, Rest
from zbuf_occlude.dataset.source import Source


def export(source: Source, out: Path) -> Exported:
    """Write a file for each split."""
    files, size = dict[str, list[str]](), source.plan.recipe.equal_size
    for split, n_clouds in source.n_clouds.items():
        name = f"{'training' if split == 'train' else split}_objectdataset_augmentedrot_scale75.h5"
        rest, row = Rest(out, split, source.plan, n_clouds), 0
        with h5py.File(out / name, "w") as h5:
            data = h5.create_dataset("data", (n_clouds, size, 3), "<f4", track_times=False)
            label = h5.create_dataset("label", (n_clouds,), "<i8", track_times=False)
            mask = h5.create_dataset("mask", (n_clouds, size), "<i8", track_times=False)  # zeros take no room
            for records in source.batches(split):
                rows = slice(row, row := row + len(records))
                data[rows], label[rows] = records["data"], records["label"][:, 0]
                if "instance" in (records.dtype.names or ()):
                    mask[rows] = -(records["instance"] != 0).astype(np.int64)
                rest.write(rows, records)
        files[split] = [name, rest.name]
    return Exported(files, source.n_clouds)
