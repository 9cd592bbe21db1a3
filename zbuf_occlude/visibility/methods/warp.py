"""`warp`: exact ray caster with NVIDIA Warp, on the CPU and, untested, on CUDA."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import check_fraction
from zbuf_occlude.engines.warp import DeviceBvh, find_device
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import CONTACT, FirstHits, VisibilityQuery


def prepare(mesh: Mesh, *, contact: float = CONTACT, device: str = "auto") -> "Warp":
    """Prepare a mesh on a device.

    Parameters
    ----------
    mesh : Mesh
    contact : float
        Contact tolerance as a fraction of the mesh's diagonal.
    device : str
        "cpu", "cuda", "cuda:1"; "auto" is the first CUDA device, or else the CPU.

    Raises
    ------
    OptionError
        `contact` is out of range, or there is no such device.
    """
    check_fraction("contact", contact)
    return Warp(mesh, contact, find_device(device))


class Warp(VisibilityQuery):
    """BVH of float32 boxes that selects faces; float64 tests them, and `exact` decides doubtful lines."""

    def __init__(self, mesh: Mesh, contact: float, device: wp.Device) -> None:
        super().__init__(mesh)
        self._contact, self._device = contact, device
        self._bvh = DeviceBvh(self._vectors(mesh.corners.reshape(-1, 3)), self._vectors(mesh.bounds))

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        own = wp.array(points.face_ids, dtype=wp.int32, device=self._device)
        mask = wp.empty((len(eyes), len(points)), dtype=wp.uint8, device=self._device)
        self._bvh.fill_visible(self._vectors(points.positions), own, self._vectors(eyes), self._contact, mask)
        return np.array(mask.numpy()).view(bool)

    def _first_hits(self, origins: FloatArray, directions: FloatArray) -> FirstHits:
        face_ids = wp.empty(len(directions), dtype=wp.int32, device=self._device)
        distances = wp.empty(len(directions), dtype=wp.float64, device=self._device)
        self._bvh.fill_first_hits(self._vectors(origins), self._vectors(directions), face_ids, distances)
        return FirstHits(np.array(face_ids.numpy()), np.array(distances.numpy()))

    def _vectors(self, values: NDArray[Any]) -> wp.array:
        return wp.array(values, dtype=wp.vec3d, device=self._device)

    def _release(self) -> None:
        del self._bvh
