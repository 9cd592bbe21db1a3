"""ModelNet40-C's layout: one array per view, its corruption called "occlusion" and its level the view's number from 1.

    data_occlusion_1.npy, data_occlusion_2.npy ...    (n, size, 3) float32, an object per row
    label.npy                                         (n, 1) int64, for all of them

That is the split test, the only one that the benchmark has; others lie in a folder of their name.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset.damage import reading
from zbuf_occlude.dataset.formats.published import Records, read_published, rest_name, rows_of_rest
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.shared import Rows, contiguous, write_npy
from zbuf_occlude.dataset.source import Content, Numbers, Source
from zbuf_occlude.errors import OptionError

CORRUPTION = "occlusion"
LABELS = "label.npy"


def check(plan: Plan) -> None:
    """Raise OptionError unless there is one cloud per object and view, as one array of labels for all arrays needs."""
    if plan.recipe.variations != 1:
        raise OptionError(
            f"modelnet40-c must have one cloud per object and view; got --variations {plan.recipe.variations}. Give 1."
        )


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    for split in plan.splits:
        yield from (rest_name(split), f"{_folder(split)}{LABELS}")
        yield from (_name(split, view) for view in range(len(plan.views)))


def write_part(content: Content, out: Path) -> list[str]:
    """Write rows of an array per view."""
    split, n_views, records = content.split, len(content.plan.views), content.records
    first, total = content.first // n_views, content.total // n_views
    files = [write_npy(out, rest_name(split), rows_of_rest(content))]
    labels = contiguous(records["label"][::n_views], "<i8")
    files.append(write_npy(out, f"{_folder(split)}{LABELS}", Rows(first, total, labels)))
    for view in range(n_views):
        points = contiguous(records["data"][view::n_views], "<f4")
        files.append(write_npy(out, _name(split, view), Rows(first, total, points)))
    return files


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the clouds."""
    by_view = {split for split in files if _goes_by_view(out / rest_name(split))}

    def points(split: str, rest: Records, rows: Numbers) -> NDArray[Any]:
        clouds = np.empty((len(rest), plan.recipe.equal_size, 3), np.float32)
        for view in np.unique(rest["view_id"]):
            path = out / _name(split, int(view))
            with reading(path):
                array = np.load(path, mmap_mode="r")
                mine = rest["view_id"] == view
                before = int(view) * len(array)
                clouds[mine] = array[rows[mine] - before if split in by_view else rows[mine] // len(plan.views)]
        return clouds

    for split in files:
        path = out / f"{_folder(split)}{LABELS}"
        with reading(path):
            label = np.load(path)
            if label.shape != (len(label), 1) or ((label < 0) | (label >= len(plan.classes))).any():
                raise ValueError(f"labels {label.shape}, where there are {len(plan.classes)} classes")
    return read_published(out, plan, files, points)


def _goes_by_view(path: Path) -> bool:
    """Whether records stand view by view, as they did before data version 6, and not object by object."""
    with reading(path):
        views = np.load(path, mmap_mode="r")["view_id"][:2]
        return len(views) == 2 and views[0] == views[1]


def _folder(split: str) -> str:
    return "" if split == "test" else f"{split}/"


def _name(split: str, view: int) -> str:
    return f"{_folder(split)}data_{CORRUPTION}_{view + 1}.npy"
