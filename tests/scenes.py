"""Meshes that tests of several rooms share: closed forms, and shapes that are hard for visibility."""

import os
from pathlib import Path

import numpy as np
import pytest

import zbuf_occlude as zo

DATA = Path(os.environ.get("ZBUF_OCCLUDE_DATA", Path(__file__).parents[2] / "shared" / "data")).absolute()
CHAIR = DATA / "modelnet" / "chair" / "train" / "chair_0003.off"
needs_chair = pytest.mark.skipif(not CHAIR.exists(), reason=f"{CHAIR} is not there; set ZBUF_OCCLUDE_DATA")

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float64)
HALVES = np.array([[0, 1, 2], [0, 2, 3]])
ACROSS = np.array([[0.0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]])
"""A square across the x axis, side 2."""


def chair() -> zo.Mesh:
    """The paper's "Chair (3)" of Table 1A: 2,628 faces, three vertices each."""
    from zbuf_occlude.meshes.load import load_mesh

    return load_mesh(CHAIR).normalized()


def stacked(*squares: np.ndarray) -> zo.Mesh:
    """Quadrilaterals (4, 3), two faces each, none sharing a vertex."""
    faces = np.concatenate([HALVES + 4 * i for i in range(len(squares))])
    return zo.Mesh(np.concatenate(squares), faces)


def two_plates(gap: float = 0.5) -> zo.Mesh:
    """Two unit squares, z = 0 (faces 0, 1) and z = gap (faces 2, 3)."""
    return stacked(SQUARE, SQUARE + np.array([0, 0, gap]))


def holed_plate_over_plate() -> zo.Mesh:
    """A plate [-4, 4]^2 at z = 0 (faces 0, 1), and above it at z = 1 one with the hole [-1, 1]^2."""
    below = SQUARE * [8, 8, 1] - [4, 4, 0]
    strips = [
        np.array([[x0, y0, 1.0], [x1, y0, 1.0], [x1, y1, 1.0], [x0, y1, 1.0]])
        for x0, x1, y0, y1 in ((-4, -1, -4, 4), (1, 4, -4, 4), (-1, 1, -4, -1), (-1, 1, 1, 4))
    ]
    return stacked(below, *strips)


def box(sides: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> zo.Mesh:
    """A box about the origin; faces 2 i and 2 i + 1 are its i-th side: -x, +x, -y, +y, -z, +z."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * sides
    quads = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
    return zo.Mesh(corners, [face for a, b, c, d in quads for face in ([a, b, c], [a, c, d])])


def sphere(n: int = 24) -> zo.Mesh:
    """A unit sphere of n rings of 2 n quadrilaterals, halved."""
    theta, phi = np.linspace(0, np.pi, n + 1), np.arange(2 * n) * np.pi / n
    t, p = np.meshgrid(theta, phi, indexing="ij")
    vertices = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(n), np.arange(2 * n), indexing="ij")
    a, b = i * 2 * n + j, i * 2 * n + (j + 1) % (2 * n)
    c, d = b + 2 * n, a + 2 * n
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2).reshape(-1, 3)
    return zo.Mesh(vertices, faces).cleaned()  # the poles' rings have faces of no area


def unshared(mesh: zo.Mesh) -> zo.Mesh:
    """The same faces with vertices of their own, as in ModelNet's files."""
    return zo.Mesh(mesh.corners.reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3), mesh.name)


def together(*meshes: zo.Mesh) -> zo.Mesh:
    """One mesh of several."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return zo.Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


def soup(n_faces: int, size: float = 0.1, seed: int = 0) -> zo.Mesh:
    """Random triangles in the unit cube: everything crosses everything."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-0.5, 0.5, (n_faces, 1, 3)) + rng.normal(scale=size, size=(n_faces, 3, 3))
    return zo.Mesh(corners.reshape(-1, 3), np.arange(3 * n_faces).reshape(-1, 3)).normalized()


def needles(n_faces: int, seed: int = 0) -> zo.Mesh:
    """Triangles from 1e-7 to 1e-2 wide."""
    rng = np.random.default_rng(seed)
    a = rng.uniform(-0.5, 0.5, (n_faces, 3))
    b = a + rng.normal(scale=0.2, size=(n_faces, 3))
    c = a + rng.normal(size=(n_faces, 3)) * 10.0 ** rng.uniform(-7, -2, (n_faces, 1))
    return zo.Mesh(np.stack([a, b, c], axis=1).reshape(-1, 3), np.arange(3 * n_faces).reshape(-1, 3))


def wrong(mesh: zo.Mesh, answer: np.ndarray, points: zo.SurfacePoints, eyes: np.ndarray) -> int:
    """Count the pairs on which an answer differs from the oracle's."""
    from zbuf_occlude.visibility.methods import oracle

    return int((answer != oracle.prepare(mesh).visible(points, eyes)).sum())


def wrong_outside_band(mesh: zo.Mesh, answer: np.ndarray, points: zo.SurfacePoints, eyes: np.ndarray) -> int:
    """Count the pairs on which an answer differs from the oracle's though that is decided."""
    from zbuf_occlude.visibility.methods import oracle

    judge = oracle.prepare(mesh)
    differs = answer != judge.visible(points, eyes)
    some = np.flatnonzero(differs.any(axis=0))
    if not len(some):
        return 0
    return int((differs[:, some] & judge.decided(points.select(some), eyes)).sum())


def row_in_a_plane(seed: int) -> tuple[zo.Mesh, zo.SurfacePoints, np.ndarray]:
    """Triangles in a row, points and eyes, in one plane to the last digit, where volumes' signs are rounding.

    Every eye sees every point, past the triangles beside the line of sight.
    """
    rng = np.random.default_rng(seed)
    row = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]) + 3.0 * np.arange(12)[:, None, None] * [1.0, 0, 0]
    turn, shift = np.linalg.qr(rng.normal(size=(3, 3)))[0], rng.uniform(-100.0, 100.0, 3)
    mesh = zo.Mesh((row @ turn + shift).reshape(-1, 3), np.arange(36).reshape(-1, 3))
    positions = (rng.dirichlet([1.0, 1.0, 1.0], (12, 20)) @ mesh.corners).reshape(-1, 3)
    points = zo.SurfacePoints(positions, np.repeat(np.arange(12), 20), np.tile(turn[2], (240, 1)))
    eyes = np.stack([rng.uniform(0.0, 33.0, 3), np.full(3, -60.0), np.zeros(3)], axis=1) @ turn + shift
    return mesh, points, eyes
