"""The Hilbert curve: visits every cell once and never jumps."""

import itertools

import numpy as np
import pytest

from zbuf_occlude.geometry.hilbert import DIGIT_BITS, MANY_KEYS, PART, hilbert_order, sorted_keys
from zbuf_occlude.jit.threads import alone


def test_consecutive_cells_are_neighbours() -> None:
    """A 16^3 grid: a permutation, whose every step is one cell along one axis (Morton order's longest is 15 + 15)."""
    cells = np.array(list(itertools.product(range(16), repeat=3)), dtype=np.float64)
    order = hilbert_order(cells * 0.3 - 7.0)
    assert np.array_equal(np.sort(order), np.arange(len(cells)))
    assert (np.abs(np.diff(cells[order], axis=0)).sum(axis=1) == 1).all()


def test_one_cell_keeps_its_order() -> None:
    assert hilbert_order(np.zeros((5, 3))).tolist() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("n", [0, 1, 2, 1000, MANY_KEYS, MANY_KEYS + 1, MANY_KEYS + 2 * PART])
@pytest.mark.parametrize("n_bits", [1, DIGIT_BITS, DIGIT_BITS + 1, 32])
@pytest.mark.parametrize("power", [1, 12])
def test_keys_are_sorted_as_numpy_sorts_them(n: int, n_bits: int, power: int) -> None:
    """Of many sizes; keys spread out, and nearly all in one bucket; by one thread and by several."""
    values = (np.random.default_rng(0).random(n) ** power * 2.0**n_bits).astype(np.uint64)
    keys = values << np.uint64(20) | np.arange(n, dtype=np.uint64)
    np.testing.assert_array_equal(sorted_keys(keys.copy(), 20, n_bits), np.sort(keys))
    with alone():
        np.testing.assert_array_equal(sorted_keys(keys.copy(), 20, n_bits), np.sort(keys))
