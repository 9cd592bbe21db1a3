"""The grid: which cells are occupied, and the walk against a slow one that lists the cells of a line by other means."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zbuf_occlude.engines.object_space.occupancy import RUN, OccupancyGrid

CUBE = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])


def grid_with(n: int, cells: list[tuple[int, int, int]]) -> OccupancyGrid:
    """A grid over the unit cube with these cells occupied."""
    return OccupancyGrid(CUBE, n, (np.asarray(cells).reshape(-1, 3) + 0.5) / n)


def occluded(grid: OccupancyGrid, cell: tuple[int, int, int], eye: object) -> bool:
    return bool(grid.occluded_cells(np.array([cell], dtype=np.int32), np.asarray(eye, dtype=np.float64))[0])


def test_cells_of_positions() -> None:
    grid = OccupancyGrid(np.array([[0.0, 0, 0], [4, 2, 1]]), 4, np.array([[0.5, 0.5, 0.5]]))
    # the grid is the cube of side 4 about the box's centre (2, 1, 0.5)
    assert grid.cells_of(np.array([[0.0, 0, 0], [4, 2, 1], [2, 1, 0.5], [1.99, 0.99, 0.49]])).tolist() == [
        [0, 1, 1],
        [3, 3, 2],
        [2, 2, 2],
        [1, 1, 1],
    ]
    assert grid.occupied.sum() == 1
    assert grid.contains(np.array([[4.0, 3, 2.5], [4.01, 1, 1], [0, -1, -1.5]])).tolist() == [True, False, True]


def test_distinct_cells() -> None:
    grid = grid_with(4, [])
    positions = np.random.default_rng(0).random((500, 3)) ** 3
    cells, which = grid.distinct_cells(positions)
    assert (cells[which] == grid.cells_of(positions)).all()
    assert len(np.unique(cells, axis=0)) == len(cells) == len(np.unique(grid.cells_of(positions), axis=0)) < 64


def test_an_occupied_cell_on_the_line_occludes() -> None:
    eye = (10.0, 0.55, 0.55)
    for own in ([], [(2, 5, 5)]):  # whether the cell itself is occupied does not matter
        assert occluded(grid_with(10, [*own, (7, 5, 5)]), (2, 5, 5), eye)
        assert not occluded(grid_with(10, [*own, (7, 6, 5)]), (2, 5, 5), eye)
        assert not occluded(grid_with(10, [*own, (0, 5, 5)]), (2, 5, 5), eye)


def test_cells_that_touch_do_not_occlude() -> None:
    ahead = (10.0, 0.55, 0.55)
    assert not occluded(grid_with(10, [(3, 5, 5)]), (2, 5, 5), ahead)
    assert occluded(grid_with(10, [(4, 5, 5)]), (2, 5, 5), ahead)
    askew = (10.55, 10.55, 10.55)  # through the corner that (5, 5, 5) and (6, 6, 6) share
    assert not occluded(grid_with(10, [(6, 6, 6)]), (5, 5, 5), askew)
    assert occluded(grid_with(10, [(7, 7, 7)]), (5, 5, 5), askew)


def test_an_unbroken_run_is_the_own_surface_for_three_cells() -> None:
    ahead = (10.0, 0.55, 0.55)
    run = [(x, 5, 5) for x in range(2, 10)]
    assert not occluded(grid_with(10, run[: RUN + 1]), (2, 5, 5), ahead)
    assert occluded(grid_with(10, run[: RUN + 2]), (2, 5, 5), ahead)
    assert occluded(grid_with(10, [run[0], run[1], run[3]]), (2, 5, 5), ahead)  # broken at run[2]


@pytest.mark.parametrize(("touching", "run"), [(1, 1), (2, 4), (3, 3), (0, 2)])
def test_the_own_surface_can_be_chosen(touching: int, run: int) -> None:
    """A cell that stands alone occludes from touching + 1 cells away, the end of a run from run + 1."""
    ahead = (10.0, 0.55, 0.55)

    def nearest(run_of: bool) -> int:
        for apart in range(2, 8):
            xs = range(2, 3 + apart) if run_of else (2, 2 + apart)
            positions = (np.array([(x, 5, 5) for x in xs]) + 0.5) / 10
            if occluded(OccupancyGrid(CUBE, 10, positions, touching=touching, run=run), (2, 5, 5), ahead):
                return apart
        raise AssertionError("nothing occludes")

    assert nearest(run_of=False) == max(touching + 1, 2)
    assert nearest(run_of=True) == max(run + 1, 2)


def test_the_eyes_own_cell_does_not_count_nor_what_is_behind_it() -> None:
    grid = grid_with(10, [(2, 5, 5), (6, 5, 5), (8, 5, 5)])
    assert not occluded(grid, (2, 5, 5), (0.65, 0.55, 0.55))
    assert not occluded(grid, (2, 5, 5), (0.59, 0.55, 0.55))
    assert occluded(grid, (2, 5, 5), (0.71, 0.55, 0.55))


def test_positions_outside_walk_their_own_line() -> None:
    grid = grid_with(10, [(0, 5, 5)])
    eye = np.array([10.0, 0.55, 0.55])
    outside = np.array([[-3.0, 0.55, 0.55], [-3.0, 0.75, 0.55], [20.0, 0.55, 0.55], [-3.0, 5.0, 0.55]])
    assert grid.occluded_positions(outside, eye).tolist() == [True, False, False, False]


def test_a_flat_object_is_one_cell_thick() -> None:
    flat = OccupancyGrid(
        np.array([[0.0, 0, 0], [1, 1, 0]]), 8, np.random.default_rng(0).random((10_000, 3)) * [1, 1, 0]
    )
    assert flat.occupied.sum() == 64
    assert flat.occupied.any(axis=(0, 1)).sum() == 1


def slow_walk(grid: OccupancyGrid, start: np.ndarray, eye: np.ndarray) -> bool:
    """The definition again: cut the line at all cell walls and look at the middle of each piece."""
    d = eye - start
    walls = np.arange(grid.n + 1)
    cuts = [(walls - start[a]) / d[a] for a in range(3) if d[a] != 0]
    t = np.unique(np.clip(np.concatenate([*cuts, [0.0, 1.0]]), 0.0, 1.0))
    t = t[np.append(True, np.diff(t) > 1e-12)]
    cells = np.floor(start + ((t[1:] + t[:-1]) / 2)[:, None] * d).astype(int)
    unbroken = True
    for cell in cells:
        apart = np.abs(cell - np.floor(start)).max()
        in_grid = ((cell >= 0) & (cell < grid.n)).all()
        if (cell == np.floor(eye)).all():
            return False
        if in_grid and grid.occupied[tuple(cell)]:
            if apart > (RUN if unbroken else 1):
                return True
        elif in_grid and apart > 0:
            unbroken = False
    return False


@settings(max_examples=100)
@given(
    seed=st.integers(0, 10**6), n=st.integers(2, 9), share=st.floats(0.02, 0.6), far=st.sampled_from([0.3, 1.0, 5.0])
)
def test_the_walk_visits_the_cells_of_the_line(seed: int, n: int, share: float, far: float) -> None:
    rng = np.random.default_rng(seed)
    grid = grid_with(n, [])
    grid.occupied[:] = rng.random((n, n, n)) < share
    eye = 0.5 + rng.normal(size=3) * far
    in_cells = np.round(eye * n * 2.0**20) / 2.0**20
    cells = rng.integers(0, n, (20, 3)).astype(np.int32)
    assert grid.occluded_cells(cells, eye).tolist() == [slow_walk(grid, c + 0.5, in_cells) for c in cells]
    outside = rng.normal(size=(20, 3)) * 3 + 0.5
    outside = outside[~grid.contains(outside)]
    expected = [slow_walk(grid, np.round(p * n * 2.0**20) / 2.0**20, in_cells) for p in outside]
    assert grid.occluded_positions(outside, eye).tolist() == expected


@pytest.mark.parametrize("scale", [1e-3, 1e3, 3.0])
def test_cells_do_not_change_with_scale_even_on_their_walls(scale: float) -> None:
    rng = np.random.default_rng(0)
    positions = np.round(rng.random((2000, 3)) * 8) / 8  # all on walls of the cells
    one, other = OccupancyGrid(CUBE, 8, positions), OccupancyGrid(CUBE * scale, 8, positions * scale)
    assert (one.occupied == other.occupied).all()
    cells = np.argwhere(one.occupied).astype(np.int32)
    for eye in ([3.0, 3.0, 3.0], [0.5, 0.5, 4.0], [2.0, -1.0, 0.5]):
        first = one.occluded_cells(cells, np.asarray(eye))
        assert first.any()
        assert (first == other.occluded_cells(cells, np.asarray(eye) * scale)).all()
