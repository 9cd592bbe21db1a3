"""Lines of sight by NVIDIA Warp on its device, as `gpu.py` measures them: this package's on tensors, and plain rays."""

import torch
import warp as wp

import zbuf_occlude as zo
from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.engines.warp import find_device
from zbuf_occlude.visibility.interface import CONTACT

Vectors = wp.array(dtype=wp.vec3)


@wp.kernel
def fill_by_warp(
    mesh: wp.uint64, tau: float, points: Vectors, eyes: Vectors, visible: wp.array2d(dtype=wp.bool)
) -> None:
    """Fill in which points eyes see as a user of Warp would: one ray a point, in float32."""
    k, i = wp.tid()
    distance = wp.length(eyes[k] - points[i])
    towards = (eyes[k] - points[i]) / distance
    hit = wp.mesh_query_ray(mesh, points[i] + tau * towards, towards, distance - tau)
    visible[k, i] = not hit.result


class Float32Rays:
    """Warp's own `mesh_query_ray`: rays start a contact tolerance before each point and know no own face."""

    def __init__(self, mesh: zo.Mesh) -> None:
        self.device, self.tau = find_device("auto"), CONTACT * mesh.diagonal
        indices = wp.array(mesh.faces.reshape(-1), dtype=wp.int32, device=self.device)
        self.mesh = wp.Mesh(wp.array(mesh.vertices, dtype=wp.vec3, device=self.device), indices)
        self._points: tuple[zo.SurfacePoints, wp.array] | None = None

    def visible(self, points: zo.SurfacePoints, eyes: FloatArray) -> BoolArray:
        """Return the mask (k, n), copied to the host as `visible` of a method is."""
        if self._points is None or self._points[0] is not points:
            self._points = points, wp.array(points.positions, dtype=wp.vec3, device=self.device)
        mask = wp.empty((len(eyes), len(points)), dtype=wp.bool, device=self.device)
        stands = wp.array(eyes, dtype=wp.vec3, device=self.device)
        inputs = [self.mesh.id, self.tau, self._points[1], stands, mask]
        wp.launch(fill_by_warp, dim=mask.shape, inputs=inputs, device=self.device)
        return mask.numpy()


class Tensors:
    """Tensors of float64 on Warp's device, answered by `zo.torch.visible`; the mask stays there."""

    def __init__(self, mesh: zo.Mesh) -> None:
        self.device = torch.device(str(find_device("auto")))
        self.mesh = self._tensors(mesh.vertices, mesh.faces)
        self._points: tuple[zo.SurfacePoints, list[torch.Tensor]] | None = None

    def visible(self, points: zo.SurfacePoints, eyes: FloatArray) -> torch.Tensor:
        """Return the mask (k, n) once the device is done."""
        if self._points is None or self._points[0] is not points:
            self._points = points, self._tensors(points.positions, points.face_ids)
        mask = zo.torch.visible(*self.mesh, *self._points[1], *self._tensors(eyes))
        if self.device.type == "cuda":
            torch.cuda.synchronize(self.device)
        return mask

    def _tensors(self, *arrays: FloatArray) -> list[torch.Tensor]:
        return [torch.tensor(each, device=self.device) for each in arrays]
