"""Surfaces x, y, z of two parameters given by formulas, like those of the paper's Fig. 9."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import OptionError, check_choice
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.meshes.shapes.kit import quad_grid

Array = Any  # a parameter net or an expression of it: broadcasting float arrays
PI, TURN = np.pi, 2 * np.pi


@dataclass(frozen=True)
class Formula:
    """A surface over the rectangle ``u`` x ``v``.

    Parameters
    ----------
    u, v : (float, float)
        Ranges of the parameters.
    surface : callable
        (u, v) to (x, y, z).
    closed : str
        Periodic parameters: "", "u", "v" or "uv".
    """

    u: tuple[float, float]
    v: tuple[float, float]
    surface: Callable[[Array, Array], tuple[Array, Array, Array]]
    closed: str = ""


def _about_z(r: Array, z: Array, v: Array) -> tuple[Array, Array, Array]:
    return r * np.cos(v), r * np.sin(v), z


def _tube(centre: Callable[[Array], tuple[Array, Array, Array]], radius: float) -> Callable[[Array, Array], Any]:
    """A tube about a curve, with cross-sections in the plane of the curve's numerical normal and binormal."""

    def surface(u: Array, v: Array) -> tuple[Array, Array, Array]:
        h = 1e-3
        before, here, after = (np.stack(np.broadcast_arrays(*centre(u + k)), axis=-1) for k in (-h, 0.0, h))
        along, bend = after - before, after - 2 * here + before
        across = np.cross(along, bend)
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        inward = np.cross(across, along)
        inward /= np.linalg.norm(inward, axis=-1, keepdims=True)
        xyz = here + radius * (np.cos(v)[..., None] * inward + np.sin(v)[..., None] * across)
        return xyz[..., 0], xyz[..., 1], xyz[..., 2]

    return surface


def _moebius(u: Array, v: Array) -> tuple[Array, Array, Array]:
    return _about_z(1 + v * np.cos(u / 2), v * np.sin(u / 2), u)


def _klein(u: Array, v: Array) -> tuple[Array, Array, Array]:
    c, s = np.cos(u / 2), np.sin(u / 2)
    return _about_z(1.2 + 0.5 * (c * np.sin(v) - s * np.sin(2 * v)), 0.5 * (s * np.sin(v) + c * np.sin(2 * v)), u)


def _shell(u: Array, v: Array) -> tuple[Array, Array, Array]:
    grow = np.exp(0.18 * u)
    return _about_z(grow * (1.1 + np.cos(v)), grow * np.sin(v) - 1.9 * grow, u)


def _power(x: Array, exponent: float) -> Array:
    return np.sign(x) * np.abs(x) ** exponent


def _enneper(u: Array, v: Array) -> tuple[Array, Array, Array]:
    x, y = u * np.cos(v), u * np.sin(v)
    return x - x**3 / 3 + x * y**2, y - y**3 / 3 + y * x**2, x**2 - y**2


def _ellipsoid(u: Array, v: Array) -> tuple[Array, Array, Array]:
    return np.cos(u) * np.cos(v), 0.7 * np.cos(u) * np.sin(v), 0.5 * np.sin(u)


def _peaks(u: Array, v: Array) -> tuple[Array, Array, Array]:
    return u, v, 2 * u * np.exp(-(u**2) - v**2) + np.exp(-3 * (u + 1) ** 2 - 3 * (v - 1) ** 2)


def _helix(t: Array) -> tuple[Array, Array, Array]:
    return np.cos(t), np.sin(t), t / 8


def _trefoil(t: Array) -> tuple[Array, Array, Array]:
    return np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)


def _two_sheets(u: Array, v: Array) -> tuple[Array, Array, Array]:
    return _about_z(0.6 * np.sinh(u), 0.5 * np.sign(u) * np.cosh(u), v)


def _superquadric(exponent: float) -> Callable[[Array, Array], tuple[Array, Array, Array]]:
    """A sphere whose sines and cosines are raised to a power: below 1 a pillow, above 2 a star."""

    def surface(u: Array, v: Array) -> tuple[Array, Array, Array]:
        flat = _power(np.cos(u), exponent)
        return flat * _power(np.cos(v), exponent), flat * _power(np.sin(v), exponent), _power(np.sin(u), exponent)

    return surface


def _bumpy(u: Array, v: Array) -> tuple[Array, Array, Array]:
    r = 1 + 0.15 * np.sin(6 * v) * np.cos(u) ** 2 * np.cos(5 * u)
    return _about_z(r * np.cos(u), r * np.sin(u), v)


