"""`pyrender`: depth images by pyrender in a process of its own, and a depth test of the points.

pyrender ends EGL's display for its whole process when it closes, and needs PYOPENGL_PLATFORM set before it is imported.
It therefore runs in a child process.
"""

import os
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.base.child import Child, ChildFailed
from zbuf_occlude.base.errors import GlError, OccludeError, OptionError, check_fraction
from zbuf_occlude.base.extras import importing
from zbuf_occlude.engines.gl.devices import FIXES, default_device
from zbuf_occlude.geometry.camera import (
    Frusta,
    cube_faces,
    cube_frusta,
    cube_view_matrices,
    fitted_frusta,
    view_matrices,
)
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import VisibilityQuery, check_count

TIMEOUT = 120.0
"""Maximum seconds for one reply; the first includes starting Python, importing pyrender and opening EGL."""

NEAR = 1e-3
"""Near plane of the cube faces, in longest sides: nearer faces are not drawn for an eye within the mesh."""

MAX_RESOLUTION = 8192
"""Maximum pixels along a side; the images of both framebuffers then take 2.6 GB."""


def prepare(
    mesh: Mesh, *, resolution: int = 512, tolerance: float = 3e-4, slope_bias: float = 0.5
) -> "PyrenderOccluder":
    """Start pyrender in a process of its own and send it a mesh.

    Parameters
    ----------
    mesh : Mesh
    resolution : int
        Pixels along a side of the depth image.
    tolerance : float
        Depth by which a visible point may lie behind the image, as a fraction of the mesh's diagonal.
    slope_bias : float
        Additional tolerance, in units of the depth that the point's own plane gains from one pixel to the next.

    Raises
    ------
    OptionError
        A value is out of range.
    GlError
        pyrender could not open EGL, or did not start.
    UnavailableError
        pyrender cannot be imported.
    """
    check_count("resolution", resolution, 1, MAX_RESOLUTION, "pixels along a side")
    check_fraction("tolerance", tolerance)
    if not 0.0 <= slope_bias < np.inf:
        raise OptionError(f"slope_bias must not be negative and be finite, in pixels; got {slope_bias}.")
    return PyrenderOccluder(mesh, int(resolution), tolerance, slope_bias)


class PyrenderOccluder(VisibilityQuery):
    """One depth image per eye (six cube faces for an eye within the mesh), against which NumPy tests all points.

    Notes
    -----
    Not exact: the image holds one depth per pixel, and a pixel times a slope is far more than the depth's resolution.
    This is shadow mapping (Williams 1978) with a slope-scaled bias. It computes in float32, so eyes must not be farther
    than some 10^4 longest sides. Back faces are drawn too.

    The process renders on the EGL device that ``EGL_DEVICE_ID`` names, else that of ``ZBUF_OCCLUDE_GL=egl:N`` or
    ``GLCONTEXT_DEVICE_INDEX``, else the first. It ends with `close`.

    Costs a draw of 2 f triangles and a read-back of the image for each view, and some arithmetic per point.

    Raises
    ------
    GlError
        The process ended, did not answer, or reported an error. Prepare the mesh again.
    """

    def __init__(self, mesh: Mesh, resolution: int, tolerance: float, slope_bias: float) -> None:
        super().__init__(mesh)
        # pyrender gets a centred mesh of longest side 1, so that float32 rounding depends on neither position nor scale
        self._scale = 1.0 / mesh.longest_side if mesh.longest_side > 0.0 else 1.0
        self._shift = -mesh.centre * self._scale
        normal = mesh.transformed(self._scale, self._shift)
        self._positions = normal.vertices[np.unique(normal.faces)]
        self._radius = float(np.linalg.norm(self._positions, axis=1).max())
        self._tolerance = tolerance * normal.diagonal  # in normalised space
        self.tolerance = self._tolerance / self._scale
        self._slope_bias = slope_bias
        self._margin = 2.0 / resolution
        self._turn, self._process = threading.Lock(), os.getpid()
        self._child = Child(**_environment())
        advice = f"Is EGL installed ({FIXES['egl']}), and EGL_DEVICE_ID right?"
        self.renderer = str(self._ask(_open, normal.vertices, normal.faces, resolution, advice=advice))

    def _visible(self, points: SurfacePoints, eyes: FloatArray) -> BoolArray:
        if os.getpid() != self._process:
            raise GlError(
                f"pyrender's process must be asked by the one that started it ({self._process}); this is "
                f"{os.getpid()}. Spawn workers instead of forking them, and prepare the mesh in each."
            )
        points = points.transformed(self._scale, self._shift)
        answer = np.ones((len(eyes), len(points)), dtype=bool)
        with self._turn:  # one request at a time: a reply belongs to the thread that asked
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
        return answer

    def depth_image(self, view: FloatArray, frustum: Frusta) -> FloatArray:
        """Render one eye depth image, (resolution, resolution), lowest row first, in pyrender's normalised space."""
        return np.asarray(self._ask(_render, view, frustum))

    def _ask(self, function: Callable[..., Any], *args: Any, advice: str = "Try again.") -> Any:
        try:
            self._child.start(function, *args)
            return self._child.answer(TIMEOUT)
        except ChildFailed as failure:
            raise GlError(f"pyrender's process {failure}. Prepare the mesh again.") from None
        except OccludeError:
            self._child.close()
            raise
        except Exception as error:  # pyrender asserts, PyOpenGL has its own exceptions
            self._child.close()
            raise GlError(f"pyrender's process reports {type(error).__name__}: {error}. {advice}") from None
        except BaseException:  # an interrupt: a pending reply would be taken for the next request's
            self._child.close()
            raise

    def _cameras(self, eye: FloatArray, positions: FloatArray) -> Iterator[tuple[FloatArray, Frusta, Any]]:
        """Yield view matrix, frustum and index of its points (``...`` for all) of each image that the eye needs."""
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
        self._child.close()


