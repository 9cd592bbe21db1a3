"""Parts of airplanes: bodies, wings, tails, engines, wheels. Nose towards -y; the body is about 1 long."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.meshes.shapes.curves import circle, smooth, superellipse
from zbuf_occlude.meshes.shapes.draw import Draw
from zbuf_occlude.meshes.shapes.kit import (
    MeshPart,
    Point,
    around,
    boxes,
    ellipsoid,
    join,
    loft,
    pair,
    quad_grid,
    revolve,
    rod,
)


def fuselage(draw: Draw, stations: ArrayLike, r: float = 1.0, length: float = 1.0, power: float = 2.0) -> MeshPart:
    """Return a body from rows of (fraction of the length from the nose, half width, half height, height of the middle).

    The other columns are multiples of `r`.
    """
    rows = smooth(np.asarray(stations) * (1, r, r, r), draw.round(26))
    n = draw.round(18)
    ring = circle(n, 90) if power == 2.0 else superellipse(n, power, 90)
    rings = np.empty((len(rows), n, 3))
    rings[..., 0] = np.maximum(rows[:, 1:2], 0.002 * length) * ring[:, 0]
    rings[..., 1] = (rows[:, :1] - 0.5) * length
    rings[..., 2] = rows[:, 3:] + np.maximum(rows[:, 2:3], 0.002 * length) * ring[:, 1]
    return loft(rings)


def airliner_body(draw: Draw, r: float, *, upsweep: float = 0.6, droop: float = 0.15) -> MeshPart:
    """Return a tube of radius r with a blunt nose and an upswept tail."""
    tall, nose, start = draw.between(0.9, 1.2), draw.between(0.07, 0.16), draw.between(0.58, 0.7)
    rows = [
        (0.0, 0.03, 0.03, -droop), (0.25 * nose, 0.5, 0.45, -0.7 * droop), (0.6 * nose, 0.85, 0.8 * tall, 0.0),
        (nose, 1.0, tall, 0.0), (0.4, 1.0, tall, 0.0), (start, 1.0, tall, 0.0),
        (0.55 * start + 0.42, 0.8, 0.75, 0.3 * upsweep), (0.92, 0.42, 0.42, 0.75 * upsweep), (1.0, 0.08, 0.12, upsweep),
    ]  # fmt: skip
    return fuselage(draw, rows, r)


def pod(draw: Draw, r: float, length: float) -> MeshPart:
    """Return a slim closed body about the y axis: a tank, a float, a missile."""
    rows = [(0.0, 0.05, 0.05, 0), (0.1, 0.75, 0.75, 0), (0.4, 1.0, 1.0, 0), (0.75, 0.8, 0.8, 0), (1.0, 0.1, 0.1, 0)]
    return fuselage(draw, rows, r, length)


# ---- surfaces ----------------------------------------------------------------------------------------------------


def foil(thickness: float, n: int) -> FloatArray:
    """Return an aerofoil of chord 1 with its leading edge at y = 0, (2 n - 2, 2)."""
    s = (1 - np.cos(np.linspace(0, np.pi, n))) / 2
    half = 5 * thickness * (0.2969 * np.sqrt(s) - 0.126 * s - 0.3516 * s**2 + 0.2843 * s**3 - 0.1036 * s**4)
    upper, lower = np.column_stack([s, 1.1 * half]), np.column_stack([s, -0.8 * half])
    return np.vstack([upper, lower[-2:0:-1]])


def panel(
    draw: Draw, root: Point, tip: Point, chords: tuple[float, float], thick: float = 0.11, knee: float = 0.0
) -> MeshPart:
    """Return a wing between two leading-edge points with the chords there; `knee` above 0 rounds its plan."""
    n = max(4, draw.round(8))
    t = np.linspace(0, 1, 2 if knee == 0.0 else draw.round(8))
    a, b = np.asarray(root, dtype=np.float64), np.asarray(tip, dtype=np.float64)
    chord = chords[0] + (chords[1] - chords[0]) * t ** (1 + 2 * knee)
    edge = a + t[:, None] * (b - a)
    edge[:, 1] = a[1] + (b[1] - a[1]) * t ** (1 + knee)
    section = foil(thick, n)
    rings = edge[:, None].repeat(len(section), axis=1)
    rings[..., 1] += chord[:, None] * section[:, 0]
    # the thickness is perpendicular to the span
    span = (b - a) * (1, 0, 1)
    up = np.array([-span[2], 0.0, span[0]]) / np.linalg.norm(span)
    rings += (chord[:, None] * section[:, 1])[..., None] * up
    return loft(rings)


@dataclass(frozen=True)
class Wing:
    """A pair of wings: the root's leading edge is at (0, y, z); `half` is half the span; slopes back and up; chords."""

    y: float
    z: float
    half: float
    sweep: float
    rise: float
    chord: float
    taper: float
    thick: float = 0.11
    knee: float = 0.0

    def edge(self, at: float, back: float = 0.0, up: float = 0.0) -> FloatArray:
        """Return a point `back` and `up` from the right wing's leading edge at a fraction of its span, (3,)."""
        x, y = at * self.half, self.sweep * self.half * at ** (1 + self.knee)
        return np.array([x, self.y + y + back, self.z + self.rise * x + up])

    def build(self, draw: Draw) -> MeshPart:
        """Return both wings."""
        chords = (self.chord, self.chord * self.taper)
        return pair(panel(draw, self.edge(0.0), self.edge(1.0), chords, self.thick, self.knee))

    def winglets(self, draw: Draw) -> MeshPart:
        """Return upturned tips."""
        tip, chord = self.edge(1.0), self.chord * self.taper
        lean = np.array([draw.between(0.003, 0.05), draw.between(0.03, 0.07), draw.between(0.04, 0.1)])
        return pair(panel(draw, tip, tip + lean, (chord, 0.4 * chord)))


