"""Vectors of three numbers in compiled functions; operands are tuples or arrays, results are tuples."""

from zbuf_occlude.base.jit.compiler import always_inline


@always_inline
def dot(a, b):
    """Compute a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@always_inline
def cross(a, b):
    """Compute a x b. In floating point cross(b, a) is its exact negative, which makes shared edges watertight."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@always_inline
def minus(a, b):
    """Compute a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@always_inline
def plus(a, b):
    """Compute a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])