HALF, FULL = (-PI / 2, PI / 2), (0.0, TURN)
FORMULAS: MappingProxyType[str, Formula] = MappingProxyType(
    {
        "ellipsoid": Formula(HALF, FULL, _ellipsoid, "v"),
        "cylinder": Formula((-1, 1), FULL, lambda u, v: _about_z(0.6, u, v), "v"),
        "cone": Formula((0, 1), FULL, lambda u, v: _about_z(0.6 * u, -1.4 * u, v), "v"),
        "torus": Formula(FULL, FULL, lambda u, v: _about_z(1 + 0.4 * np.cos(u), 0.4 * np.sin(u), v), "uv"),
        "paraboloid": Formula((0, 1), FULL, lambda u, v: _about_z(u, u**2, v), "v"),
        "hyperboloid": Formula((-1.2, 1.2), FULL, lambda u, v: _about_z(0.5 * np.cosh(u), np.sinh(u), v), "v"),
        "two_sheets": Formula((-1.6, 1.6), FULL, _two_sheets, "v"),
        "saddle": Formula((-1, 1), (-1, 1), lambda u, v: (u, v, 0.6 * (u**2 - v**2))),
        "monkey_saddle": Formula((-1, 1), (-1, 1), lambda u, v: (u, v, 0.4 * (u**3 - 3 * u * v**2))),
        "egg_box": Formula((-TURN, TURN), (-TURN, TURN), lambda u, v: (u, v, np.sin(u) * np.sin(v))),
        "ripple": Formula((0, 10), FULL, lambda u, v: _about_z(u, 4 * np.sinc(u / PI), v), "v"),
        "peaks": Formula((-2, 2), (-2, 2), _peaks),
        "wave": Formula((-PI, PI), (-1, 1), lambda u, v: (u, v, 0.6 * np.sin(2 * u))),
        "helix": Formula((0, 4 * TURN), FULL, _tube(_helix, 0.22), "v"),
        "trefoil": Formula(FULL, FULL, _tube(_trefoil, 0.45), "uv"),
        "helicoid": Formula((-1, 1), (-TURN, TURN), lambda u, v: _about_z(u, v / 4, v)),
        "catenoid": Formula((-1.2, 1.2), FULL, lambda u, v: _about_z(np.cosh(u), 1.2 * u, v), "v"),
        "moebius": Formula(FULL, (-0.4, 0.4), _moebius),
        "klein": Formula(FULL, FULL, _klein, "v"),
        "sea_shell": Formula((-4 * TURN, 0), FULL, _shell, "v"),
        "enneper": Formula((0, 1.5), FULL, _enneper, "v"),
        "superquadric": Formula(HALF, FULL, _superquadric(0.4), "v"),
        "star": Formula(HALF, FULL, _superquadric(3.0), "v"),
        "bumpy_sphere": Formula(HALF, FULL, _bumpy, "v"),
        "gear": Formula((-1, 1), FULL, lambda u, v: _about_z(1 + 0.12 * np.tanh(4 * np.sin(12 * v)), 0.25 * u, v), "v"),
        "vase": Formula(FULL, FULL, lambda u, v: _about_z(1 + 0.45 * np.sin(u), 0.55 * u, v), "v"),
    }
)
"""The formulas by name."""


def make(name: str, n: int = 48) -> Mesh:
    """Return the mesh of one of the `FORMULAS`.

    Parameters
    ----------
    name : str
    n : int
        Steps along either parameter: about 2 n^2 faces.

    Returns
    -------
    Mesh
        Cleaned and normalized: centred, longest side 1. Open where the formula is open, without thickness.

    Raises
    ------
    OptionError
        An unknown name, or n below 4.
    """
    check_choice("formula", name, FORMULAS)
    if n < 4:
        raise OptionError(f"n must be at least 4; got {n}.")
    formula = FORMULAS[name]
    u, v = (
        np.linspace(*ends, n, endpoint=False) if letter in formula.closed else np.linspace(*ends, n + 1)
        for letter, ends in (("u", formula.u), ("v", formula.v))
    )
    net: FloatArray = np.stack(np.broadcast_arrays(*formula.surface(*np.meshgrid(u, v, indexing="ij"))), axis=2)
    part = quad_grid(net, wrap_rows="u" in formula.closed, wrap_columns="v" in formula.closed)
    return Mesh(part.points, part.faces, name=name).cleaned().normalized()


def collection(n: int = 48) -> MeshCollection:
    """Return all formulas as a collection; the label is the name, the key ``formula/NAME``."""
    return MeshCollection(MeshEntry(f"formula/{name}", name, "train", partial(make, name, n)) for name in FORMULAS)
