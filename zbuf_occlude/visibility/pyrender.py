"""`pyrender`: depth images by pyrender in a process of its own, and the depth test. The peer in image space."""

import os
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import weakref
from collections.abc import Iterator
from ctypes import CDLL
from ctypes.util import find_library
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import IO, Any

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.errors import GlError, OptionError, UnavailableError, check_fraction
from zbuf_occlude.geometry.camera import (
    Frusta,
    cube_faces,
    cube_frusta,
    cube_view_matrices,
    fitted_frusta,
    view_matrices,
)
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints
from zbuf_occlude.gl.devices import default_device
from zbuf_occlude.visibility.depth_test import depth_test
from zbuf_occlude.visibility.interface import Occluder

WORKER = "zbuf_occlude.visibility.pyrender_worker"

PATIENCE = 120.0
"""Seconds that the worker may take for one reply (the first: starting Python, importing pyrender, opening EGL)."""

EGL_FIX = "apt-get install libegl1 libgl1-mesa-dri"
"""The command (Debian) that installs what pyrender needs on a machine without a GPU's own driver."""

NEAR = 1e-3
"""The cube faces' near plane, in longest sides: what is nearer to an eye within the mesh is not drawn."""

LARGEST = 8192
"""The most pixels along a side; the images of both framebuffers then take 2.6 GB."""


def prepare(
    mesh: Mesh, *, resolution: int = 512, tolerance: float = 3e-4, slope_bias: float = 0.5
) -> "PyrenderOccluder":
    """Start pyrender in a process of its own and give it a mesh.

    Parameters
    ----------
    mesh : Mesh
    resolution : int
        Pixels along a side of the depth image.
    tolerance : float
        A point may be this much deeper than the image and is still visible; a fraction of the mesh's diagonal.
    slope_bias : float
        Added to it: this many times the depth that the point's own plane gains from one pixel to the next.

    Raises
    ------
    OptionError
        A value is out of range.
    GlError
        pyrender could not open EGL, or did not start.
    UnavailableError
        pyrender cannot be imported.
    """
    if not isinstance(resolution, (int, np.integer)) or not 1 <= resolution <= LARGEST:
        raise OptionError(f"resolution must be an int in [1, {LARGEST}], pixels along a side; got {resolution!r}.")
    check_fraction("tolerance", tolerance)
    if not 0.0 <= slope_bias < np.inf:
        raise OptionError(f"slope_bias must not be negative and be finite, in pixels; got {slope_bias}.")
    return PyrenderOccluder(mesh, int(resolution), tolerance, slope_bias)


def missing() -> str:
    """Say in words what pyrender needs and this machine lacks, "" for nothing; opens no display."""
    try:
        CDLL(find_library("EGL") or "libEGL.so.1")
    except OSError:
        return f"needs libEGL; on Debian: {EGL_FIX}"
    return ""


