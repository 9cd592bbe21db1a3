"""ScanObjectNN's layout: training_objectdataset.h5 and test_objectdataset.h5 (and val_objectdataset.h5).

data   (n, size, 3) float32
label  (n,) int64
mask   (n, size) int64; -1 marks points that are not the object's, and there are none: all are 0
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from zbuf_occlude.dataset.formats.published import Records, read_published, read_rows, rest_name, rows_of_rest
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.shared import Rows, contiguous, write_hdf5, write_npy
from zbuf_occlude.dataset.source import Content, Numbers, Source


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    return (name for split in plan.splits for name in (_name(split), rest_name(split)))


def write_part(content: Content, out: Path) -> list[str]:
    """Write rows of a split's file."""
    first, total, records = content.first, content.total, content.records
    arrays = {
        "data": Rows(first, total, contiguous(records["data"], "<f4")),
        "label": Rows(first, total, contiguous(records["label"][:, 0], "<i8")),
    }
    name, rest = _name(content.split), rest_name(content.split)
    mask = {"mask": (total, content.plan.recipe.equal_size)}
    return [write_npy(out, rest, rows_of_rest(content)), write_hdf5(out, name, arrays, mask)]


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the clouds."""

    def points(split: str, rest: Records, rows: Numbers) -> NDArray[Any]:
        return read_rows(out / _name(split), "data", rows)

    return read_published(out, plan, files, points)


def _name(split: str) -> str:
    return f"{'training' if split == 'train' else split}_objectdataset.h5"
