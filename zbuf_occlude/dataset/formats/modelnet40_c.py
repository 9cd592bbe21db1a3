"""ModelNet40-C's layout: one array per view, its corruption occlusion or lidar, its level the view's number from 1.

    data_occlusion_1.npy, data_occlusion_2.npy ...    (n, size, 3) float32, an object per row; y up
    label.npy                                         (n, 1) int64, for all of them

With a spinning sensor the corruption is lidar. That is the split test, the only one that the benchmark has; others lie
in a folder of their name.

References
----------
jiachens/ModelNet40-C, data/generate_c.py, occlusion() and lidar(): both turn (x, y, z) to (-x, z, y); occlusion() ends
with normalize(), which centres each cloud and makes its longest side 2; lidar() leaves the cloud in the frame in which
data/occlusion.py, occlusion_1(), has centred the mesh, its longest side 2 (recipe's scale "object").
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset.damage import reading
from zbuf_occlude.dataset.formats.published import (
    Records,
    check_version,
    from_theirs,
    read_published,
    rest_name,
    rows_of_rest,
    to_theirs,
)
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.shared import Rows, contiguous, write_npy
from zbuf_occlude.dataset.source import Content, Numbers, Source
from zbuf_occlude.errors import OptionError

NAME, LABELS = "modelnet40-c", "label.npy"


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
        yield from (_name(plan, split, view) for view in range(len(plan.views)))


def write_part(content: Content, out: Path) -> list[str]:
    """Write rows of an array per view."""
    split, n_views, records = content.split, len(content.plan.views), content.records
    first, total = content.first // n_views, content.total // n_views
    files = [write_npy(out, rest_name(split), rows_of_rest(content))]
    labels = contiguous(records["label"][::n_views], "<i8")
    files.append(write_npy(out, f"{_folder(split)}{LABELS}", Rows(first, total, labels)))
    for view in range(n_views):
        points = to_theirs(records["data"][view::n_views], content.plan.recipe, NAME)
        files.append(write_npy(out, _name(content.plan, split, view), Rows(first, total, points)))
    return files


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the clouds."""
    check_version(plan, since=8)

    def points(split: str, rest: Records, rows: Numbers) -> NDArray[Any]:
        clouds = np.empty((len(rest), plan.recipe.equal_size, 3), np.float32)
        for view in np.unique(rest["view_id"]):
            path = out / _name(plan, split, int(view))
            with reading(path):
                array = np.load(path, mmap_mode="r")
                mine = rest["view_id"] == view
                clouds[mine] = array[rows[mine] // len(plan.views)]
        return from_theirs(clouds, plan.recipe, NAME)

    for split in files:
        path = out / f"{_folder(split)}{LABELS}"
        with reading(path):
            label = np.load(path)
            if label.shape != (len(label), 1) or ((label < 0) | (label >= len(plan.classes))).any():
                raise ValueError(f"labels {label.shape}, where there are {len(plan.classes)} classes")
    return read_published(out, plan, files, points)


def _folder(split: str) -> str:
    return "" if split == "test" else f"{split}/"


def _name(plan: Plan, split: str, view: int) -> str:
    setup = plan.recipe.setup
    corruption = "lidar" if setup is not None and setup.made_sensor.kind == "spinning" else "occlusion"
    return f"{_folder(split)}data_{corruption}_{view + 1}.npy"
