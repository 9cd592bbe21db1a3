"""`embree`: ray casting with Intel Embree through embreex, from points to eyes or along given rays."""

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray, unit_vectors
from zbuf_occlude.base.errors import check_fraction
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import CONTACT, FirstHits, VisibilityQuery

LIFT = 5e-7
"""Offset, in longest sides, of a ray that met its own face: above float32's error (about 2e-7) and below the width of
the boundary band (1e-6 diagonals), so that it changes no answer outside the band."""

ATTEMPTS = 12
"""Maximum casts of a ray that meets the face it starts on, or a face it lies in. Each cast starts farther along the
ray, the last one a thousandth of the longest side away."""


def prepare(mesh: Mesh, *, contact: float = CONTACT) -> "Embree":
    """Prepare a mesh for ray casting with Embree.

    Parameters
    ----------
    mesh : Mesh
    contact : float
        Contact tolerance as a fraction of the mesh's diagonal.

    Raises
    ------
    OptionError
        `contact` is out of range.
    """
    check_fraction("contact", contact)
    return Embree(mesh, contact)


class Embree(VisibilityQuery):
    """One ray per point, cast from the contact distance before the point to the eye; the own face does not hide.

    Notes
    -----
    Not exact: Embree computes in float32. The mesh is first centred and scaled to longest side 1 in float64, and rays
    start within the bounding sphere. The error therefore does not grow with the distance of mesh and eye: about 2e-7
    longest sides across the ray, which is inside the boundary band. Errors outside the band come from contacts within
    float32 rounding of `contact` at grazing angles, and from edges that Embree misses even in robust mode. Answers may
    differ between instruction sets.

    A ray starts so near to its own face that rounding makes it meet that face at grazing angles. The face's id reveals
    such a ray. It is cast once more, lifted off the face's plane by `LIFT`; any face but its own that it then meets
    hides the point. Without this, 3e-4 to 6e-4 of all answers are wrong on real meshes.

    First hits come from one cast per ray. Embree names the face; its distance is recomputed in float64. Among equally
    near faces Embree names any, not the lowest.

    Costs O(log f) per ray, on one core: embreex casts one ray after the other and holds the interpreter's lock.
    """

    def __init__(self, mesh: Mesh, contact: float) -> None:
        super().__init__(mesh)
        self._centre = mesh.centre
        self._scale = 1.0 / mesh.longest_side if mesh.longest_side > 0.0 else 1.0
        self._contact = contact * mesh.diagonal * self._scale
        vertices = (mesh.vertices - self._centre) * self._scale
        self._radius = float(np.linalg.norm(vertices[mesh.faces], axis=2).max())
        normals = mesh.face_normals
        self._normals = unit_vectors(normals)
        self._scene = EmbreeScene(robust=True)
        self._corners = vertices[mesh.faces[:, 0]]
        TriangleMesh(self._scene, vertices.astype(np.float32), mesh.faces)

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        positions = (points.positions - self._centre) * self._scale
        answer = np.empty((len(eyes), len(points)), dtype=bool)
        for eye, row in zip((eyes - self._centre) * self._scale, answer, strict=True):
            row[:] = self._seen_from(eye, positions, points.face_ids)
        return answer

    def _first_hits(self, origins: FloatArray, directions: FloatArray) -> FirstHits:
        units = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        starts = np.broadcast_to((origins - self._centre) * self._scale, units.shape)
        # outside the bounding sphere there are no faces, and float32 is coarse
        skipped = np.maximum(-np.einsum("ij,ij->i", starts, units) - self._radius, 0.0)
        face_ids = np.full(len(units), -1, dtype=np.int32)
        distances = np.full(len(units), np.inf)
        asked = np.arange(len(units))
        for attempt in range(ATTEMPTS):
            from_here = starts[asked] + units[asked] * skipped[asked, None]
            found = self._cast(from_here, units[asked], np.full(len(asked), np.inf))
            met = found >= 0
            asked, found, from_here = asked[met], found[met], from_here[met]
            normals = self._normals[found]
            heights = np.einsum("ij,ij->i", self._corners[found] - starts[asked], normals)
            slopes = np.einsum("ij,ij->i", units[asked], normals)
            along = np.divide(heights, slopes, out=np.zeros(len(asked)), where=slopes != 0.0)
            real = along > 0.0  # by rounding a ray may meet the face it starts on, or a face it lies in
            face_ids[asked[real]], distances[asked[real]] = found[real], along[real] / self._scale
            asked = asked[~real]
            skipped[asked] += LIFT * 2**attempt
        return FirstHits(face_ids, distances)

    def _seen_from(self, eye: FloatArray, positions: FloatArray, own: IntArray) -> BoolArray:
        """Return one eye's answers, (n,); eye and positions are in Embree's scaled space."""
        towards = eye - positions
        distance = np.linalg.norm(towards, axis=1)
        towards /= np.maximum(distance, np.finfo(np.float64).tiny)[:, None]
        # a free point may lie far outside, where float32 is coarse: start at the bounding sphere
        to_sphere = -np.einsum("ij,ij->i", positions, towards) - self._radius
        start = np.maximum(to_sphere, self._contact)
        origins = positions + towards * start[:, None]
        hits = self._cast(origins, towards, distance - start)
        visible = hits == -1
        again = np.flatnonzero((hits == own) & ~visible)
        if len(again):
            normals = self._normals[own[again]]
            upwards = np.where(np.einsum("ij,ij->i", normals, towards[again]) < 0.0, -LIFT, LIFT)
            lifted = origins[again] + normals * upwards[:, None]
            hits = self._cast(lifted, towards[again], (distance - start)[again])
            visible[again] = (hits == -1) | (hits == own[again])
        return visible

    def _cast(self, origins: FloatArray, directions: FloatArray, lengths: FloatArray) -> IntArray:
        """Return the nearest face that each ray meets within its length, -1 for none."""
        return np.asarray(
            self._scene.run(origins.astype(np.float32), directions.astype(np.float32), dists=lengths.astype(np.float32))
        )

    def _release(self) -> None:
        del self._scene
