"""Planes of the faces, and the paper's test whether a face intersects a line of sight (sections 3.1 and 3.3)."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.geometry.mesh import Mesh

ROUNDING = 8.0 * float(np.finfo(np.float64).eps)
"""Bound on the rounding error of the formulas below, relative to the product of their lengths."""


@dataclass(frozen=True, eq=False)
class FacePlanes:
    """Plane equations of all faces, computed once per mesh (paper 3.4: "only once as a preprocessing stage").

    Positions must be relative to `origin`.

    Parameters
    ----------
    origin : (3,) float
        World-space centre of the mesh's bounding box. Relative to it d in Eq. 3 is of the mesh's size; far from the
        world's origin ``d + n . p`` would suffer cancellation.
    planes : (f, 5) float
        n, d of Eq. 1-3 and the length scale ``|v1| |v2|`` to which the rounding errors of both are relative.
    sides : (f, 3, 4) float
        n_i, d_i of Eq. 8-9: the planes through the three edges, perpendicular to the face, positive inside.
    edges : (f, 3) float
        Lengths of the three edges v_i.
    """

    origin: FloatArray
    planes: FloatArray
    sides: FloatArray
    edges: FloatArray

    @classmethod
    def from_mesh(cls, mesh: Mesh) -> "FacePlanes":
        """Compute the equations of all faces of a mesh.

        References
        ----------
        Paper Eq. 1-3, 8-9. Departure: v1, v2, v3 are the *consecutive* edges b - a, c - b, a - c. With Eq. 1's
        v2 = c - a the perpendicular planes of Eq. 8-9 would not be those of the face's edges. The normal is the same.
        """
        corners = mesh.corners - mesh.centre
        edges = np.roll(corners, -1, axis=1) - corners  # v1, v2, v3
        lengths = np.linalg.norm(edges, axis=2)
        normals = np.cross(edges[:, 0], edges[:, 1])  # Eq. 1
        d = -np.einsum("fx,fx->f", corners[:, 0], normals)  # Eq. 3
        planes = np.concatenate([normals, d[:, None], (lengths[:, 0] * lengths[:, 1])[:, None]], axis=1)
        side_normals = np.cross(normals[:, None], edges)  # Eq. 8
        side_d = -np.einsum("fix,fix->fi", corners, side_normals)  # Eq. 9
        sides = np.concatenate([side_normals, side_d[:, :, None]], axis=2)
        return cls(np.asarray(mesh.centre), planes, sides, lengths)

    def __len__(self) -> int:
        return len(self.planes)


@njit
def occludes(p, u, from_origin, length, planes, sides, edges, face, contact):  # type: ignore[no-untyped-def]
    """Return whether a face intersects the line of sight from a point to the eye farther than `contact` from the point.

    Parameters
    ----------
    p : tuple of 3 float64
        Point, relative to `FacePlanes.origin`.
    u : tuple of 3 float64
        Vector from the point to the eye: p + u is the eye (Eq. 5 with q = eye).
    from_origin, length : float
        ``|p|`` and ``|u|``.
    planes, sides, edges : float64
        Arrays of `FacePlanes`.
    face : int
    contact : float
        Contact tolerance tau, world units.

    Returns
    -------
    bool

    Notes
    -----
    The comparisons ``n . u != 0`` (Eq. 6) and ``val_i >= 0`` (Eq. 10) allow for the rounding error of their operands.
    Without this, a line through an edge that two faces share could pass between both, and a line within a face's plane
    would meet it anywhere.

    References
    ----------
    Paper Eq. 2-3, 5-10. Departures: the contact tolerance, and the rounding bounds.
    """
    # arrays are indexed by face, because taking the face's rows would cost more than the test
    n_u = planes[face, 0] * u[0] + planes[face, 1] * u[1] + planes[face, 2] * u[2]
    if abs(n_u) <= ROUNDING * planes[face, 4] * length:
        return False  # the line is parallel to the plane: Eq. 6 has no solution
    n_p = planes[face, 0] * p[0] + planes[face, 1] * p[1] + planes[face, 2] * p[2]
    t = -(planes[face, 3] + n_p) / n_u  # Eq. 6
    if not (t * length > contact and t < 1.0):
        return False  # not between the point and the camera
    error = ROUNDING * planes[face, 4] * (from_origin + t * length)
    s = (p[0] + t * u[0], p[1] + t * u[1], p[2] + t * u[2])  # Eq. 7
    for i in range(3):
        n_i = (sides[face, i, 0], sides[face, i, 1], sides[face, i, 2])
        value = s[0] * n_i[0] + s[1] * n_i[1] + s[2] * n_i[2] + sides[face, i, 3]  # Eq. 10
        if value < 0.0:
            n_i_u = n_i[0] * u[0] + n_i[1] * u[1] + n_i[2] * u[2]
            if value < -error * (edges[face, i] + abs(n_i_u / n_u)):
                return False
    return True
