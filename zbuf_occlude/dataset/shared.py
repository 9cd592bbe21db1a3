"""Files that hold a split whole, written by several workers at once: each writes its rows, where they are to be.

Such a file is made at its full size and empty, which takes no room on the disk. It lies with the shards, and gets its
name when all its rows are there (`publish`).
"""

import io
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.damage import reading
from zbuf_occlude.dataset.folder import SHARDS


class Rows(NamedTuple):
    """Some rows of an array: that with number `first` and those after it, of `total`."""

    first: int
    total: int
    values: NDArray[Any]


def unfinished(out: Path, name: str) -> Path:
    """Where a file is until all its rows are written."""
    return out / SHARDS / name.replace("/", "-")


def where(out: Path, name: str) -> Path:
    """Where a file of a dataset is, finished or not."""
    path = unfinished(out, name)
    return path if path.exists() else out / name


def publish(out: Path, name: str) -> None:
    """Give a file its name, if it has not got it yet."""
    (out / name).parent.mkdir(exist_ok=True)
    with suppress(FileNotFoundError):
        os.replace(unfinished(out, name), out / name)


def write_npy(out: Path, name: str, rows: Rows) -> str:
    """Write rows of a NumPy file; return its name."""
    header = io.BytesIO()
    kind, shape = rows.values.dtype, (rows.total, *rows.values.shape[1:])
    about = {"descr": np.lib.format.dtype_to_descr(kind), "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(header, about)
    size = header.tell() + rows.total * rows.values[:1].nbytes

    def make(file: IO[bytes]) -> None:
        file.write(header.getvalue())
        file.truncate(size)

    path = _made(out, name, make)
    with reading(path):
        if (found := path.stat().st_size) != size:
            raise ValueError(f"it has {found} bytes, where there are {size}")
    _write(path, [(header.tell(), rows)])
    return name


def write_hdf5(out: Path, name: str, arrays: Mapping[str, Rows], zeros: Mapping[str, tuple[int, ...]]) -> str:
    """Write rows of datasets of an HDF5 file, which also has int64 `zeros` of these shapes; return its name."""

    def make(file: IO[bytes]) -> None:
        with h5py.File(file, "w") as h5:
            for key, rows in arrays.items():
                at_once = h5py.h5p.create(h5py.h5p.DATASET_CREATE)  # where its rows are in the file is known at once
                at_once.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
                at_once.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
                shape = (rows.total, *rows.values.shape[1:])
                h5.create_dataset(key, shape, rows.values.dtype, track_times=False, dcpl=at_once)
            for key, shape in zeros.items():
                h5.create_dataset(key, shape, "<i8", track_times=False)  # nothing is stored of what is never written

    path = _made(out, name, make)
    with reading(path), h5py.File(path, "r", locking=False) as h5:  # others are writing, by other means
        places = [(h5[key].id.get_offset(), rows) for key, rows in arrays.items()]
    _write(path, places)
    return name


def contiguous(values: ArrayLike, kind: str) -> NDArray[Any]:
    """Return values as they are to stand in a file."""
    return np.ascontiguousarray(values, kind)


def _made(out: Path, name: str, make: Callable[[IO[bytes]], None]) -> Path:
    """Return where a file is, made if there is none; one that has its name is written again, never made anew."""
    if not where(out, name).exists():
        with suppress(FileExistsError):  # another worker was faster, and has made the same
            atomic.write(unfinished(out, name), make, exclusive=True)
    return where(out, name)


def _write(path: Path, places: list[tuple[int, Rows]]) -> None:
    """Write rows of arrays that begin at these bytes of a file."""
    with open(path, "r+b") as file:
        for begin, (first, _, values) in places:
            file.seek(begin + first * values[:1].nbytes)
            file.write(values.data if values.dtype.names is None else values.view(np.uint8).data)
        file.flush()
        os.fsync(file.fileno())
