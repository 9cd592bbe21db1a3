"""Completion3D's layout: a partial and a complete cloud of 2,048 points per object, each an HDF5 file.

SPLIT/partial/TAXONOMY/OBJECT.h5    data (2048, 3) float32
SPLIT/gt/TAXONOMY/OBJECT.h5         data (2048, 3) float32
SPLIT.list                          TAXONOMY/OBJECT, one per line
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.formats.published import (
    Names,
    Records,
    by_object,
    check_pairs,
    complete_cloud,
    names_of,
    read_cloud_files,
    rest_name,
    write_list,
    write_rest,
)
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Source

SIZE = 2_048


def check(plan: Plan) -> None:
    """Raise OptionError unless the plan is as the loaders expect."""
    check_pairs(plan, "completion3d", n_complete=SIZE, n_views=1, size=SIZE)


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    names = names_of(plan)
    yield from (name for split in plan.splits for name in (rest_name(split), f"{split}.list"))
    for mesh_id, entry in enumerate(plan.meshes):
        place = f"{names.taxonomies[mesh_id]}/{names.objects[mesh_id]}.h5"
        yield from (f"{entry.split}/{kind}/{place}" for kind in ("partial", "gt"))


def write(source: Source, out: Path) -> dict[str, list[str]]:
    """Write a pair of files per object."""
    names, files = names_of(source.plan), {}
    for split in source.order:
        listed: list[str] = []

        def pairs(split: str = split, listed: list[str] = listed) -> Iterator[Records]:
            for records in by_object(source, split):
                mesh_id = int(records["mesh_id"][0])
                listed.append(f"{names.taxonomies[mesh_id]}/{names.objects[mesh_id]}")
                _write_h5(out / f"{split}/partial/{listed[-1]}.h5", records["data"][0])
                _write_h5(out / f"{split}/gt/{listed[-1]}.h5", complete_cloud(source, records, SIZE)["data"])
                yield records

        rest = write_rest(out, split, pairs(), source.plan.recipe)
        atomic.write_lines(out / f"{split}.list", listed)
        written = [f"{split}/{kind}/{name}.h5" for name in listed for kind in ("partial", "gt")]
        files[split] = [rest, write_list(out, split, written), f"{split}.list"]
    return files


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the partial clouds."""

    def name_of(split: str, names: Names, record: Any) -> str:
        mesh_id = int(record["mesh_id"])
        return f"{split}/partial/{names.taxonomies[mesh_id]}/{names.objects[mesh_id]}.h5"

    return read_cloud_files(out, plan, files, _read_h5, name_of)


def _write_h5(path: Path, positions: NDArray[Any]) -> None:
    def fill(file: Any) -> None:
        with h5py.File(file, "w") as h5:
            h5.create_dataset("data", data=positions.astype(np.float32), track_times=False)

    path.parent.mkdir(parents=True, exist_ok=True)
    atomic.write(path, fill)


def _read_h5(path: Path) -> NDArray[Any]:
    with h5py.File(path) as h5:
        return np.asarray(h5["data"][:])
