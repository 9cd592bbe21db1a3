"""NumPy archives: train-000000.npz and so on, an array for each field of the records.

Of clouds of unequal size the points stand one after the other; those of cloud i are offsets[i] to offsets[i + 1].
"""

from pathlib import Path

import numpy as np

from zbuf_occlude.base import atomic
from zbuf_occlude.base.atomic import FileDigest
from zbuf_occlude.datasets.plan import Plan
from zbuf_occlude.datasets.records import Records, read_archive, to_arrays
from zbuf_occlude.datasets.source import CloudReader, kept, source_of_files


def file_name(split: str, number: int) -> str:
    """Return the name of a file."""
    return f"{split}-{number:06d}.npz"


def write(path: Path, records: Records, plan: Plan, number: int) -> FileDigest:
    """Write one archive."""
    fields = to_arrays(records, plan.config)
    return atomic.write_data(path, lambda file: np.savez(file, **fields))  # type: ignore[arg-type]


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> CloudReader:
    """Return the clouds of these files; the last file used is kept in memory."""
    return source_of_files(plan, out, files, _count, kept(lambda path: read_archive(path, plan.config)))


def _count(path: Path) -> int:
    with np.load(path) as archive:
        return len(archive["label"])
