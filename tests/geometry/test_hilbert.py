"""The Hilbert curve: visits every cell once and never jumps."""

import itertools

import numpy as np
import pytest

from zbuf_occlude.geometry.hilbert import hilbert_order, sort_keys


def test_consecutive_cells_are_neighbours() -> None:
    """A 16^3 grid: a permutation, whose every step is one cell along one axis (Morton order's longest is 15 + 15)."""
    cells = np.array(list(itertools.product(range(16), repeat=3)), dtype=np.float64)
    order = hilbert_order(cells * 0.3 - 7.0)
    assert np.array_equal(np.sort(order), np.arange(len(cells)))
    assert (np.abs(np.diff(cells[order], axis=0)).sum(axis=1) == 1).all()


def test_one_cell_keeps_its_order() -> None:
    assert hilbert_order(np.zeros((5, 3))).tolist() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(("n", "code_bits"), [(0, 21), (1, 21), (5000, 3), (5000, 21), (100_000, 32)])
def test_keys_are_sorted_by_code_and_keep_their_order(n: int, code_bits: int) -> None:
    codes = np.random.default_rng(n).integers(0, 1 << code_bits, n, dtype=np.uint64)
    index_bits = n.bit_length()
    keys = codes << np.uint64(index_bits) | np.arange(n, dtype=np.uint64)
    np.testing.assert_array_equal(sort_keys(keys.copy(), index_bits, code_bits), np.sort(keys))
