"""Vectors of three numbers in compiled functions; operands are tuples or arrays, results are tuples."""

from zbuf_occlude.base.jit.compiler import njit


@njit(inline="always")
def dot(a, b):
    """Compute a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(inline="always")
def cross(a, b):
    """Compute a x b. In floating point cross(b, a) is its exact negative, which makes shared edges watertight."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@njit(inline="always")
def minus(a, b):
    """Compute a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
