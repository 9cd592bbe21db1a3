"""ScanObjectNN's layout: training_objectdataset.h5 and test_objectdataset.h5 (and val_objectdataset.h5).

data   (n, size, 3) float32
label  (n,) int64
mask   (n, size) int64; -1 marks points that are not the object's, and there are none: all are 0
"""

from pathlib import Path

import h5py

from zbuf_occlude.dataset.export import Exported, Rest
from zbuf_occlude.dataset.source import Source


def export(source: Source, out: Path) -> Exported:
    """Write a file for each split."""
    files, size = dict[str, list[str]](), source.plan.recipe.equal_size
    for split, n_clouds in source.n_clouds.items():
        name = f"{'training' if split == 'train' else split}_objectdataset.h5"
        rest, row = Rest(out, split, source.plan, n_clouds), 0
        with h5py.File(out / name, "w") as h5:
            data = h5.create_dataset("data", (n_clouds, size, 3), "<f4", track_times=False)
            label = h5.create_dataset("label", (n_clouds,), "<i8", track_times=False)
            h5.create_dataset("mask", (n_clouds, size), "<i8", track_times=False)
            for records in source.batches(split):
                rows = slice(row, row := row + len(records))
                data[rows], label[rows] = records["data"], records["label"][:, 0]
                rest.write(rows, records)
        files[split] = [name, rest.name]
    return Exported(files, source.n_clouds)
