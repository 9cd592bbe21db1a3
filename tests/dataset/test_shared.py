"""Files that several write: one that has its name already is written again in place, and never begun anew."""

from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest

from zbuf_occlude.dataset.folder import SHARDS
from zbuf_occlude.dataset.shared import Rows, publish, unfinished, write_hdf5, write_npy
from zbuf_occlude.errors import DatasetError

VALUES = np.arange(12.0).reshape(4, 3)


def test_rows_written_again_after_another_run_has_published_them(tmp_path: Path) -> None:
    (tmp_path / SHARDS).mkdir()
    halves = Rows(0, 4, VALUES[:2]), Rows(2, 4, VALUES[2:])
    for half in halves:
        write_npy(tmp_path, "a.npy", half)
        write_hdf5(tmp_path, "a.h5", {"a": half}, {"zeros": (4,)})
    for name in ("a.npy", "a.h5"):
        publish(tmp_path, name)
    write_npy(tmp_path, "a.npy", halves[0])
    write_hdf5(tmp_path, "a.h5", {"a": halves[0]}, {"zeros": (4,)})
    for name in ("a.npy", "a.h5"):
        assert not unfinished(tmp_path, name).exists()
        publish(tmp_path, name)
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), VALUES)
    with h5py.File(tmp_path / "a.h5") as h5:
        np.testing.assert_array_equal(h5["a"], VALUES)


def test_rows_for_a_file_that_is_cut(tmp_path: Path) -> None:
    (tmp_path / SHARDS).mkdir()
    rows = Rows(0, 4, VALUES[:2])
    for name, write in (
        ("a.npy", partial(write_npy, rows=rows)),
        ("a.h5", partial(write_hdf5, arrays={"a": rows}, zeros={})),
    ):
        write(tmp_path, name)
        path = unfinished(tmp_path, name)
        path.write_bytes(path.read_bytes()[:-8])
        with pytest.raises(DatasetError, match=f"{name} must be as it was written"):
            write(tmp_path, name)
