"""`hidden_point_removal`: the method of Katz et al. 2007 through Open3D. It does not use the faces."""

from importlib import import_module

import numpy as np

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.base.extras import importing
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import VisibilityQuery

GROWTH = 200.0
"""Default radius per squared distance of the farthest point, all in diagonals. A point hides others from a depth of
about radius * spacing^2 / distance^2 behind it, so this factor makes that depth independent of the distance. Among 30,
100, 300 and 1000 the best values on six ModelNet meshes were 100, 300 and 1000 at 2,000, 10,000 and 40,000 points (79,
85 and 89 % correct answers); no single value suits all densities."""

MIN_DISTANCE = 1e-150
"""Distance, in diagonals, up to which a point counts as being at the eye. Its square is 0, by which Open3D 0.20
divides: the process ends with a segmentation fault, or all points of the view count as visible."""


def prepare(mesh: Mesh, *, radius: float | None = None) -> "HiddenPointRemoval":
    """Prepare hidden point removal by spherical flipping and a convex hull.

    Parameters
    ----------
    mesh : Mesh
        Only its diagonal is used.
    radius : float, optional
        Radius of the flipping sphere in diagonals of the mesh's bounding box (Open3D's tutorial uses 100). A small
        radius loses visible points, a large one keeps hidden points. By default `GROWTH` times the squared distance of
        the farthest point, for each eye.

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
    """Visibility of points as membership in the convex hull of the flipped cloud and the eye.

    Notes
    -----
    Not exact: the answer for a point depends on the other points of the call, and a thin cloud hides nothing. Fewer
    than three points, or points in one plane with the eye, have no hull in space and are all taken for visible, as are
    points at the eye. The radius of the sphere is at least the distance of the farthest point.

    O(n log n) per view, on one core.

    References
    ----------
    S. Katz, A. Tal, R. Basri: Direct visibility of point sets. ACM Transactions on Graphics 26(3), 2007.
    doi:10.1145/1276377.1276407. Open3D's ``PointCloud.hidden_point_removal``.
    """

    def __init__(self, mesh: Mesh, radius: float | None) -> None:
        super().__init__(mesh)
        self._radius = radius
        self._unit = mesh.diagonal if mesh.diagonal > 0.0 else 1.0
        with importing("open3d", "method 'hidden_point_removal'"):  # late: listing the table must not need it
            self._open3d = import_module("open3d")
            _ = self._open3d.geometry  # fails for an empty package, which can be imported

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        answer = np.zeros((len(eyes), len(points)), dtype=bool)
        for row, eye in zip(answer, eyes, strict=True):
            # in diagonals and relative to the eye, so that neither scale nor position matters
            relative = (points.positions - eye) / self._unit
            distances = np.linalg.norm(relative, axis=1)
            apart = np.flatnonzero(distances > MIN_DISTANCE)
            row[distances <= MIN_DISTANCE] = True
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
