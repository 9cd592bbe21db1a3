"""The process that owns pyrender: takes cameras from a pipe, gives depth images back. Run as a module, never imported.

pyrender ends EGL's display for its whole process when it closes, and needs PYOPENGL_PLATFORM set before it is
imported; so it lives alone. The process ends when the pipe does, and so with the one that started it.
"""

import os
import signal
import sys
from multiprocessing.connection import Connection

import numpy as np

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.errors import UnavailableError
from zbuf_occlude.extras import importing
from zbuf_occlude.geometry.camera import Frusta
from zbuf_occlude.jit.compiler import without_scipy


class Renderer:
    """One mesh in a pyrender scene, and a camera to be moved.

    Parameters
    ----------
    vertices : (v, 3) float
    faces : (f, 3) int
    resolution : int
        Pixels along a side of the square image.
    """

    def __init__(self, vertices: FloatArray, faces: IntArray, resolution: int) -> None:
        import pyrender  # late, as is OpenGL: `serve` tells where they are broken
        from OpenGL.GL import GL_RENDERER, glGetString

        self._resolution = resolution
        # SEG switches multisampling off, so that depth is that of the pixel's centre; without it pyrender's depth is
        # sampled 1/8 pixel left and 3/8 below
        self._flags = pyrender.RenderFlags.DEPTH_ONLY | pyrender.RenderFlags.SEG
        self._offscreen = pyrender.OffscreenRenderer(resolution, resolution)
        self.name = glGetString(GL_RENDERER).decode()
        # with SEG pyrender culls back faces whatever the material says: each face stands there in both windings
        both = np.concatenate([faces, faces[:, ::-1]])
        triangles = pyrender.Primitive(positions=vertices, indices=both, mode=pyrender.GLTF.TRIANGLES)
        self._scene = pyrender.Scene()
        node = self._scene.add(pyrender.Mesh([triangles]))
        self._colours = {node: (255, 0, 0)}
        self._camera = pyrender.IntrinsicsCamera(1.0, 1.0, 0.0, 0.0)
        self._camera_node = self._scene.add(self._camera)

    def render(self, view: FloatArray, frustum: Frusta) -> np.ndarray:
        """Return the eye depth at each pixel's centre, float32, lowest row first; infinite: none."""
        left, right, bottom, top, near, far = (float(bound) for bound in frustum)
        camera, size = self._camera, self._resolution
        camera.fx, camera.cx = size / (right - left), -left / (right - left) * size
        camera.fy, camera.cy = size / (top - bottom), top / (top - bottom) * size
        camera.zfar = np.inf  # the setters compare one with the other's old value
        camera.znear, camera.zfar = near, far
        self._scene.set_pose(self._camera_node, np.linalg.inv(view))
        image = self._offscreen.render(self._scene, self._flags, self._colours)[::-1]
        return np.where(image > 0.0, image, np.float32(np.inf))


def serve(pipe: Connection) -> None:
    """Answer until the pipe ends: first (vertices, faces, resolution), then (view, frustum) again and again.

    Replies are ``("ready", GL_RENDERER)``, ``("depths", image)`` or, once and as the last, ``("error", text)`` or
    ``("unavailable", text)``.
    """
    try:
        # trimesh, which pyrender imports, can do without scipy: two fifths of the time to start
        with importing("pyrender", "method 'pyrender'"), without_scipy():
            import pyrender  # noqa: F401
        renderer = Renderer(*pipe.recv())
        pipe.send(("ready", renderer.name))
        while True:
            view, frustum = pipe.recv()
            pipe.send(("depths", renderer.render(view, frustum)))
    except (EOFError, ConnectionError):
        return  # the other end is gone, or done
    except UnavailableError as error:
        pipe.send(("unavailable", str(error)))
    except Exception as error:  # pyrender asserts, PyOpenGL has a tree of its own
        pipe.send(("error", f"{type(error).__name__}: {error}"))


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that asks; it closes the pipe
    serve(Connection(int(sys.argv[1])))
    os._exit(0)  # nothing here outlives the process; taking pyrender and EGL down in order costs half a second