def fin(draw: Draw, at: Point, height: float, chord: float, sweep: float, cant: float = 0.0) -> MeshPart:
    """Return a vertical tail, its root's leading edge at a point, canted outwards."""
    root = np.asarray(at, dtype=np.float64)
    tip = root + np.array([cant, sweep, 1.0]) * height
    return panel(draw, root, tip, (chord, chord * draw.between(0.3, 0.7)), 0.1)


def tail(draw: Draw, y: float, z: float, size: float, kind: str) -> MeshPart:
    """Return fin and tailplane: "low" on the body, "T", "cross", "V", or "twin" fins at the plane's ends."""
    sweep, chord, half = draw.between(0.2, 0.9), size * draw.between(0.7, 1.05), size * draw.between(0.8, 1.35)
    if kind == "V":
        lean = draw.between(0.6, 1.2)
        return pair(panel(draw, (0, y, z), (size * lean, y + sweep * size, z + size), (chord * 0.8, chord * 0.45)))
    if kind == "twin":
        plane = pair(panel(draw, (0, y, z), (half, y + 0.1 * size, z), (chord * 0.7, chord * 0.6)))
        return plane + pair(fin(draw, (half, y, z - 0.3 * size), 0.9 * size, chord * 0.7, 0.3))
    lift = {"low": 0.0, "cross": 0.5, "T": 0.97}[kind] * size
    root = y + sweep * lift + 0.05 * size
    tip = (half, root + draw.between(0.1, 0.6) * half, z + lift + draw.between(-0.05, 0.15) * half)
    plane = pair(panel(draw, (0, root, z + lift), tip, (chord * 0.7, chord * draw.between(0.3, 0.6))))
    return fin(draw, (0, y, z), size, chord, sweep) + plane


# ---- engines, wheels, glass --------------------------------------------------------------------------------------


def _along_y(part: MeshPart) -> MeshPart:
    return part.turned("x", -90)


def jet(draw: Draw, r: float, length: float) -> MeshPart:
    """Return a nacelle about the y axis from y = 0: an open barrel with a lip, a fan within, a cone behind."""
    n = draw.round(14)
    skin = [(0.78, 0.12), (0.86, 0.0), (0.95, 0.02), (1.0, 0.2), (0.92, 0.6), (0.7, 0.95)]
    fan, spinner = [(0.78, 0.12), (0.76, 0.3), (0.0, 0.3)], [(0.0, 0.14), (0.25, 0.3)]
    cone = [(0.68, 0.8), (0.45, 1.0), (0.0, 1.25)]
    parts = [revolve(np.array(profile) * (r, length), n) for profile in (skin, fan, spinner, cone)]
    if draw.chance(0.3):
        vane = boxes((0.2 * r, -0.03 * r, 0.26 * length), (0.77 * r, 0.03 * r, 0.3 * length))
        parts.append(around(vane, draw.whole(8, 16)))
    return _along_y(join(parts))


def propeller(draw: Draw, r: float) -> MeshPart:
    """Return spinner and blades about the y axis, its front at y = 0."""
    n, count, spin = draw.round(12), draw.pick((2, 2, 3, 3, 4, 6)), draw.between(0.12, 0.2) * r
    t = np.linspace(0.1, 1.0, draw.round(6))
    chord, twist = r * draw.between(0.1, 0.16) * (0.5 + 1.2 * t * (1.3 - t)), np.radians(70 - 50 * t)
    across = np.array([-0.5, 0.0, 0.5])
    net = np.empty((len(t), 3, 3))
    net[..., 0] = (r * t)[:, None]
    net[..., 1] = (chord * np.cos(twist))[:, None] * across
    net[..., 2] = 1.2 * spin + (chord * np.sin(twist))[:, None] * across
    hub = revolve(np.array([(0.0, 0.0), (0.6, 0.4), (1.0, 1.4), (1.0, 2.0)]) * spin, n)
    return _along_y(hub + around(quad_grid(net), count, draw.between(0, 90)))


def piston(draw: Draw, r: float, length: float, blade: float) -> MeshPart:
    """Return a piston or turboprop engine with its propeller, about the y axis from y = 0."""
    shape = smooth([(0.55, 0.0), (0.95, 0.12), (1.0, 0.4), (0.7, 0.8), (0.0, 1.0)], draw.round(10))
    shape[:, 0] = np.maximum(shape[:, 0], 0.0)
    return _along_y(revolve(np.vstack([[(0, 0)], shape * (r, length)]), draw.round(14))) + propeller(draw, blade)


def gear(draw: Draw, spots: Sequence[tuple[float, float]], z_top: float, z_low: float, r: float) -> MeshPart:
    """Return legs and wheels at (x, y), each mirrored; at x = 0 a pair of wheels on one leg."""
    rows = [(0.0, -0.2), (0.6, -0.25), (0.95, -0.3), (1.0, 0.0), (0.95, 0.3), (0.6, 0.25), (0.0, 0.2)]
    wheel = revolve(np.array(rows) * r, draw.round(13)).turned("y", 90)
    parts = []
    for x, y in spots:
        parts.append(pair(wheel.at(max(x, 0.4 * r), y, z_low + r)))
        leg = rod((0.6 * x, y, z_top), (x, y, z_low + r), 0.18 * r, 6)
        parts.append(pair(leg) if x > 0 else leg)
    return join(parts)


def canopy(draw: Draw, y: float, z: float, w: float, length: float, h: float) -> MeshPart:
    """Return half an ellipsoid of glass on top of a body."""
    return ellipsoid((0, y, z), (w, length / 2, h), draw.round(16), low=0)
