"""The border's checks: what passes, what does not, and in which words."""

import re
from typing import Any

import numpy as np
import pytest

from zbuf_occlude.base.arrays import as_indices, as_vectors, readonly_copy, set_readonly
from zbuf_occlude.base.errors import ArgumentError


@pytest.mark.parametrize(
    "values", [[[1, 2, 3]], np.ones((4, 3), np.float32), np.zeros((0, 3)), np.ones((2, 3), np.uint8)]
)
def test_vectors_become_contiguous_float64(values: Any) -> None:
    vectors = as_vectors(values, "points")
    assert vectors.dtype == np.float64
    assert vectors.flags.c_contiguous
    assert np.array_equal(vectors, np.asarray(values))


def test_vectors_that_are_right_already_are_not_copied() -> None:
    right = np.ones((5, 3))
    assert as_vectors(right, "points") is right
    strided = np.ones((3, 5)).T
    assert as_vectors(strided, "points") is not strided


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.zeros((3, 100), np.float32), "points must be (n, 3) float; got (3, 100) float32. Transpose it?"),
        (np.zeros(3), "points must be (n, 3) float; got (3,) float64. Add a leading axis: values[None]."),
        (np.zeros((5, 2)), "points must be (n, 3) float; got (5, 2) float64."),
        (np.zeros((2, 2, 3)), "points must be (n, 3) float; got (2, 2, 3) float64."),
        (3.0, "points must be (n, 3) float; got () float64."),
        ([["a", "b", "c"]], "points must be (n, 3) float; got (1, 3) <U1. Convert it to numbers."),
        (np.zeros((2, 3), bool), "points must be (n, 3) float; got (2, 3) bool. Convert it to numbers."),
        (np.zeros((2, 3), complex), "points must be (n, 3) float; got (2, 3) complex128. Convert it to numbers."),
        (None, "points must be (n, 3) float; got () object. Convert it to numbers."),
        ([[1, 2, 3], [1, 2]], "points must be (n, 3) float; got rows of unequal length. Pass one array."),
        (
            [[0, 0, 0], [1, np.nan, 2]],
            "points must be finite; row 1 is [1.0, nan, 2.0]. Remove or repair it.",
        ),
        ([[np.inf, 0, 0]], "points must be finite; row 0 is [inf, 0.0, 0.0]. Remove or repair it."),
    ],
)
def test_bad_vectors(values: Any, message: str) -> None:
    with pytest.raises(ArgumentError, match=f"^{re.escape(message)}$"):
        as_vectors(values, "points")


def test_indices_become_contiguous_int32() -> None:
    indices = as_indices(np.arange(6, dtype=np.int64).reshape(2, 3), "faces", columns=3, upper=6)
    assert indices.dtype == np.int32
    assert indices.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert as_indices([-1, 0], "face_ids", columns=None, upper=1, lowest=-1).tolist() == [-1, 0]
    assert as_indices([], "face_ids", columns=None, upper=0).shape == (0,)


@pytest.mark.parametrize(
    ("values", "columns", "message"),
    [
        ([[0, 1, 2]], None, "ids must be (n,) int; got (1, 3) int64."),
        ([0, 1], 3, "ids must be (n, 3) int; got (2,) int64."),
        ([0.0, 1.0], None, "ids must be (n,) int; got (2,) float64. Convert it with astype(int)."),
        ([True], None, "ids must be (n,) int; got (1,) bool. Convert it with astype(int)."),
        ([0, 5], None, "ids must lie in [0, 5); got values from 0 to 5."),
        ([-1, 2], None, "ids must lie in [0, 5); got values from -1 to 2."),
        ([2**40], None, "ids must lie in [0, 5); got values from 1099511627776 to 1099511627776."),
        ([[0, 1, 2], [3]], 3, "ids must be (n, 3) int; got rows of unequal length. Pass one array."),
    ],
)
def test_bad_indices(values: Any, columns: int | None, message: str) -> None:
    with pytest.raises(ArgumentError, match=f"^{re.escape(message)}$"):
        as_indices(values, "ids", columns=columns, upper=5)


def test_frozen_is_a_copy_and_sealed_is_not() -> None:
    mine = np.ones(3)
    copy = readonly_copy(mine)
    mine[0] = 7.0
    assert copy.tolist() == [1.0, 1.0, 1.0]
    with pytest.raises(ValueError, match="read-only"):
        copy[0] = 2.0
    assert set_readonly(mine) is mine
    with pytest.raises(ValueError, match="read-only"):
        mine[0] = 2.0
