"""The definitions of "visible" and "first hit" in rational arithmetic: the truth that exact methods are held to.

A third formulation beside signed volumes (`geometry.predicates`) and perpendicular planes (`object_space`): the meeting
point of line and plane, then on which side of each edge it lies. Coordinates become integers in a common unit, a power
of two, so that nothing is rounded. NumPy leaves out first the faces that a line misses by far.
"""

import math
from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.geometry.mesh import Mesh

Exact = Sequence[int | Fraction]
GENEROUS = 1e-9
"""A line misses a face by far where two of its volumes with the edges differ in sign by this share of the sum of their
products' sizes: a million times float64's rounding."""


def sees(mesh: Mesh, eye: FloatArray, point: FloatArray, own: int, contact: float) -> bool:
    """Return whether an eye sees a point.

    Parameters
    ----------
    mesh : Mesh
    eye, point : (3,) float
        World space. Taken for exactly what the floats say, as are the mesh's vertices.
    own : int
        The point's own face, -1 for none.
    contact : float
        The contact tolerance tau, world units.
    """
    faces = [face for face in _not_missed_by_far(mesh, point, np.subtract(eye, point)) if face != own]
    (begin, end, *corners), exponent = _integers([point, eye, *mesh.corners[faces].reshape(-1, 3)])
    towards, tau = _minus(end, begin), Fraction(contact) / Fraction(2) ** exponent
    for i in range(len(faces)):
        t = meeting(begin, towards, corners[3 * i : 3 * i + 3])
        if t is not None and t < 1 and t * t * _dot(towards, towards) > tau * tau:
            return False
    return True


def first_hit(mesh: Mesh, origin: FloatArray, direction: FloatArray) -> tuple[int, Fraction]:
    """Return the face that a ray meets first, the lowest of equally near ones, and how many directions away; -1, 0."""
    faces = _not_missed_by_far(mesh, origin, direction)
    (begin, *corners), exponent = _integers([origin, *mesh.corners[faces].reshape(-1, 3)])
    (along,), own_exponent = _integers([direction])
    found = [(meeting(begin, along, corners[3 * i : 3 * i + 3]), face) for i, face in enumerate(faces)]
    t, face = min(((t, face) for t, face in found if t is not None), default=(Fraction(0), -1))
    return face, t * Fraction(2) ** (exponent - own_exponent)


def meeting(origin: Exact, direction: Exact, corners: Sequence[Exact]) -> Fraction | None:
    """Return how many times its direction away a ray meets a face, all numbers exact; None where it misses."""
    a, b, c = corners
    normal = _cross(_minus(b, a), _minus(c, a))
    slope, height = _dot(direction, normal), _dot(_minus(a, origin), normal)
    if slope < 0:
        slope, height = -slope, -height
    if slope == 0 or height <= 0:
        return None
    met = [slope * x + height * y for x, y in zip(origin, direction, strict=True)]  # times the slope
    for u, v in ((a, b), (b, c), (c, a)):
        if _dot(_cross(_minus(v, u), [x - slope * y for x, y in zip(met, u, strict=True)]), normal) < 0:
            return None
    return Fraction(height) / Fraction(slope)


def exact(values: Sequence[float] | FloatArray) -> list[Fraction]:
    """Return floats as the fractions that they are."""
    return [Fraction(float(x)) for x in values]


def _not_missed_by_far(mesh: Mesh, origin: FloatArray, direction: FloatArray) -> list[int]:
    """Faces whose volumes with a line have one sign, or may have."""
    direction, corners = direction / np.abs(direction).max(), mesh.corners - np.asarray(origin)
    a, b, c = (corners / max(np.abs(corners).max(), 1e-300)).transpose(1, 0, 2)  # so that no product underflows
    above = below = np.zeros(len(a), dtype=bool)
    for one, other in ((b, c), (c, a), (a, b)):
        volume, size = np.zeros(len(a)), np.zeros(len(a))
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            plus, minus = direction[i] * one[:, j] * other[:, k], direction[i] * one[:, k] * other[:, j]
            volume, size = volume + plus - minus, size + np.abs(plus) + np.abs(minus)
        above, below = above | (volume > GENEROUS * size), below | (volume < -GENEROUS * size)
    return [int(face) for face in np.flatnonzero(~(above & below))]


def _integers(vectors: Sequence[FloatArray]) -> tuple[list[list[int]], int]:
    """Return vectors in units of 2^exponent, in which all are integers, and the exponent."""
    parts = [[math.frexp(x) for x in map(float, vector)] for vector in vectors]
    exponent = min((e for vector in parts for m, e in vector if m), default=0) - 53
    return [[int(m * 2.0**53) << max(e - 53 - exponent, 0) for m, e in vector] for vector in parts], exponent


def _minus(u: Exact, v: Exact) -> list[int | Fraction]:
    return [x - y for x, y in zip(u, v, strict=True)]


def _dot(u: Exact, v: Exact) -> int | Fraction:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def _cross(u: Exact, v: Exact) -> list[int | Fraction]:
    return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
