"""`hidden_point_removal`: Katz et al. 2007 through Open3D, what many users do today. It never looks at the faces."""

from importlib import import_module

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.errors import OptionError
from zbuf_occlude.extras import importing
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import VisibilityQuery

GROWTH = 200.0
"""Radius by default, per squared distance of the farthest point, all in diagonals. What one point hides behind it
begins at a depth of about radius * spacing^2 / distance^2, so this keeps it the same from near and far. Of 30, 100,
300, 1000 the best values on six ModelNet meshes were 100, 300 and 1000 at 2,000, 10,000 and 40,000 points (0.79, 0.85
and 0.89 of the answers right); no one value suits all densities."""

AT_THE_EYE = 1e-150
"""Distance in diagonals within which a point is where the eye is. Its square is 0, and Open3D 0.20 divides by it: the
process ends by a segmentation fault, or all points of the view are taken for visible."""


def prepare(mesh: Mesh, *, radius: float | None = None) -> "HiddenPointRemoval":
    """Make ready to remove hidden points by spherical flipping and a convex hull.

    Parameters
    ----------
    mesh : Mesh
        Only its diagonal is used.
    radius : float, optional
        Radius of the flipping sphere in diagonals of the mesh's bounding box (Open3D's tutorial takes 100). Larger
        keeps more points: visible ones are lost when it is small, hidden ones kept when it is large. By default
        `GROWTH` times the square of the distance to the farthest point, for each eye.

    Raises
    ------
    OptionError
        `radius` is out of range.
    UnavailableError
        Open3D cannot be imported.
    """
    if radius is not None and not (np.isfinite(radius) and radius > 0.0):
        raise OptionError(f"radius must be positive and finite, in diagonals of the mesh; got {radius}.")
    return HiddenPointRemoval(mesh, radius)


class HiddenPointRemoval(VisibilityQuery):
    """The points that lie on the convex hull of the flipped cloud and the eye are visible.

    Notes
    -----
    Not exact: the answer for a point depends on what other points are asked with it, and a thin cloud hides nothing.
    Fewer than three points, or points that all lie in one plane with the eye, have no hull in space; all of them are
    then taken for visible, as are points at the eye itself. The sphere is never smaller than the farthest point's
    distance.

    O(n log n) a view, on one core.

    References
    ----------
    S. Katz, A. Tal, R. Basri: Direct visibility of point sets. ACM Transactions on Graphics 26(3), 2007.
    doi:10.1145/1276377.1276407. Open3D's ``PointCloud.hidden_point_removal``.
    """

    def __init__(self, mesh: Mesh, radius: float | None) -> None:
        super().__init__(mesh)
        self._radius = radius
        self._unit = mesh.diagonal if mesh.diagonal > 0.0 else 1.0
        with importing("open3d", "method 'hidden_point_removal'"):  # late: the table must be listed without it
            self._open3d = import_module("open3d")
            _ = self._open3d.geometry  # an empty package is imported too

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        answer = np.zeros((len(eyes), len(points)), dtype=bool)
        for row, eye in zip(answer, eyes, strict=True):
            # in diagonals and with the eye at the origin, neither scale nor place matters
            relative = (points.positions - eye) / self._unit
            distances = np.linalg.norm(relative, axis=1)
            apart = np.flatnonzero(distances > AT_THE_EYE)
            row[distances <= AT_THE_EYE] = True
            if len(apart) == 0:
                continue
            farthest = float(distances.max())
            radius = max(GROWTH * farthest**2 if self._radius is None else self._radius, farthest)
            cloud = self._open3d.geometry.PointCloud(self._open3d.utility.Vector3dVector(relative[apart]))
            try:
                _, kept = cloud.hidden_point_removal(np.zeros(3), radius)
            except RuntimeError as error:
                if not str(error).startswith("QH"):
                    raise
                row[:] = True  # Qhull found no hull in space
            else:
                row[apart[np.asarray(kept, dtype=np.intp)]] = True
        return answer