def depth_test(
    depths: FloatArray, view: FloatArray, frustum: Frusta, points: SurfacePoints, *, tolerance: float, slope_bias: float
) -> BoolArray:
    """Return which points do not lie behind a depth image by more than the tolerance; depth_test.comp in NumPy.

    Parameters
    ----------
    depths : (height, width) float
        Eye depth (distance along the camera's axis) at each pixel's centre, world units; infinite for the background.
        Row 0 is the *lowest*, as in OpenGL's window space; flip an image that starts at the top.
    view : (4, 4) float
        World to eye space (`camera.view_matrices`).
    frustum : Frusta
        Frustum of this one camera: six numbers.
    points : SurfacePoints
        n points, world space.
    tolerance : float
        Depth by which a visible point may lie behind the image, world units.
    slope_bias : float
        Additional tolerance, in units of the depth that the point's own plane gains from one pixel to the next.

    Returns
    -------
    (n,) bool, True = visible. A point outside the image is visible: nothing was drawn there.
    """
    x, y, depth = window_coordinates(view, frustum, points.positions, (depths.shape[1], depths.shape[0]))
    allowed = tolerance + slope_bias * depth_slopes(view, frustum, points, (depths.shape[1], depths.shape[0]))
    inside = (depth > 0) & (x >= 0) & (x < depths.shape[1]) & (y >= 0) & (y < depths.shape[0])
    visible = np.ones(len(points), dtype=bool)
    column, row = x[inside].astype(np.intp), y[inside].astype(np.intp)
    visible[inside] = depth[inside] <= depths[row, column] + allowed[inside]
    return visible


