"""NumPy archives: train-000000.npz and so on, an array for each field of the records."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.clouds import record_type
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Source, kept, source_of_files


def write(source: Source, out: Path) -> dict[str, list[str]]:
    """Write 2,048 clouds a file."""
    files: dict[str, list[str]] = {}
    for split in source.order:
        names = files.setdefault(split, [])
        for records in source.batches(split):
            names.append(f"{split}-{len(names):06d}.npz")
            fields = {name: np.ascontiguousarray(records[name]) for name in records.dtype.names or ()}
            atomic.write(out / names[-1], lambda file, fields=fields: np.savez(file, **fields))  # type: ignore[misc]
    return files


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the clouds of these files; the last file used is kept in memory."""
    paths = {split: [out / name for name in names] for split, names in files.items()}

    def whole(path: Path) -> NDArray[Any]:
        with np.load(path) as archive:
            records = np.empty(len(archive["label"]), record_type(plan.recipe))
            for name in records.dtype.names or ():
                records[name] = archive[name]
        return records

    return source_of_files(plan, paths, _count, kept(whole))


def _count(path: Path) -> int:
    with np.load(path) as archive:
        return len(archive["label"])
