"""Engine of `warp` and of tensors (extra ``warp``): exact lines of sight and rays with NVIDIA Warp, on CPU and CUDA.

Measured and tested on the CPU only; CUDA runs the same source and is untested.
"""

import os

import numpy as np
import warp as wp

from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.base.jit.compiler import cache_folder
from zbuf_occlude.engines.exact import Engine
from zbuf_occlude.geometry.mesh import Mesh

# Warp prints when it starts and loads kernels; settings of a process that has already started it are kept
if wp.config.kernel_cache_dir is None:
    if "WARP_CACHE_PATH" not in os.environ and (folder := cache_folder()):
        wp.config.kernel_cache_dir = str(folder / "warp")
    wp.config.log_level = wp.LOG_WARNING
    wp.init()

from zbuf_occlude.engines.warp import kernels


def find_device(name: str) -> wp.Device:
    """Return the Warp device of a name, "cpu", "cuda" or "cuda:1"; for "auto" the first CUDA device, or else the CPU.

    Raises
    ------
    OptionError
        Warp finds no such device.
    """
    if name == "auto":
        return wp.get_preferred_device()
    try:
        return wp.get_device(name)
    except (RuntimeError, ValueError):
        found = ", ".join(str(device) for device in wp.get_devices())
        raise OptionError(f"device must be auto, or one that Warp finds here, {found}; got {name!r}.") from None


class DeviceBvh:
    """BVH of a mesh on a device. Arguments and results of queries are arrays on that device.

    Parameters
    ----------
    corners : (3 f,) warp.array of vec3d
        Corners of the faces, face by face, world space.
    bounds : (2,) warp.array of vec3d
        Lower and upper corner of their bounding box.

    Notes
    -----
    Exact. Lines that float64 cannot decide are counted and decided by `exact` on the CPU, so each call waits for the
    count. Costs O(f log f) once, then about O(log f) per line.
    """

    def __init__(self, corners: wp.array, bounds: wp.array) -> None:
        n_faces = corners.shape[0] // 3
        self._corners, self._bounds, self._device = corners, bounds, corners.device
        lower, upper = (wp.empty(n_faces, dtype=wp.vec3, device=self._device) for _ in range(2))
        self._launch(kernels.fill_boxes, n_faces, corners, bounds, lower, upper)
        self._bvh = wp.Bvh(lower, upper)
        self._n_undecided = wp.zeros(1, dtype=wp.int32, device=self._device)
        self._engines: dict[float, Engine] = {}

    def fill_visible(self, points: wp.array, face_ids: wp.array, eyes: wp.array, contact: float, out: wp.array) -> None:
        """Fill (k, n) uint8 with 1 if an eye (k vec3d) sees a point (n vec3d), else 0.

        `face_ids` are the points' own faces, int32; `contact` is the contact tolerance, a fraction of the diagonal.
        """
        asked = self._bvh.id, self._corners, self._bounds, wp.float64(contact), points, face_ids, eyes
        if self._count_undecided(kernels.fill_visible, out.shape, *asked, out):
            answer = out.numpy().copy()
            pairs = np.nonzero(answer == kernels.IN_DOUBT)
            own = face_ids.numpy()
            self._engine(contact).answer_pairs(points.numpy(), own, eyes.numpy(), pairs, answer.view(bool))
            out.assign(answer)

    def fill_first_hits(self, origins: wp.array, directions: wp.array, face_ids: wp.array, distances: wp.array) -> None:
        """Fill (n,) int32 and float64 with the rays' first faces and their distances; a single origin serves all."""
        asked = self._bvh.id, self._corners, self._bounds, origins, directions
        if self._count_undecided(kernels.fill_first_hits, directions.shape, *asked, face_ids, distances):
            faces, away = face_ids.numpy().copy(), distances.numpy().copy()
            rows = np.flatnonzero(faces == kernels.UNDECIDED)
            begins = np.broadcast_to(origins.numpy(), (len(faces), 3))[rows]
            faces[rows], away[rows] = self._engine(0.0).first_hits(begins, directions.numpy()[rows])
            face_ids.assign(faces)
            distances.assign(away)

    def _engine(self, contact: float) -> Engine:
        """Return the engine on the CPU for a contact tolerance, a fraction of the diagonal."""
        if contact not in self._engines:
            corners = self._corners.numpy()
            mesh = Mesh(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))
            self._engines[contact] = Engine(mesh, contact * mesh.diagonal)
        return self._engines[contact]

    def _count_undecided(self, kernel: wp.Kernel, shape: int | tuple[int, ...], *arguments: object) -> int:
        """Launch a kernel that counts the lines it cannot decide, and return their number."""
        self._n_undecided.zero_()
        self._launch(kernel, shape, *arguments, self._n_undecided)
        return int(self._n_undecided.numpy()[0])

    def _launch(self, kernel: wp.Kernel, shape: int | tuple[int, ...], *arguments: object) -> None:
        wp.launch(kernel, dim=shape, inputs=arguments, device=self._device)
