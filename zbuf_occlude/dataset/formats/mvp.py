"""MVP's layout: 26 partial clouds of 2,048 points and one complete cloud per object, one HDF5 file per split.

MVP_Train_CP.h5, MVP_Test_CP.h5 (and MVP_Val_CP.h5)
    incomplete_pcds  (26 n, 2048, 3) float32, the 26 of an object one after the other
    complete_pcds    (n, 2048, 3) float32
    labels           (26 n,) int64, by its list of 16 names
mvp_train_input.h5, mvp_train_gt_2048pts.h5, mvp_test_input.h5, ...
    the same under the names that VRCNet reads, as links to those files; novel_incomplete_pcds, novel_labels and
    novel_complete_pcds are empty

References
----------
paul007pl/MVP_Benchmark, completion/dataset.py, MVP_CP; paul007pl/VRCNet, dataset.py, ShapeNetH5.
"""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.formats.published import (
    Records,
    check_pairs,
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

NAME = "mvp"
N_VIEWS, SIZE = 26, 2_048
"""Loaders find the complete cloud of a partial one by dividing its number by 26."""


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "mvp", n_complete=SIZE, n_views=N_VIEWS, size=SIZE)


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    return (name for split in plan.splits for name in (_name(split), rest_name(split), *_older_names(split)))


def write_part(content: Content, out: Path) -> list[str]:
    """Write rows of a split's file."""
    assert content.complete is not None  # the table says that it is needed
    first, total, records = content.first, content.total, content.records
    complete = [content.complete(int(mesh_id), SIZE)["data"] for mesh_id in records["mesh_id"][::N_VIEWS]]
    recipe = content.plan.recipe
    arrays = {
        "incomplete_pcds": Rows(first, total, to_theirs(records["data"], recipe, NAME)),
        "complete_pcds": Rows(first // N_VIEWS, total // N_VIEWS, to_theirs(np.array(complete), recipe, NAME)),
        "labels": Rows(first, total, contiguous(records["label"][:, 0], "<i8")),
    }
    name, rest = _name(content.split), rest_name(content.split)
    return [write_npy(out, rest, rows_of_rest(content)), write_hdf5(out, name, arrays, {})]


def finish(out: Path, plan: Plan, names: dict[str, list[str]], n_clouds: dict[str, int]) -> dict[str, list[str]]:
    """Write the files of older loaders."""
    for split in names:
        for name, arrays in zip(_older_names(split), (("incomplete_pcds", "labels"), ("complete_pcds",)), strict=True):
            atomic.write(out / name, partial(_link, to=_name(split), arrays=arrays))
    return {split: [*of_split, *_older_names(split)] for split, of_split in names.items()}


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the partial clouds."""
    check_version(plan, since=8)

    def points(split: str, rest: Records, rows: Numbers) -> NDArray[Any]:
        return from_theirs(read_rows(out / _name(split), "incomplete_pcds", rows), plan.recipe, NAME)

    return read_published(out, plan, files, points)


def _name(split: str) -> str:
    return f"MVP_{split.capitalize()}_CP.h5"


def _older_names(split: str) -> tuple[str, str]:
    return f"mvp_{split}_input.h5", f"mvp_{split}_gt_{SIZE}pts.h5"


def _link(file: Any, to: str, arrays: tuple[str, ...]) -> None:
    """Write an HDF5 file whose arrays are another's, and whose arrays of novel classes are empty."""
    with h5py.File(file, "w") as h5:
        for name in arrays:
            h5[name] = h5py.ExternalLink(to, name)
            shape, kind = ((0,), "<i8") if name == "labels" else ((0, SIZE, 3), "<f4")
            h5.create_dataset(f"novel_{name}", shape, kind, track_times=False)
