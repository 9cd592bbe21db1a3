"""`occupancy_grid`: occluded cells of a grid instead of occluded points (paper 3.6, third suggestion)."""

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.errors import check_int
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints, sample_surface
from zbuf_occlude.object_space.occupancy import RUN, TOUCHING, OccupancyGrid
from zbuf_occlude.visibility.interface import VisibilityQuery, check_count

LARGEST = 512
"""The finest grid: 128 MiB of cells, and 512 MiB while points are asked."""


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
        How many points are sampled on the mesh; the cells that contain one are occupied. 1e5 as in the paper's Fig. 7.
        Too few for a fine grid leave holes.
    seed : int
        Of that sampling.
    touching, run : int
        What is a cell's own surface, as in `OccupancyGrid`: the paper does not say, docs/object_space.md has what was
        tried.

    Raises
    ------
    OptionError
        A value is out of range.
    """
    check_count("n", n, 2, LARGEST, "cells along a side")
    check_int("n_samples", n_samples, 1)
    check_int("seed", seed, 0)
    check_int("touching", touching, 0)
    check_int("run", run, 0)
    positions = sample_surface(mesh, n_points=int(n_samples), seed=seed).positions
    return OccupancyGridOccluder(mesh, OccupancyGrid(mesh.bounds, int(n), positions, touching=touching, run=run))


class OccupancyGridOccluder(VisibilityQuery):
    """One line of sight from each cell that holds an asked point; a point takes its cell's answer.

    Attributes
    ----------
    grid : OccupancyGrid
        With the definition of when a cell occludes a cell.
    n_lines : int
        How many lines of sight the latest `visible` walked from each eye.

    Notes
    -----
    Not exact, and by far: a quarter to a third of all answers are wrong at n = 32 on furniture (docs/object_space.md).
    Nothing thinner than a cell is resolved (both sides of a thin plate share their cells' answers), and some of
    what is seen at a grazing angle is hidden by its own surface.

    A point outside the grid, which no point on the mesh is, walks a line of its own.

    The grid is made once per mesh, O(n_samples); a view costs O(cells n + points), where the cells are at most the
    occupied ones, however many the points are. All cores share the cells, as in `oracle`.

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
