"""ScanObjectNN's layout, its variant PB_T50_RS: {training,test,val}_objectdataset_augmentedrot_scale75.h5.

data   (n, size, 3) float32, y up
label  (n,) int64, by its list of 15 names
mask   (n, size) int64: -1 of points that are not the object's (`--keep box` or `all`), else 0
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from zbuf_occlude.dataset.formats.published import (
    Records,
    check_version,
    from_theirs,
    read_published,
    read_rows,
    rest_name,
    rows_of_rest,
    to_theirs,
)
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.shared import Rows, contiguous, write_hdf5, write_npy
from zbuf_occlude.dataset.source import Content, Numbers, Source

NAME = "scanobjectnn"


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    return (name for split in plan.splits for name in (_name(split), rest_name(split)))


def write_part(content: Content, out: Path) -> list[str]:
    """Write rows of a split's file."""
    first, total, records = content.first, content.total, content.records
    arrays = {
        "data": Rows(first, total, to_theirs(records["data"], content.plan.recipe, NAME)),
        "label": Rows(first, total, contiguous(records["label"][:, 0], "<i8")),
    }
    zeros = {"mask": (total, content.plan.recipe.equal_size)}
    if "instance" in (records.dtype.names or ()):
        arrays["mask"] = Rows(first, total, contiguous(-(records["instance"] != 0).astype("<i8"), "<i8"))
        zeros = {}
    name, rest = _name(content.split), rest_name(content.split)
    return [write_npy(out, rest, rows_of_rest(content)), write_hdf5(out, name, arrays, zeros)]


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the clouds."""
    check_version(plan, since=8)

    def points(split: str, rest: Records, rows: Numbers) -> NDArray[Any]:
        return from_theirs(read_rows(out / _name(split), "data", rows), plan.recipe, NAME)

    return read_published(out, plan, files, points)


def _name(split: str) -> str:
    return f"{'training' if split == 'train' else split}_objectdataset_augmentedrot_scale75.h5"
