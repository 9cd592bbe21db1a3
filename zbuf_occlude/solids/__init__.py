"""Solids: closed surfaces that do not cross themselves, of which an eye outside never sees the inner side."""

from zbuf_occlude.mesh import Mesh
from zbuf_occlude.solids.buried import find_buried
from zbuf_occlude.solids.clear import Clearance, find_clearance
from zbuf_occlude.solids.closed import ClosedSurfaces, closed_surfaces
from zbuf_occlude.solids.crossing import crossing_surfaces
from zbuf_occlude.solids.near import NearFaces, near_faces

__all__ = [
    "Clearance",
    "ClosedSurfaces",
    "NearFaces",
    "closed_surfaces",
    "find_buried",
    "find_clearance",
    "find_solids",
    "near_faces",
]


def find_solids(mesh: Mesh, reach: float = 0.0) -> tuple[ClosedSurfaces, NearFaces]:
    """Find the closed surfaces that bound solids, and which of their faces come nearer than `reach` to each other.

    Parameters
    ----------
    mesh : Mesh
    reach : float
        As a fraction of the mesh's diagonal.

    Returns
    -------
    ClosedSurfaces
        Without those that cross or touch themselves.
    NearFaces

    Notes
    -----
    Some 3 microseconds a face on two cores.
    """
    closed = closed_surfaces(mesh)
    near = near_faces(mesh, closed, reach)
    return closed.without(crossing_surfaces(closed, near)), near
