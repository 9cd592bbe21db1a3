"""Parts of cars: proportions by kind, body, cabin, wheels, trim, seats. Nose towards -y, metres."""

from dataclasses import dataclass

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.meshes.shapes.curves import circle, cosd, rectangle
from zbuf_occlude.meshes.shapes.draw import Draw
from zbuf_occlude.meshes.shapes.kit import (
    MeshPart,
    along,
    around,
    bar,
    cuboid,
    cylinder,
    ellipsoid,
    fan,
    join,
    loft,
    pair,
    repeated,
    revolve,
    rod,
    tube,
)


@dataclass(frozen=True)
class Form:
    """Proportions of one car: lengths in metres, positions along the car as fractions from nose (0) to tail (1).

    Parameters
    ----------
    length, width, height, clearance : float
        Outer sizes; `height` is the roof's.
    belt, hood, deck : float
        Heights of the windows' lower edge, and of the body in front of and behind the cabin.
    cowl, roof_front, roof_rear, tail : float
        Start and end of the windscreen, and of the rear window.
    wheel, front_axle, rear_axle : float
        Radius and positions of the wheels.
    blunt : float
        Exponent of the outline of nose and tail in plan: 3 is round, 9 is square.
    narrow : float
        Width of the roof over width at the belt.
    """

    length: float
    width: float
    height: float
    belt: float
    hood: float
    deck: float
    cowl: float
    roof_front: float
    roof_rear: float
    tail: float
    clearance: float
    wheel: float
    front_axle: float
    rear_axle: float
    blunt: float = 9.0
    narrow: float = 0.9

    def y(self, fraction: float) -> float:
        """Return the y coordinate of a fraction of the length."""
        return (fraction - 0.5) * self.length


RANGES: dict[str, dict[str, tuple[float, float]]] = {
    "sedan": {
        "length": (4.1, 5.4), "width": (1.66, 1.98), "height": (1.34, 1.56), "belt": (0.84, 1.0), "hood": (0.66, 0.86),
        "deck": (0.84, 1.04), "cowl": (0.24, 0.35), "roof_front": (0.39, 0.47), "roof_rear": (0.62, 0.73),
        "tail": (0.77, 0.88), "clearance": (0.14, 0.24), "wheel": (0.28, 0.37), "front_axle": (0.15, 0.22),
        "rear_axle": (0.75, 0.82), "blunt": (3.0, 8.0), "narrow": (0.7, 0.88),
    },
    "hatch": {"length": (3.3, 4.4), "height": (1.36, 1.64), "deck": (0.86, 0.97), "cowl": (0.2, 0.3),
              "roof_front": (0.34, 0.44), "roof_rear": (0.78, 0.91), "tail": (0.92, 0.985), "rear_axle": (0.79, 0.87)},
    "wagon": {"length": (4.3, 5.2), "height": (1.38, 1.6), "roof_rear": (0.86, 0.94), "tail": (0.95, 0.985)},
    "suv": {"length": (3.9, 5.2), "width": (1.74, 2.05), "height": (1.6, 2.0), "belt": (1.0, 1.22),
            "hood": (0.9, 1.16), "deck": (1.0, 1.18), "roof_rear": (0.86, 0.95), "tail": (0.95, 0.985),
            "clearance": (0.24, 0.36), "wheel": (0.34, 0.47), "blunt": (5.0, 11.0), "narrow": (0.76, 0.92)},
    "van": {"length": (4.0, 5.9), "width": (1.7, 2.1), "height": (1.7, 2.5), "belt": (0.94, 1.2), "hood": (0.8, 1.05),
            "deck": (0.96, 1.14), "cowl": (0.06, 0.2), "roof_front": (0.18, 0.34), "roof_rear": (0.93, 0.97),
            "tail": (0.975, 0.99), "front_axle": (0.14, 0.21), "blunt": (4.0, 11.0), "narrow": (0.8, 0.95)},
    "sports": {"length": (3.8, 4.8), "width": (1.74, 2.08), "height": (1.06, 1.32), "belt": (0.68, 0.86),
               "hood": (0.48, 0.72), "deck": (0.72, 0.92), "cowl": (0.28, 0.46), "roof_front": (0.46, 0.54),
               "roof_rear": (0.57, 0.68), "tail": (0.78, 0.95), "clearance": (0.08, 0.15), "blunt": (2.6, 5.5),
               "narrow": (0.64, 0.8)},
    "muscle": {"length": (4.5, 5.4), "height": (1.24, 1.44), "belt": (0.84, 0.97), "hood": (0.76, 0.92),
               "cowl": (0.34, 0.44), "roof_front": (0.46, 0.53), "roof_rear": (0.6, 0.7), "tail": (0.76, 0.94),
               "blunt": (6.0, 12.0)},
    "limousine": {"length": (6.0, 9.0), "cowl": (0.17, 0.22), "roof_front": (0.25, 0.3), "roof_rear": (0.78, 0.85),
                  "tail": (0.86, 0.92), "front_axle": (0.1, 0.13), "rear_axle": (0.82, 0.87)},
    "micro": {"length": (2.4, 3.3), "width": (1.45, 1.68), "height": (1.4, 1.68), "cowl": (0.12, 0.24),
              "roof_front": (0.3, 0.42), "roof_rear": (0.78, 0.9), "tail": (0.93, 0.985), "blunt": (2.6, 5.0),
              "rear_axle": (0.79, 0.86)},
    "pickup": {"length": (4.6, 6.2), "width": (1.76, 2.1), "height": (1.55, 2.0), "belt": (1.04, 1.24),
               "hood": (0.92, 1.18), "deck": (0.96, 1.2), "cowl": (0.22, 0.32), "roof_front": (0.33, 0.41),
               "roof_rear": (0.47, 0.65), "tail": (0.5, 0.68), "clearance": (0.24, 0.42), "wheel": (0.34, 0.47),
               "blunt": (6.0, 12.0)},
    "bubble": {"length": (3.4, 4.4), "height": (1.4, 1.62), "belt": (0.86, 1.02), "hood": (0.58, 0.74),
               "deck": (0.78, 0.96), "cowl": (0.28, 0.38), "roof_front": (0.4, 0.45), "roof_rear": (0.6, 0.7),
               "tail": (0.9, 0.98), "blunt": (2.3, 3.2), "narrow": (0.64, 0.76)},
}  # fmt: skip
"""Ranges of the proportions of each kind; those missing in a row are as in the first."""


