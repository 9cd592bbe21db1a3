"""Objects as the surfaces of voxel grids: all faces lie across an axis, and level ones vanish at elevation 0."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from zbuf_occlude.errors import OptionError
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import sample_surface
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.object_space.occupancy import OccupancyGrid
from zbuf_occlude.origin import Origin
from zbuf_occlude.paper.figures import cells_as_mesh

FINEST = 128
"""Voxels a side, at most: the surface of a finer grid has millions of faces."""
SAMPLES_PER_CELL = 30
"""Of a surface that fills a side of the grid; what is thinner than a voxel is still met."""


def as_voxels(meshes: MeshCollection, n: int) -> MeshCollection:
    """Return the same collection, each mesh replaced by the surface of the voxels that it meets.

    Parameters
    ----------
    meshes : MeshCollection
    n : int
        Voxels along the longest side.

    Returns
    -------
    MeshCollection
        Keys, classes and splits are the same.

    Raises
    ------
    OptionError
        Fewer than 2 voxels, or more than `FINEST`.
    """
    if not 2 <= n <= FINEST:
        raise OptionError(f"voxels must lie in 2..{FINEST}, along the longest side; got {n}.")
    return MeshCollection(
        [
            replace(
                entry,
                load=partial(voxel_surface, entry.load, n),
                path=None,
                up="",
                origin=_origin(entry.origin, n),
            )
            for entry in meshes
        ]
    )


def voxel_surface(load: Callable[[], Mesh], n: int) -> Mesh:
    """Return the surface of the n^3 grid's cells that a mesh's surface meets, its longest side 1."""
    mesh = load().normalized()
    points = sample_surface(mesh, n_points=SAMPLES_PER_CELL * n * n, seed=0)
    surface = cells_as_mesh(OccupancyGrid(mesh.bounds, n, points.positions).occupied).normalized()
    return replace(surface, name=mesh.name, origin=_origin(mesh.origin, n))


def _origin(of: Origin, n: int) -> Origin:
    return Origin.of_recipe("voxels", n, of.sha256) if of.sha256 else of
