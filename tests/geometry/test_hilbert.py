"""The Hilbert curve: visits every cell once and never jumps."""

import itertools

import numpy as np
import pytest

from zbuf_occlude.geometry.hilbert import hilbert_order, sorted_keys


def test_consecutive_cells_are_neighbours() -> None:
    """A 16^3 grid: a permutation, whose every step is one cell along one axis (Morton order's longest is 15 + 15)."""
    cells = np.array(list(itertools.product(range(16), repeat=3)), dtype=np.float64)
    order = hilbert_order(cells * 0.3 - 7.0)
    assert np.array_equal(np.sort(order), np.arange(len(cells)))
    assert (np.abs(np.diff(cells[order], axis=0)).sum(axis=1) == 1).all()


def test_one_cell_keeps_its_order() -> None:
    assert hilbert_order(np.zeros((5, 3))).tolist() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("n", [0, 1, 2, 5000])
@pytest.mark.parametrize("n_bits", [1, 30, 50])
def test_keys_are_sorted_as_numpy_does(n: int, n_bits: int) -> None:
    """Fields of any width, some digits all the same, some keys many times, above an index that ascends."""
    places = np.random.default_rng(n_bits).integers(0, 1 << n_bits, n).astype(np.uint64)
    for shared in (0, (1 << n_bits) - 1, 0b1111 << 11):
        keys = ((places & ~np.uint64(shared)) << np.uint64(13)) | np.arange(n, dtype=np.uint64)
        keys[n // 2 :] |= np.uint64(((1 << n_bits) - 1) << 13)
        assert np.array_equal(sorted_keys(keys.copy(), 13, n_bits), np.sort(keys))
