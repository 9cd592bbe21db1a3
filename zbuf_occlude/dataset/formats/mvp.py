"""MVP's layout: 26 partial clouds of 2,048 points and one complete cloud per object, one HDF5 file per split.

MVP_Train_CP.h5, MVP_Test_CP.h5 (and MVP_Val_CP.h5)
    incomplete_pcds  (26 n, 2048, 3) float32, the 26 of an object one after the other
    complete_pcds    (n, 2048, 3) float32
    labels           (26 n,) int64
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.formats.published import (
    Records,
    by_object,
    check_pairs,
    complete_cloud,
    read_published,
    read_rows,
    rest_name,
    write_rest,
)
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Numbers, Source

N_VIEWS, SIZE = 26, 2_048
"""Loaders find the complete cloud of a partial one by dividing its number by 26."""


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "mvp", n_complete=SIZE, n_views=N_VIEWS, size=SIZE)


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    return (name for split in plan.splits for name in (_name(split), rest_name(split)))


def write(source: Source, out: Path) -> dict[str, list[str]]:
    """Write a file per split; objects with a view that sees nothing are left out."""
    files = {}
    for split in source.order:
        name = _name(split)

        def fill(file: Any, split: str = split) -> None:
            with h5py.File(file, "w") as h5:
                growing = {
                    field: h5.create_dataset(
                        field, (0, *shape), kind, maxshape=(None, *shape), chunks=(chunk, *shape), track_times=False
                    )
                    for field, shape, kind, chunk in (
                        ("incomplete_pcds", (SIZE, 3), "<f4", N_VIEWS),
                        ("complete_pcds", (SIZE, 3), "<f4", 1),
                        ("labels", (), "<i8", 26 * N_VIEWS),
                    )
                }

                def pairs() -> Iterator[Records]:
                    for records in by_object(source, split):
                        if len(records) == N_VIEWS:
                            _append(growing["incomplete_pcds"], records["data"])
                            _append(growing["complete_pcds"], complete_cloud(source, records, SIZE)["data"][None])
                            _append(growing["labels"], records["label"][:, 0])
                            yield records

                write_rest(out, split, pairs(), source.plan.recipe)

        atomic.write(out / name, fill)
        files[split] = [f"clouds_{split}.npy", name]
    return files


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the partial clouds."""

    def points(split: str, rest: Records, rows: Numbers) -> NDArray[Any]:
        return read_rows(out / _name(split), "incomplete_pcds", rows)

    return read_published(out, plan, files, points)


def _name(split: str) -> str:
    return f"MVP_{split.capitalize()}_CP.h5"


def _append(dataset: Any, rows: NDArray[Any]) -> None:
    dataset.resize(len(dataset) + len(rows), axis=0)
    dataset[-len(rows) :] = rows