def form_of(draw: Draw, kind: str) -> Form:
    """Draw the proportions of a car of a kind."""
    ranges = RANGES["sedan"] | RANGES[kind]
    values = {name: draw.between(*ranges[name]) for name in RANGES["sedan"]}
    values["tail"] = max(values["tail"], values["roof_rear"] + 0.012)
    return Form(**values)


def hull(draw: Draw, f: Form) -> MeshPart:
    """Return the body below the windows: cross-sections along the car, cut out at the wheels."""
    arch, turns = f.wheel * draw.between(1.08, 1.25), np.linspace(180, 0, draw.round(11))
    ends = [0.004, 0.015, 0.03, 0.97, 0.985, 0.996, f.cowl, f.tail]
    stations = [np.linspace(0, 1, draw.round(26)), np.array(ends)]
    for axle in (f.front_axle, f.rear_axle):
        around_wheel = np.concatenate([1.0001 * cosd(turns), [-1.001, 1.001]])
        stations.append(axle + arch / f.length * around_wheel)
    t = np.unique(np.clip(np.concatenate(stations), 0.0, 1.0))
    nose, rear, rake = draw.between(0.6, 0.85), draw.between(0.6, 0.9), draw.between(0.3, 0.7)
    knots = np.array([
        (0.0, nose * f.hood), (0.012, (0.5 + 0.5 * nose) * f.hood), (0.05, f.hood),
        (0.6 * f.cowl, f.hood + rake * (f.belt - f.hood)), (f.cowl, f.belt),
        (f.tail, max(f.belt, f.deck) if f.tail < 0.93 else f.belt), (0.99, f.deck), (1.0, rear * f.deck),
    ])  # fmt: skip
    top = np.interp(t, knots[:, 0], knots[:, 1])
    out = np.abs(2 * t - 1)  # distance from the middle
    half = f.width / 2 * (1 - draw.between(0.06, 0.24) * out**f.blunt - 4.0 * np.clip(out - 0.97, 0, 1))
    bottom = f.clearance + draw.between(0.7, 2.0) * np.clip(out - 0.9, 0, 1)
    for axle in (f.front_axle, f.rear_axle):
        above = arch**2 - ((t - axle) * f.length) ** 2
        bottom = np.where(above > 0, np.maximum(bottom, f.wheel + np.sqrt(np.maximum(above, 0))), bottom)
    waist, bulge = draw.between(0.86, 0.98), draw.between(0.25, 0.6)
    side = np.array([
        (0.0, 0.0), (0.7, 0.0), (0.9, 0.0), (0.97, 0.12), (1.0, bulge), (0.5 + 0.5 * waist, 0.5 * bulge + 0.4),
        (waist + 0.01, 0.88), (waist - 0.05, 0.96), (0.72, 1.0), (0.35, 1.015), (0.0, 1.02),
    ])  # fmt: skip
    section = np.vstack([side, side[-2:0:-1] * (-1, 1)])
    rings = np.empty((len(t), len(section), 3))
    rings[..., 0] = half[:, None] * section[:, 0]
    rings[..., 1] = ((t - 0.5) * f.length)[:, None]
    height = f.clearance + section[:, 1] * (top - f.clearance)[:, None]
    rings[..., 2] = np.maximum(height, np.minimum(bottom, top - 0.01)[:, None])
    return loft(rings)


