"""MVP's layout: 26 partial clouds of 2,048 points and one complete cloud per object, one HDF5 file per split.

MVP_Train_CP.h5, MVP_Test_CP.h5 (and MVP_Val_CP.h5)
    incomplete_pcds  (26 n, 2048, 3) float32, the 26 of an object one after the other
    complete_pcds    (n, 2048, 3) float32
    labels           (26 n,) int64
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from zbuf_occlude.dataset.formats.published import (
    Records,
    check_pairs,
    read_published,
    read_rows,
    rest_name,
    rows_of_rest,
)
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.shared import Rows, contiguous, write_hdf5, write_npy
from zbuf_occlude.dataset.source import Content, Numbers, Source

N_VIEWS, SIZE = 26, 2_048
"""Loaders find the complete cloud of a partial one by dividing its number by 26."""


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "mvp", n_complete=SIZE, n_views=N_VIEWS, size=SIZE)


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    return (name for split in plan.splits for name in (_name(split), rest_name(split)))


def write_part(content: Content, out: Path) -> list[str]:
    """Write rows of a split's file."""
    assert content.complete is not None  # the table says that it is needed
    first, total, records = content.first, content.total, content.records
    complete = [content.complete(int(mesh_id), SIZE)["data"] for mesh_id in records["mesh_id"][::N_VIEWS]]
    arrays = {
        "incomplete_pcds": Rows(first, total, contiguous(records["data"], "<f4")),
        "complete_pcds": Rows(first // N_VIEWS, total // N_VIEWS, contiguous(complete, "<f4")),
        "labels": Rows(first, total, contiguous(records["label"][:, 0], "<i8")),
    }
    name, rest = _name(content.split), rest_name(content.split)
    return [write_npy(out, rest, rows_of_rest(content)), write_hdf5(out, name, arrays, {})]


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the partial clouds."""

    def points(split: str, rest: Records, rows: Numbers) -> NDArray[Any]:
        return read_rows(out / _name(split), "incomplete_pcds", rows)

    return read_published(out, plan, files, points)


def _name(split: str) -> str:
    return f"MVP_{split.capitalize()}_CP.h5"
