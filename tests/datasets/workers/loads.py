"""Meshes that workers make, and what they do instead: light to import, as each worker does so anew."""

import logging
import os
import signal
import threading

import numpy as np

from zbuf_occlude import Mesh, MeshError
from zbuf_occlude.base.jit import threads

CORNERS = np.concatenate([np.eye(3), -np.eye(3)])
FACES = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])


def ball(number: int) -> Mesh:
    """An octahedron, larger from one to the next."""
    return Mesh(CORNERS * (1 + number), FACES, name=f"ball_{number}")


def suicide(number: int) -> Mesh:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def hang(number: int) -> Mesh:
    threading.Event().wait()
    raise AssertionError


def swell(number: int) -> Mesh:
    kept = np.ones(200_000_000)  # 1.6 GB, touched
    threading.Event().wait()
    return Mesh(kept[:9].reshape(3, 3), np.array([[0, 1, 2]]))


def bad(number: int) -> Mesh:
    raise MeshError(f"m{number} is bad")


def tell(number: int) -> Mesh:
    raise MeshError(f"{os.environ['TOLD_TO_WORKERS']}, {threads.n_threads()} threads")


def warn(number: int) -> Mesh:
    logging.getLogger("zbuf_occlude.meshes").warning("m%d is a ball", number)
    return ball(number)
