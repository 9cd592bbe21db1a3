"""The Hilbert curve: visits every cell once and never jumps."""

import itertools

import numpy as np

from zbuf_occlude.geometry.hilbert import hilbert_order


def test_consecutive_cells_are_neighbours() -> None:
    """A 16^3 grid: a permutation, whose every step is one cell along one axis (Morton order's longest is 15 + 15)."""
    cells = np.array(list(itertools.product(range(16), repeat=3)), dtype=np.float64)
    order = hilbert_order(cells * 0.3 - 7.0)
    assert np.array_equal(np.sort(order), np.arange(len(cells)))
    assert (np.abs(np.diff(cells[order], axis=0)).sum(axis=1) == 1).all()


def test_one_cell_keeps_its_order() -> None:
    assert hilbert_order(np.zeros((5, 3))).tolist() == [0, 1, 2, 3, 4]
