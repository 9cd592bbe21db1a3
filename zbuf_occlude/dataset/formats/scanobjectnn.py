"""ScanObjectNN's layout: training_objectdataset.h5 and test_objectdataset.h5 (and val_objectdataset.h5).

data   (n, size, 3) float32
label  (n,) int64
mask   (n, size) int64; -1 marks points that are not the object's, and there are none: all are 0
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.formats.published import Records, read_published, read_rows, rest_name, write_rest
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Numbers, Source


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    return (name for split in plan.splits for name in (_name(split), rest_name(split)))


def write(source: Source, out: Path) -> dict[str, list[str]]:
    """Write a file per split."""
    files = {}
    size = source.plan.recipe.equal_size
    for split, numbers in source.order.items():
        name, n_clouds = _name(split), len(numbers)

        def fill(file: Any, split: str = split, n_clouds: int = n_clouds) -> None:
            with h5py.File(file, "w") as h5:
                data = h5.create_dataset("data", (n_clouds, size, 3), "<f4", track_times=False)
                label = h5.create_dataset("label", (n_clouds,), "<i8", track_times=False)
                mask = h5.create_dataset("mask", (n_clouds, size), "<i8", track_times=False)
                mask[:] = 0

                def parts() -> Iterator[Records]:
                    begin = 0
                    for records in source.batches(split):
                        end = begin + len(records)
                        data[begin:end], label[begin:end] = records["data"], records["label"][:, 0]
                        begin = end
                        yield records

                write_rest(out, split, parts(), source.plan.recipe)

        atomic.write(out / name, fill)
        files[split] = [f"clouds_{split}.npy", name]
    return files


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the clouds."""

    def points(split: str, rest: Records, rows: Numbers) -> NDArray[Any]:
        return read_rows(out / _name(split), "data", rows)

    return read_published(out, plan, files, points)


def _name(split: str) -> str:
    return f"{'training' if split == 'train' else split}_objectdataset.h5"
