"""`exact_hsr`: the paper's exact HSR (section 3.5), every point against all faces by the paper's formulas."""

import numpy as np

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import check_choice, check_fraction, check_int
from zbuf_occlude.engines.object_space.distances import Distances, PlaneDistances, SampleDistances
from zbuf_occlude.engines.object_space.exhaustive import NO_DISTANCES, hidden_points
from zbuf_occlude.engines.object_space.planes import FacePlanes
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import CONTACT, VisibilityQuery

CULLS = ("none", "first", "second")


def prepare(
    mesh: Mesh, *, cull: str = "none", n_samples: int = 10_000, seed: int = 0, contact: float = CONTACT
) -> "ExactHsr":
    """Prepare a mesh for the paper's exact HSR.

    Parameters
    ----------
    mesh : Mesh
    cull : {"none", "first", "second"}
        Suggestion of section 3.6 that excludes far faces: by the distance of their planes, or of points sampled on
        them. "second" is faster and no longer exact.
    n_samples : int
        Approximate number of points sampled on the mesh for "second"; every face gets at least one.
    seed : int
        Seed of that sampling.
    contact : float
        Contact tolerance as a fraction of the mesh's diagonal.

    Raises
    ------
    OptionError
        A value is out of range.
    """
    check_choice("cull", cull, CULLS)
    check_int("n_samples", n_samples, 1)
    check_int("seed", seed, 0)
    check_fraction("contact", contact)
    return ExactHsr(mesh, cull, n_samples, seed, contact)


class ExactHsr(VisibilityQuery):
    """Exhaustive search over the faces for each point, stopping at the first face that occludes it.

    Attributes
    ----------
    n_tests : (k,) int64
        Number of pairs of point and face that the latest `visible` tested from each eye (`hidden_points`).

    Notes
    -----
    With ``cull="none"`` and ``cull="first"`` the answers equal those of `oracle` outside the boundary band, by another
    formulation in float64: a line may leak within rounding of an edge or corner. With ``cull="second"`` a hidden point
    is taken for visible if the nearest sample of the hiding face is farther than the point
    (`zbuf_occlude.engines.object_space.distances`).

    O(k n f) time, as in the paper; all cores share the points. The rounding bounds of
    `zbuf_occlude.engines.object_space.planes` grow with the thinness of a face: a sliver thinner than 1e-10 of its
    length may hide points farther from it than the boundary band is wide.

    References
    ----------
    Paper sections 3.5, 3.6; Eq. 1-3, 5-10.
    """

    def __init__(self, mesh: Mesh, cull: str, n_samples: int, seed: int, contact: float) -> None:
        super().__init__(mesh)
        self._contact = contact * mesh.diagonal
        self._planes = FacePlanes.from_mesh(mesh)
        self._face_labels = np.arange(len(mesh.faces), dtype=np.int32)[:, None]
        self._distances: Distances | None = None
        if cull == "first":
            self._distances = PlaneDistances(self._planes)
        elif cull == "second":
            self._distances = SampleDistances(mesh, n_samples, seed)
        self.n_tests = np.zeros(0, dtype=np.int64)

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        answer = np.empty((len(eyes), len(points)), dtype=bool)
        n_tests = np.zeros(len(eyes), dtype=np.int64)
        for j, eye in enumerate(eyes):
            distances = NO_DISTANCES if self._distances is None else self._distances.from_eye(eye)
            hidden, n_tests[j] = hidden_points(
                self._planes, self._face_labels, points.positions, points.face_ids, eye, self._contact, distances
            )
            answer[j] = ~hidden
        self.n_tests = n_tests  # assigned once, since several threads may use this query
        return answer
