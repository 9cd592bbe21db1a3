"""ModelNet40-C's layout: one array per view, its corruption called "occlusion" and its level the view's number from 1.

    data_occlusion_1.npy, data_occlusion_2.npy ...    (n, size, 3) float32, an object per row
    label.npy                                         (n, 1) int64, for all of them

That is the split test, the only one that the benchmark has; others lie in a folder of their name.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.damage import reading
from zbuf_occlude.dataset.formats.published import Records, read_published, rest_name, without_points, write_rest
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.source import Numbers, Source
from zbuf_occlude.errors import OptionError

CORRUPTION = "occlusion"
LABELS = "label.npy"
ROWS_AT_ONCE = 256


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


def write(source: Source, out: Path) -> dict[str, list[str]]:
    """Write an array per view; objects with a view that sees nothing are left out."""
    files, n_views, size = {}, len(source.plan.views), source.plan.recipe.equal_size
    for split, numbers in source.order.items():
        facts = np.concatenate([_facts(source, some) for some in _parts(numbers)])
        facts = facts[np.lexsort((facts["view_id"], facts["mesh_id"]))]
        n_seeing = np.bincount(facts["mesh_id"], minlength=len(source.plan.meshes))
        facts = facts[n_seeing[facts["mesh_id"]] == n_views].reshape(-1, n_views)
        (out / _folder(split)).mkdir(exist_ok=True)

        def arrays(split: str = split, facts: NDArray[Any] = facts) -> Iterator[Records]:
            for view in range(n_views):
                shape = (len(facts), size, 3)
                parts = (source.take(some) for some in _parts(facts["number"][:, view]))
                yield from _written(out / _name(split, view), shape, parts, source.plan.recipe)

        rest = write_rest(out, split, arrays(), source.plan.recipe)
        labels = f"{_folder(split)}{LABELS}"
        atomic.write(out / labels, lambda file, facts=facts: np.save(file, facts["label"][:, :1]))  # type: ignore[misc]
        files[split] = [rest, labels, *(_name(split, view) for view in range(n_views))]
    return files


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the clouds."""

    def points(split: str, rest: Records, rows: Numbers) -> NDArray[Any]:
        clouds = np.empty((len(rest), plan.recipe.equal_size, 3), np.float32)
        for view in np.unique(rest["view_id"]):
            path = out / _name(split, int(view))
            with reading(path):
                array = np.load(path, mmap_mode="r")
                mine = rest["view_id"] == view
                clouds[mine] = array[rows[mine] - int(view) * len(array)]  # rows go view by view
        return clouds

    for split in files:
        path = out / f"{_folder(split)}{LABELS}"
        with reading(path):
            label = np.load(path)
            if label.shape != (len(label), 1) or ((label < 0) | (label >= len(plan.classes))).any():
                raise ValueError(f"labels {label.shape}, where there are {len(plan.classes)} classes")
    return read_published(out, plan, files, points)


def _facts(source: Source, numbers: Numbers) -> NDArray[Any]:
    records = source.take(numbers)
    facts = np.empty(len(numbers), [("number", "<i8"), ("mesh_id", "<i8"), ("view_id", "<i8"), ("label", "<i8")])
    facts["number"], facts["label"] = numbers, records["label"][:, 0]
    facts["mesh_id"], facts["view_id"] = records["mesh_id"], records["view_id"]
    return facts


def _parts(numbers: Numbers) -> Iterator[Numbers]:
    return (numbers[i : i + ROWS_AT_ONCE] for i in range(0, len(numbers), ROWS_AT_ONCE))


def _written(path: Path, shape: tuple[int, ...], parts: Iterator[Records], recipe: Recipe) -> list[Records]:
    """Write the points of parts as one array; return what to keep of them."""
    kept = []

    def fill(file: IO[bytes]) -> None:
        np.lib.format.write_array_header_1_0(file, {"descr": "<f4", "fortran_order": False, "shape": shape})
        for records in parts:
            file.write(records["data"].tobytes())
            kept.append(without_points(records, recipe))

    atomic.write(path, fill)
    return kept


def _folder(split: str) -> str:
    return "" if split == "test" else f"{split}/"


def _name(split: str, view: int) -> str:
    return f"{_folder(split)}data_{CORRUPTION}_{view + 1}.npy"
