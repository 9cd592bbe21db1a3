"""Vectors of three numbers inside compiled functions: tuples or arrays in, tuples out."""

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
