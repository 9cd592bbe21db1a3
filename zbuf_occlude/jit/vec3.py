"""Vectors of three numbers inside compiled functions: tuples or arrays in, tuples out; and the normals of faces."""

from zbuf_occlude.jit.compiler import njit


@njit(inline="always")
def dot(a, b):
    """a . b"""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(inline="always")
def cross(a, b):
    """a x b; cross(b, a) is its exact negative in floating point, which makes shared edges watertight."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@njit(inline="always")
def minus(a, b):
    """a - b"""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@njit(cache=True, nogil=True)
def fill_normals(corners, normals):
    """Fill (f, 3) with the normals (b - a) x (c - a) of faces (f, 3 corners, 3), not of unit length."""
    for face in range(len(corners)):
        a, b, c = corners[face, 0], corners[face, 1], corners[face, 2]
        n = cross(minus(b, a), minus(c, a))
        normals[face, 0], normals[face, 1], normals[face, 2] = n[0], n[1], n[2]