def cabin(draw: Draw, f: Form) -> MeshPart:
    """Return the windows as rounded rectangles from belt to roof, with pillars and roof slightly outside them."""
    n, rise = draw.round(6) // 2 + 1, f.height - f.belt
    levels = np.array([-0.15, 0.0, 0.5, 0.85, 0.95, 1.0])
    shrink = np.array([1.0, 1.0, 1.0, 1.0, 0.97, draw.between(0.8, 0.92)])
    wide = f.width * draw.between(0.86, 0.93) * (1 - (1 - f.narrow) * np.clip(levels, 0, 1) ** 1.3) * shrink

    def ring_at(level: float, width: float, squeeze: float, out: float) -> FloatArray:
        k = float(np.clip(level, 0, 1))
        front, rear = f.y(f.cowl + (f.roof_front - f.cowl) * k), f.y(f.tail + (f.roof_rear - f.tail) * k**1.15)
        length = max((rear - front) * (0.5 + 0.5 * squeeze) + 2 * out, 0.3)
        outline = rectangle(width + 2 * out, length, 0.16 * width, n)
        ring = np.column_stack([outline, np.full(len(outline), f.belt + level * rise)])
        return ring + np.array([0.0, (front + rear) / 2, 0.0])

    rows = list(zip(levels, wide, shrink, strict=True))
    panes = np.stack([ring_at(*row, -0.012) for row in rows])
    parts = [loft(panes, caps="none").glazed(), fan(panes[-1])]
    parts.append(loft(np.stack([ring_at(*row, 0.012) for row in rows[3:]]), caps="last"))
    low, high = ring_at(0.0, wide[1], 1.0, 0.008), ring_at(0.88, wide[3], 1.0, 0.008)
    corners = np.arange(4) * (n + 1) + n // 2
    parts += [bar(low[i], high[i], 0.09, 0.07) for i in corners]
    for s in draw.pick(((0.5,), (0.38, 0.72), (0.45,))):  # pillars between the doors
        ends = [(1 - s) * ring[corners[2]] + s * ring[corners[1]] for ring in (low, high)]
        foot, head = (np.array([-w / 2, end[1], end[2]]) for w, end in zip(wide[[1, 3]], ends, strict=True))
        parts.append(pair(bar(foot, head, 0.06, 0.05)))
    return join(parts)


def wheel(draw: Draw, r: float, width: float) -> MeshPart:
    """Return tyre, rim and spokes about the x axis, the face towards +x."""
    n, w, rim = draw.round(22), width / 2, r * draw.between(0.55, 0.75)
    tyre = [
        (rim, -w), (0.93 * r, -w), (r, -0.6 * w), (r, 0.6 * w),
        (0.93 * r, w), (rim, w), (0.96 * rim, 0.7 * w), (0.9 * rim, 0.3 * w),
    ]  # fmt: skip
    parts = [revolve(tyre, n), revolve([(0.0, -0.3 * w), (0.92 * rim, -0.3 * w)], n)]
    parts.append(cylinder(0.2 * rim, -0.3 * w, 0.7 * w, draw.round(10)))
    kind = draw.pick(("spokes", "disc", "dish", "wire"))
    if kind == "spokes":
        spoke = bar((0.1 * rim, 0, 0.5 * w), (0.95 * rim, 0, 0.55 * w), draw.between(0.12, 0.3) * rim, 0.05)
        parts.append(around(spoke, draw.whole(4, 10)))
    elif kind == "wire":
        spoke = rod((0.1 * rim, 0, 0.6 * w), (0.95 * rim, 0.12 * rim, 0.4 * w), 0.012, 5)
        parts.append(around(spoke, draw.whole(10, 16)))
    else:
        disc = [(0.92, 0.45), (0.6, 0.7), (0.3, 0.55), (0, 0.62)]
        dish = [(0.92, 0.6), (0.8, 0.1), (0.25, 0.1), (0.2, 0.5), (0, 0.5)]
        parts.append(revolve(np.array(disc if kind == "disc" else dish) * (rim, w), n))
    return join(parts).turned("y", 90)


