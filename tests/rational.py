"""The definition of "visible" in rational arithmetic, for the few pairs of eye and point that two judges dispute."""

from collections.abc import Sequence
from fractions import Fraction

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.geometry.mesh import Mesh

Rational = list[Fraction]
Vector = Rational | Sequence[float] | FloatArray


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
    towards = _minus(_exact(eye), _exact(point))
    tau_squared = Fraction(contact) ** 2
    met = (meeting(point, towards, corners) for face, corners in enumerate(mesh.corners) if face != own)
    return not any(t is not None and t < 1 and t * t * _dot(towards, towards) > tau_squared for t in met)


def meeting(origin: Vector, direction: Vector, corners: Sequence[Vector]) -> Fraction | None:
    """How many times its direction from its origin a ray meets a face, without rounding; None where it does not."""
    p, towards = _exact(origin), _exact(direction)
    a, b, c = map(_exact, corners)
    normal = _cross(_minus(b, a), _minus(c, a))
    slope = _dot(towards, normal)
    t = _dot(_minus(a, p), normal) / slope if slope else Fraction(0)
    if t <= 0:
        return None
    met = [x + t * y for x, y in zip(p, towards, strict=True)]
    inside = all(_dot(_cross(_minus(v, u), _minus(met, u)), normal) >= 0 for u, v in ((a, b), (b, c), (c, a)))
    return t if inside else None


def _exact(values: Vector) -> Rational:
    return [Fraction(x if isinstance(x, Fraction) else float(x)) for x in values]


def _minus(u: Rational, v: Rational) -> Rational:
    return [x - y for x, y in zip(u, v, strict=True)]


def _dot(u: Rational, v: Rational) -> Fraction:
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def _cross(u: Rational, v: Rational) -> Rational:
    return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
