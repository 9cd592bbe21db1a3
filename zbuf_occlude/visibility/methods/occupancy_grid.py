"""`occupancy_grid`: occlusion of grid cells instead of points (paper 3.6, third suggestion)."""

import numpy as np

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import check_int
from zbuf_occlude.engines.object_space.occupancy import RUN, TOUCHING, OccupancyGrid
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints, sample_surface
from zbuf_occlude.visibility.interface import VisibilityQuery, check_count

MAX_SIDE_CELLS = 512
"""Maximum cells along a side: the grid then takes 128 MiB, and 512 MiB during a query."""


def prepare(
    mesh: Mesh, *, n: int = 32, n_samples: int = 100_000, seed: int = 0, touching: int = TOUCHING, run: int = RUN
) -> "OccupancyGridOccluder":
    """Convert a mesh into an occupancy grid.

    Parameters
    ----------
    mesh : Mesh
    n : int
        Cells along a side of the grid; the paper uses 32 and 64.
    n_samples : int
        Number of points sampled on the mesh; a cell that contains one is occupied. The paper's Fig. 7 uses 1e5. Too few
        for a fine grid leave holes.
    seed : int
        Seed of that sampling.
    touching, run : int
        Extent of a cell's own surface, as in `OccupancyGrid`. The paper does not define it; docs/object_space.md lists
        measured choices.

    Raises
    ------
    OptionError
        A value is out of range.
    """
    check_count("n", n, 2, MAX_SIDE_CELLS, "cells along a side")
    check_int("n_samples", n_samples, 1)
    check_int("seed", seed, 0)
    check_int("touching", touching, 0)
    check_int("run", run, 0)
    positions = sample_surface(mesh, n_points=int(n_samples), seed=seed).positions
    return OccupancyGridOccluder(mesh, OccupancyGrid(mesh.bounds, int(n), positions, touching=touching, run=run))


class OccupancyGridOccluder(VisibilityQuery):
    """One line of sight from each cell that contains a point in question; a point takes its cell's answer.

    Attributes
    ----------
    grid : OccupancyGrid
        Its documentation defines when a cell occludes a cell.
    n_lines : int
        Number of lines of sight that the latest `visible` followed from each eye.

    Notes
    -----
    Far from exact: a quarter to a third of all answers are wrong at n = 32 on furniture (docs/object_space.md).
    Nothing thinner than a cell is resolved (both sides of a thin plate share their cells' answers), and a surface seen
    at a grazing angle partly hides itself.

    A point outside the grid, which is never on the mesh, has its own line of sight.

    The grid is made once per mesh, O(n_samples). A view costs O(cells n + points), with at most as many cells as are
    occupied, whatever the number of points. All cores share the cells.

    References
    ----------
    Paper section 3.6, Fig. 7, Table 1B.
    """

    def __init__(self, mesh: Mesh, grid: OccupancyGrid) -> None:
        super().__init__(mesh)
        self.grid = grid
        self.n_lines = 0

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        grid = self.grid
        outside = np.flatnonzero(~grid.contains(points.positions))
        cells, which = grid.distinct_cells(points.positions)
        which[outside] = len(cells) + np.arange(len(outside))
        self.n_lines = len(cells) + len(outside)
        answer = np.empty((len(eyes), len(points)), dtype=bool)
        for row, eye in zip(answer, eyes, strict=True):
            occluded = np.concatenate(
                [grid.occluded_cells(cells, eye), grid.occluded_positions(points.positions[outside], eye)]
            )
            np.take(~occluded, which, out=row)
        return answer