def window_coordinates(
    view: FloatArray, frustum: Frusta, positions: FloatArray, size: tuple[int, int]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return window x, y (pixels) and eye depth of positions (n, 3); x and y are undefined behind the eye."""
    eye_space = positions @ view[:3, :3].T + view[:3, 3]
    depth = -eye_space[:, 2]
    in_front = np.where(depth > 0, depth, np.inf)
    x = (eye_space[:, 0] / in_front - frustum.left) / (frustum.right - frustum.left) * size[0]
    y = (eye_space[:, 1] / in_front - frustum.bottom) / (frustum.top - frustum.bottom) * size[1]
    return x, y, depth


def depth_slopes(view: FloatArray, frustum: Frusta, points: SurfacePoints, size: tuple[int, int]) -> FloatArray:
    """Return the eye depth that each point's own plane gains from a pixel to the next, (n,), in world units.

    The larger of both directions is taken, as by glPolygonOffset, limited to the depth of the frustum (a plane seen
    edge-on has no finite slope); 0 for a free point, which has no plane.
    """
    normals = points.normals @ view[:3, :3].T
    positions = points.positions @ view[:3, :3].T + view[:3, 3]
    # the plane n . q = c meets the ray (s, t, -1) at depth c / (n_x s + n_y t - n_z); its derivatives by s and t:
    plane = np.abs((normals * positions).sum(axis=1))
    pixel = [(frustum.right - frustum.left) / size[0], (frustum.top - frustum.bottom) / size[1]]
    rise = (np.abs(normals[:, :2]) * pixel).max(axis=1) * positions[:, 2] ** 2
    most = frustum.far - frustum.near
    return np.asarray(
        np.where(rise < most * plane, rise / np.where(plane > 0, plane, 1.0), np.where(rise > 0, most, 0.0))
    )


def _environment() -> dict[str, str]:
    """Return the variables that make pyrender draw by EGL, on the device that this process's variables name."""
    named = os.environ.get("ZBUF_OCCLUDE_GL", "").partition(":")[2]
    device = os.environ.get("EGL_DEVICE_ID") or named or os.environ.get("GLCONTEXT_DEVICE_INDEX")
    return {"PYOPENGL_PLATFORM": "egl", "EGL_DEVICE_ID": device or str(default_device())}


class _Renderer:
    """One mesh in a pyrender scene, and a movable camera; used only in the child process."""

    def __init__(self, vertices: FloatArray, faces: IntArray, resolution: int) -> None:
        import pyrender  # late: only the child process loads pyrender and OpenGL
        from OpenGL.GL import GL_RENDERER, glGetString

        self._resolution = resolution
        # SEG switches multisampling off, so that depth is sampled at the pixel's centre, and not 1/8 pixel left of it
        # and 3/8 below
        self._flags = pyrender.RenderFlags.DEPTH_ONLY | pyrender.RenderFlags.SEG
        self._offscreen = pyrender.OffscreenRenderer(resolution, resolution)
        self.name = glGetString(GL_RENDERER).decode()
        # with SEG pyrender culls back faces whatever the material says: add each face in both windings
        both = np.concatenate([faces, faces[:, ::-1]])
        triangles = pyrender.Primitive(positions=vertices, indices=both, mode=pyrender.GLTF.TRIANGLES)
        self._scene = pyrender.Scene()
        node = self._scene.add(pyrender.Mesh([triangles]))
        self._colours = {node: (255, 0, 0)}
        self._camera = pyrender.IntrinsicsCamera(1.0, 1.0, 0.0, 0.0)
        self._camera_node = self._scene.add(self._camera)

    def render(self, view: FloatArray, frustum: Frusta) -> np.ndarray:
        """Return the eye depth at each pixel's centre, float32, lowest row first; infinite for the background."""
        left, right, bottom, top, near, far = (float(bound) for bound in frustum)
        camera, size = self._camera, self._resolution
        camera.fx, camera.cx = size / (right - left), -left / (right - left) * size
        camera.fy, camera.cy = size / (top - bottom), top / (top - bottom) * size
        camera.zfar = np.inf  # each setter compares its value with the other's old value
        camera.znear, camera.zfar = near, far
        self._scene.set_pose(self._camera_node, np.linalg.inv(view))
        image = self._offscreen.render(self._scene, self._flags, self._colours)[::-1]
        return np.where(image > 0.0, image, np.float32(np.inf))


_renderer: _Renderer
"""The child's renderer."""


def _open(vertices: FloatArray, faces: IntArray, resolution: int) -> str:
    """Open the child's renderer; return GL_RENDERER."""
    global _renderer
    with importing("pyrender", "method 'pyrender'"):
        import pyrender

        _ = pyrender.OffscreenRenderer  # fails for an empty package, which can be imported
    _renderer = _Renderer(vertices, faces, resolution)
    return _renderer.name


def _render(view: FloatArray, frustum: Frusta) -> np.ndarray:
    """Return an image of the child's renderer."""
    return _renderer.render(view, frustum)
