"""The PointNet layout: ply_data_train0.h5 and so on, up to 2,048 clouds per file, listed in train_files.txt.

Of clouds of unequal size the points stand one after the other; those of cloud i are offsets[i] to offsets[i + 1].
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, TypeVar

import h5py
import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base import atomic
from zbuf_occlude.base.atomic import FileDigest
from zbuf_occlude.datasets.folder import list_of
from zbuf_occlude.datasets.plan import Plan
from zbuf_occlude.datasets.records import IDS, OFFSETS, Records, read_rows, to_arrays
from zbuf_occlude.datasets.source import CloudReader, source_of_files

UNITS = {
    OFFSETS: "points of cloud i are those from offsets[i] to offsets[i + 1]",
    "data": "(p - centre) * factor, p the visible points in the frame of attribute `frame`",
    "label": "index into shape_names.txt",
    "face_ids": "index into the faces of the cleaned mesh",
    "mesh_id": "index into mesh_keys.txt",
    "view": "azimuth and elevation in radians, distance in the mesh's units",
    "pose": "view matrix: world space to eye space",
    "n_visible": "visible points before the subset was drawn",
    "visible_fraction": "of the points sampled on the object",
}

T = TypeVar("T")
AT_ONCE = 2**20
"""Bytes of a field that are copied and written at a time: they fit in a cache."""


def file_name(split: str, number: int) -> str:
    """Return the name of a file."""
    return f"ply_data_{split}{number}.h5"


def finish(out: Path, plan: Plan, names: Mapping[str, list[str]]) -> None:
    """Write the lists of files that the loaders begin with."""
    for split, names_of_split in names.items():
        atomic.write_lines(out / list_of(split), names_of_split)


def write(path: Path, records: Records, plan: Plan, number: int) -> FileDigest:
    """Write one file: a dataset for each field of the records, its meaning in the attribute `meaning`."""

    def fill(file: IO[bytes]) -> None:
        with _h5_in(file, track_order=True) as h5:
            h5.attrs["frame"], h5.attrs["axes"] = plan.config.frame, plan.config.axes
            h5.attrs["scale"] = plan.config.scale
            h5.attrs["fingerprint"] = plan.fingerprint
            for name, values in to_arrays(records, plan.config).items():
                dataset = h5.create_dataset(name, values.shape, values.dtype, track_times=False)
                n_rows = max(1, AT_ONCE // max(1, values[:1].nbytes))
                for first in range(0, len(values), n_rows):
                    dataset[first : first + n_rows] = values[first : first + n_rows]
                if name in UNITS:
                    dataset.attrs["meaning"] = UNITS[name]

    return atomic.write_data(path, fill)


@contextmanager
def new_h5(path: Path) -> Iterator[Any]:
    """Open a new HDF5 file to be written; what cannot be written is an OSError at the end."""
    with open(path, "w+b") as file, _h5_in(file) as h5:
        yield h5


@contextmanager
def _h5_in(file: IO[bytes], **options: Any) -> Iterator[Any]:
    """Open an HDF5 file inside an open one."""
    disk = _Disk(file)
    try:
        with h5py.File(disk, "w", **options) as h5:
            yield h5
    finally:
        if disk.error is not None:
            disk.error.filename = file.name
            raise disk.error


class _Disk:
    """A file whose errors are hidden from HDF5, which would end the process on a full disk."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self.error: OSError | None = None

    def _do(self, act: Callable[[], T]) -> T | None:
        if self.error is None:
            try:
                return act()
            except OSError as error:
                self.error = error
        return None

    def write(self, content: Any) -> int:
        """Write all of some bytes, or none after an error."""
        self._do(lambda: self._file.write(content))
        return len(content)

    def read(self, size: int) -> bytes:
        """Read bytes back, zeros behind the end."""
        return (self._do(lambda: self._file.read(size)) or b"").ljust(size, b"\0")

    def readinto(self, buffer: Any) -> int:
        """Read bytes back into a buffer."""
        view = memoryview(buffer).cast("B")
        view[:] = self.read(len(view))
        return len(view)

    def tell(self) -> int:
        """Return the position."""
        return self._do(self._file.tell) or 0

    def seek(self, offset: int, whence: int = 0) -> int:
        """Go to a position."""
        return self._do(lambda: self._file.seek(offset, whence)) or offset

    def truncate(self, size: int) -> int:
        """Give the file a size."""
        self._do(lambda: self._file.truncate(size))
        return size

    def flush(self) -> None:
        """Have all bytes reach the system."""
        self._do(self._file.flush)


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> CloudReader:
    """Return the clouds of these files."""

    def load(path: Path, rows: NDArray[np.intp]) -> Records:
        with h5py.File(path) as h5:
            return read_rows(h5, rows, plan.config)

    return source_of_files(plan, out, files, lambda path: len(_read_ids(path)), load, read_ids=_read_ids)


def _read_ids(path: Path) -> NDArray[Any]:
    with h5py.File(path) as h5:
        ids = np.empty(len(h5["label"]), IDS)
        for name in IDS.names or ():
            ids[name] = h5[name][:]
        return ids
