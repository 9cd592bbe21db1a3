"""`exact_gl`: exact image-space visibility on the GPU, an irregular z-buffer in OpenGL compute shaders."""

from typing import Any

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.errors import check_fraction
from zbuf_occlude.engines.exact import Engine
from zbuf_occlude.engines.gl.exact_pass import ExactPass, PointPackets
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import CONTACT, VisibilityQuery


def prepare(mesh: Mesh, *, gl: Any, contact: float = CONTACT) -> "ExactGl":
    """Upload a mesh to the GPU of context `gl`; `contact` is the contact tolerance as a fraction of the diagonal."""
    check_fraction("contact", contact)
    return ExactGl(mesh, gl, contact)


class ExactGl(VisibilityQuery):
    """Irregular z-buffer: the samples define the positions on the screen, so it has no resolution.

    Notes
    -----
    Exact for any mesh and any eye, also inside the bounding sphere and close to the surface. A sign that float32 might
    get wrong (by a bound on all roundings, including the inputs') is computed in float64. A pair whose sign float64
    might get wrong is reported as undecided by an extra bit; `exact` on the CPU decides it. `n_undecided` counts these
    pairs: lines of sight within rounding of an edge or in a face's plane, and those of points far away.

    Points are divided into packets along a space-filling curve. For each packet and eye the faces between the two are
    listed, and each point tests them. Nothing is binned for a whole screen, so no list can overflow, and faces of any
    size are treated alike. On closed meshes of 19,000 faces a packet of 64 out of a million points tests some 160
    boxes and 130 faces, and 30 faces point by point. In the worst case, all faces behind each other, it tests all.
    The last points stay on the GPU. For memory see `zbuf_occlude.engines.gl.exact_pass.ExactPass`. Designed for
    GPUs; with a software rasteriser `exact` is far faster.

    References
    ----------
    Johnson, Lee, Burns, Mark: The irregular z-buffer. ACM Transactions on Graphics 24 (2005),
    doi:10.1145/1095878.1095889.
    Departure: a screen for each packet of points instead of one grid of lists; compute shaders instead of rasterising.
    """

    def __init__(self, mesh: Mesh, gl: Any, contact: float) -> None:
        super().__init__(mesh)
        self._gl, self.renderer = gl, gl.renderer
        gl.make_current()
        self._last: tuple[SurfacePoints, PointPackets] | None = None
        self._contact = contact * mesh.diagonal
        self._pass = ExactPass(gl, mesh, self._contact)
        self._engine: Engine | None = None
        self.n_undecided = 0

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        self._gl.make_current()
        if self._last is None or self._last[0] is not points:  # points are immutable: the last ones are still valid
            self._forget()
            self._last = points, self._pass.upload(points.positions, points.face_ids)
        answer, undecided = self._pass.visible(self._last[1], eyes)
        self._gl.check()
        if n_undecided := len(undecided[0]):
            self.n_undecided += n_undecided
            self._engine = self._engine or Engine(self.mesh, self._contact)
            self._engine.answer_pairs(points.positions, points.face_ids, eyes, undecided, answer)
        return answer

    def _forget(self) -> None:
        if self._last is not None:
            self._last[1].release()
            self._last = None

    def _release(self) -> None:
        self._gl.make_current()
        self._forget()
        self._pass.release()
