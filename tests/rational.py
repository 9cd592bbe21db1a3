"""The definition of "visible" in rational arithmetic, for the few pairs of eye and point that two judges dispute."""

from collections.abc import Sequence
from fractions import Fraction

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.geometry.mesh import Mesh

Rational = list[Fraction]


def sees(mesh: Mesh, eye: FloatArray, point: FloatArray, own: int, contact: float) -> bool:
    """Whether an eye sees a point, decided without rounding.

    Parameters
    ----------
    mesh : Mesh
    eye, point : (3,) float
        World space. Taken for exactly what the floats say, as are the mesh's vertices.
    own : int
        The point's own face, -1 for none.
    contact : float
        The contact tolerance tau, world units.

    Returns
    -------
    bool

    Notes
    -----
    Pure Python over all faces, about 50 microseconds each: for disputes, not for use. A third formulation beside
    signed volumes (`geometry.predicates`) and perpendicular planes (`zbuf_occlude.object_space`): the meeting
    point, then on which side of each edge it lies.
    """
    e, p = _exact(eye), _exact(point)
    towards = _minus(e, p)
    tau_squared = Fraction(contact) ** 2
    return not any(
        _blocks(p, towards, tau_squared, [_exact(corner) for corner in corners])
        for face, corners in enumerate(mesh.corners)
        if face != own
    )


def _blocks(p: Rational, towards: Rational, tau_squared: Fraction, corners: list[Rational]) -> bool:
    a, b, c = corners
    normal = _cross(_minus(b, a), _minus(c, a))
    slope = _dot(towards, normal)
    if slope == 0:
        return False
    t = _dot(_minus(a, p), normal) / slope
    if not 0 < t < 1 or t * t * _dot(towards, towards) <= tau_squared:
        return False
    met = [x + t * y for x, y in zip(p, towards, strict=True)]
    return all(_dot(_cross(_minus(v, u), _minus(met, u)), normal) >= 0 for u, v in ((a, b), (b, c), (c, a)))


def _exact(values: Sequence[float] | FloatArray) -> Rational:
    return [Fraction(float(x)) for x in values]


def _minus(u: Rational, v: Rational) -> Rational:
    return [x - y for x, y in zip(u, v, strict=True)]


def _dot(u: Rational, v: Rational) -> Fraction:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def _cross(u: Rational, v: Rational) -> Rational:
    return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