class PyrenderOccluder(Occluder):
    """One depth image an eye (six of a cube's faces for an eye within the mesh), all points tested against it in NumPy.

    Notes
    -----
    Not exact: the image knows one depth a pixel, and a pixel times a slope is far more than the depth's resolution; see
    `zbuf_occlude.visibility.depth_test`. Everything in it is float32, so eyes must not be farther than some 10^4
    longest sides. Back faces are drawn too.

    pyrender runs in a process of its own, because it ends EGL's display for all others when it closes. The process
    ends with `close`, and with this one. It renders on the EGL device that ``EGL_DEVICE_ID`` names, else that of
    ``ZBUF_OCCLUDE_GL=egl:N`` or ``GLCONTEXT_DEVICE_INDEX``, else the first.

    Costs a draw of 2 f triangles and a read-back of the image a view, and some NumPy per point.

    Raises
    ------
    GlError
        The process ended, did not answer, or reported an error. Prepare the mesh again.
    """

    def __init__(self, mesh: Mesh, resolution: int, tolerance: float, slope_bias: float) -> None:
        super().__init__(mesh)
        # what pyrender gets is centred, and its longest side is 1: float32 is the same for all places and scales
        self._scale = 1.0 / mesh.longest_side if mesh.longest_side > 0.0 else 1.0
        self._shift = -mesh.centre * self._scale
        normal = mesh.transformed(self._scale, self._shift)
        self._positions = normal.vertices[np.unique(normal.faces)]
        self._radius = float(np.linalg.norm(self._positions, axis=1).max())
        self._tolerance = tolerance * normal.diagonal  # in that unit
        self._slope_bias = slope_bias
        self._margin = 2.0 / resolution
        self._turn, self._process = threading.Lock(), os.getpid()
        self._worker = Worker()
        try:
            self._worker.send((normal.vertices, normal.faces, resolution))
            self._renderer = str(self._worker.receive("ready"))
        except BaseException:
            self._worker.close()
            raise

    @property
    def renderer(self) -> str:
        """GL_RENDERER of the process that pyrender runs in."""
        return self._renderer

    @property
    def tolerance(self) -> float:
        """The option's, in world units."""
        return float(self._tolerance / self._scale)

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        if os.getpid() != self._process:
            raise GlError(
                f"pyrender's process must be asked by the one that started it ({self._process}); this is "
                f"{os.getpid()}. Spawn workers instead of forking them, and prepare the mesh in each."
            )
        with self._turn:  # a reply belongs to whoever asked
            return self._answer(points, eyes)

    def _answer(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        points = points.transformed(self._scale, self._shift)
        answer = np.ones((len(eyes), len(points)), dtype=bool)
        try:
            for eye, row in zip(eyes * self._scale + self._shift, answer, strict=True):
                for view, frustum, seen in self._cameras(eye, points.positions):
                    row[seen] = depth_test(
                        self.depth_image(view, frustum),
                        view,
                        frustum,
                        points if seen is Ellipsis else points.select(seen),
                        tolerance=self._tolerance,
                        slope_bias=self._slope_bias,
                    )
        except BaseException:  # an interrupt too: a reply may be under way, and would be taken for the next one's
            self._worker.close()
            raise
        return answer

    def depth_image(self, view: FloatArray, frustum: Frusta) -> FloatArray:
        """Render one eye depth image, (resolution, resolution), lowest row first, in pyrender's normalised space."""
        self._worker.send((view, frustum))
        return np.asarray(self._worker.receive("depths"))

    def _cameras(self, eye: FloatArray, positions: FloatArray) -> Iterator[tuple[FloatArray, Frusta, Any]]:
        """View matrix, frustum and an index of its points (... is all), for each image that the eye needs."""
        if np.linalg.norm(eye) > self._radius:
            views = view_matrices(eye[None], np.zeros(3))
            fits, frusta = fitted_frusta(views, self._positions, self._margin)
            if fits[0]:
                yield views[0], Frusta(*(bound[0] for bound in frusta)), ...
                return
        far = float(np.linalg.norm(eye)) + self._radius
        frusta = cube_frusta(6, NEAR, max(far, 2 * NEAR), self._margin)
        fell_on = cube_faces(positions - eye)
        for face, view in enumerate(cube_view_matrices(eye[None])[0]):
            seen = np.flatnonzero(fell_on == face)
            if len(seen):
                yield view, Frusta(*(bound[face] for bound in frusta)), seen

    def _release(self) -> None:
        self._worker.close()


class Worker:
    """The other process and the pipe to it. No call blocks for longer than `PATIENCE`.

    Attributes
    ----------
    process : subprocess.Popen
    """

    def __init__(self) -> None:
        ours, theirs = Pipe()
        with socket.socket(fileno=os.dup(ours.fileno())) as end:
            # poll() has a timeout, but a message may stop half-way: the socket has one too
            end.setblocking(True)  # whatever socket.setdefaulttimeout says
            for direction in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
                end.setsockopt(socket.SOL_SOCKET, direction, struct.pack("ll", int(PATIENCE), 0))
        self._pipe = ours
        self._log = tempfile.TemporaryFile()  # noqa: SIM115  (closed by `_end`)
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-m", WORKER, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                env=_environment(),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=self._log,
            )
        # also run when the occluder is forgotten, and when the interpreter ends
        self.close = weakref.finalize(self, _end, self.process, ours, self._log)

    def send(self, message: Any) -> None:
        """Send a message, or raise GlError."""
        try:
            self._pipe.send(message)
        except OSError:
            raise self._failure() from None

    def receive(self, kind: str) -> Any:
        """Return the content of the next reply, which must be of a kind, or raise GlError."""
        try:
            if not self._pipe.poll(PATIENCE):
                raise TimeoutError
            reply, content = self._pipe.recv()
        except (OSError, EOFError):
            raise self._failure() from None
        if reply != kind:
            self.close()
            if reply == "unavailable":
                raise UnavailableError(content)
            advice = f"Is EGL installed ({EGL_FIX}), and EGL_DEVICE_ID right?" if kind == "ready" else "Try again."
            raise GlError(f"pyrender's process must answer with {kind}; it reports {content}. {advice}")
        return content

    def _failure(self) -> GlError:
        """End the process, and say how it had ended or that it had not."""
        if not self.close.alive:
            return GlError("pyrender's process must run; an earlier error ended it. Prepare the mesh again.")
        try:
            code = self.process.wait(timeout=1.0)  # the pipe may end a little before the process does
        except subprocess.TimeoutExpired:
            how = f"it did not in {PATIENCE:g} seconds"
            self.process.kill()
        else:
            how = f"it ended by signal {-code}" if code < 0 else f"it ended with code {code}"
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").strip().splitlines()
        self.close()
        said = f", saying: {lines[-1]}" if lines else ""
        return GlError(f"pyrender's process must answer; {how}{said}. Prepare the mesh again.")


def _end(process: "subprocess.Popen[bytes]", pipe: Connection, log: IO[bytes]) -> None:
    pipe.close()  # which ends it
    try:
        process.wait(timeout=5.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    log.close()


def _environment() -> dict[str, str]:
    """Return this process's environment with pyrender on EGL, and packages found where this process finds them."""
    named = os.environ.get("ZBUF_OCCLUDE_GL", "").partition(":")[2]
    device = os.environ.get("EGL_DEVICE_ID") or named or os.environ.get("GLCONTEXT_DEVICE_INDEX")
    device = device or str(default_device())
    package = str(Path(__file__).parents[2])
    paths = [package, *(os.path.abspath(path) for path in sys.path)]
    return {**os.environ, "PYOPENGL_PLATFORM": "egl", "EGL_DEVICE_ID": device, "PYTHONPATH": os.pathsep.join(paths)}