def wheels(draw: Draw, f: Form, width: float | None = None, out: float = 0.0) -> MeshPart:
    """Return the four wheels, their outer sides flush with the body or `out` beyond it."""
    w = draw.between(0.17, 0.28) if width is None else width
    one, x = wheel(draw, f.wheel, w), f.width / 2 - w / 2 + 0.005 + out
    return join(pair(one.at(x, f.y(axle), f.wheel)) for axle in (f.front_axle, f.rear_axle))


def trim(draw: Draw, f: Form) -> MeshPart:
    """Return a random selection of bumpers, lamps, grille, mirrors, handles and plates."""
    y0, y1, w = f.y(0.0), f.y(1.0), f.width
    parts = [cuboid((-0.25, y1 - 0.02, f.clearance + 0.25), (0.25, y1 + 0.03, f.clearance + 0.36))]
    if draw.chance(0.8):
        z, high, deep = f.clearance + 0.1, draw.between(0.1, 0.2), draw.between(0.06, 0.14)
        for y in (y0 - deep / 2, y1 - deep / 2):
            far = (0.42 * w, y + deep, z + high)
            parts.append(cuboid((-0.42 * w, y, z), far, edge=0.3 * deep, steps=draw.whole(1, 3)))
    x, z, s = 0.33 * w, f.clearance + 0.68 * (f.hood - f.clearance), draw.between(0.07, 0.11)
    kind = draw.pick(("round", "slit", "box", "none"))
    if kind == "round":
        parts.append(pair(cylinder(s, -0.03, 0.09, draw.round(14)).turned("x", 90).at(x, y0 + 0.05, z)))
    elif kind == "slit":
        parts.append(pair(ellipsoid((x, y0 + 0.1, z + 0.04), (0.16, 0.14, 0.05), draw.round(14))))
    elif kind == "box":
        parts.append(pair(cuboid((x - 0.13, y0 - 0.01, z - 0.06), (x + 0.1, y0 + 0.1, z + 0.07), edge=0.015)))
    if draw.chance(0.7):
        rear = f.clearance + 0.7 * (f.deck - f.clearance)
        parts.append(pair(cuboid((0.28 * w, y1 - 0.08, rear - 0.07), (0.39 * w, y1 + 0.01, rear + 0.08), edge=0.01)))
    if draw.chance(0.6):
        slat = cuboid((-0.2 * w, y0 - 0.015, 0), (0.2 * w, y0 + 0.03, 0.012))
        parts.append(repeated(slat, along("z", np.linspace(z - 0.1, z + 0.07, draw.whole(3, 8)))))
    if draw.chance(0.8):
        y, z = f.y(f.cowl) + 0.35, f.belt + 0.05
        glass = cuboid((0.5 * w, y - 0.05, z), (0.5 * w + 0.17, y + 0.05, z + 0.12), edge=0.03, steps=2)
        parts.append(pair(glass + bar((0.44 * w, y, z), (0.5 * w + 0.05, y, z + 0.05), 0.04, 0.03)))
    if draw.chance(0.5):
        z = f.belt - 0.12
        handles = [cuboid((0.49 * w, y, z), (0.5 * w + 0.01, y + 0.16, z + 0.025)) for y in (f.y(0.5), f.y(0.68) - 0.1)]
        parts.append(pair(join(handles)))
    if draw.chance(0.4):
        pipe = rod((0.28 * w, y1 - 0.3, f.clearance), (0.28 * w, y1 + 0.06, f.clearance), 0.035, draw.round(8))
        parts.append(pair(pipe))
    return join(parts)


def seats(draw: Draw, f: Form, rows: tuple[float, ...]) -> MeshPart:
    """Return pairs of seats at fractions of the length, and a steering wheel, for cars with a visible interior."""
    one = cuboid((-0.22, -0.25, 0), (0.22, 0.25, 0.18), edge=0.05, steps=2)
    one = one + cuboid((-0.22, 0.0, 0.1), (0.22, 0.14, 0.7), edge=0.05, steps=2).turned("x", -12).at(y=0.2)
    n = draw.round(16)
    ring = tube(np.column_stack([circle(n) * 0.18, np.zeros(n)]), 0.014, 6, closed=True)
    steering = (ring + rod((0, 0, 0), (0, 0, -0.3), 0.02, 6)).turned("x", 60)
    placed = [pair(one.at(0.36, f.y(row), f.belt - 0.42)) for row in rows]
    return join([*placed, steering.at(-0.36, f.y(rows[0]) - 0.48, f.belt + 0.08)])
