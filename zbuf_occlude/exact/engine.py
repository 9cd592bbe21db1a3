"""The flow: a mesh becomes a scene, points become packets, eyes become views, each view is searched; rays are cast."""

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.exact.bvh import make_scene
from zbuf_occlude.exact.points import make_packets
from zbuf_occlude.exact.rays import find_first_hits
from zbuf_occlude.exact.search import find_visible
from zbuf_occlude.exact.view import make_views
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints


class Engine:
    """A prepared mesh.

    Parameters
    ----------
    mesh : Mesh
    contact : float
        The contact tolerance, world units.

    Notes
    -----
    Costs O(f log f) once, then O(n) for each set of points, and for each eye about n log f.
    """

    def __init__(self, mesh: Mesh, contact: float) -> None:
        self._scene = make_scene(mesh, contact)

    def visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        """Answer which of n points each of k eyes sees; (k, n) bool."""
        if len(self._scene.face_ids) == 0:  # no face that could block
            return np.ones((len(eyes), len(points)), dtype=bool)
        packets = make_packets(self._scene, points)
        views = make_views(self._scene, eyes, float(packets.farthest))
        return find_visible(self._scene, packets, views)

    def first_hits(self, origins: FloatArray, directions: FloatArray) -> tuple[IntArray, FloatArray]:
        """Answer which face n rays meet first, (n,) int32, -1 for none, and the eye distance, (n,) float64."""
        return find_first_hits(self._scene, origins, directions)
