"""Cars: sedan, hatchback, SUV, van, pickup, sports, open ones; the table of all styles. Nose towards -y, metres."""

from dataclasses import replace

import numpy as np

from zbuf_occlude.meshes.shapes.car_parts import Form, cabin, form_of, hull, seats, trim, wheel, wheels
from zbuf_occlude.meshes.shapes.car_special import bubble, jeep, racer, vintage
from zbuf_occlude.meshes.shapes.curves import bent
from zbuf_occlude.meshes.shapes.draw import Draw
from zbuf_occlude.meshes.shapes.kit import MeshPart, bar, cuboid, join, pair, quad_grid, tube


def _closed(draw: Draw, f: Form, *extras: MeshPart) -> MeshPart:
    return join([hull(draw, f), cabin(draw, f), wheels(draw, f), trim(draw, f), *extras])


def _wing(draw: Draw, f: Form) -> MeshPart:
    """A spoiler on two feet."""
    z, y, h, w = f.deck, f.y(0.95), draw.between(0.08, 0.32), draw.between(0.36, 0.47) * f.width
    board = cuboid((-w, y - 0.12, z + h), (w, y + 0.12, z + h + 0.03), edge=0.012)
    return board + pair(cuboid((0.3 * f.width, y - 0.06, z - 0.05), (0.3 * f.width + 0.03, y + 0.06, z + h)))


def _rack(draw: Draw, f: Form) -> MeshPart:
    """Roof rails, perhaps with a box on them."""
    x, a, b, z = 0.36 * f.width, f.y(f.roof_front) + 0.25, f.y(f.roof_rear) - 0.2, f.height
    rail = bent([(x, a, z - 0.03), (x, a + 0.05, z + 0.07), (x, b - 0.05, z + 0.07), (x, b, z - 0.03)], 0.05)
    bars = [cuboid((-x, y, z + 0.06), (x, y + 0.05, z + 0.08)) for y in (a + 0.3, b - 0.35)]
    parts = [pair(tube(rail, 0.02, 6)), *bars]
    if draw.chance(0.5):
        load = draw.between(0.15, 0.5)
        parts.append(cuboid((-0.8 * x, a + 0.2, z + 0.07), (0.8 * x, b - 0.2, z + load), edge=0.06, steps=2))
    return join(parts)


def _sedan(draw: Draw) -> MeshPart:
    f = form_of(draw, "sedan")
    if draw.chance(0.75):
        return _closed(draw, f)
    y, w, h = f.y(0.5 * (f.roof_front + f.roof_rear)), draw.between(0.2, 0.55), draw.between(0.08, 0.2)  # taxi, police
    return _closed(draw, f, cuboid((-w, y - 0.12, f.height - 0.02), (w, y + 0.12, f.height + h), edge=0.03, steps=2))


def _hatch(draw: Draw) -> MeshPart:
    return _closed(draw, form_of(draw, draw.pick(("hatch", "hatch", "micro"))))


def _wagon(draw: Draw) -> MeshPart:
    f = form_of(draw, draw.pick(("wagon", "limousine", "wagon")))
    return _closed(draw, f, _rack(draw, f)) if f.length < 5.5 and draw.chance(0.5) else _closed(draw, f)


def _suv(draw: Draw) -> MeshPart:
    f, extras = form_of(draw, "suv"), []
    if draw.chance(0.5):
        extras.append(_rack(draw, f))
    if draw.chance(0.5):
        extras.append(wheel(draw, 0.9 * f.wheel, 0.2).turned("z", 90).at(0.1, f.y(1.0) + 0.1, f.belt - 0.2))
    if draw.chance(0.5):
        a, b, z = f.y(f.front_axle) + 0.55, f.y(f.rear_axle) - 0.55, f.clearance
        extras.append(pair(cuboid((0.45 * f.width, a, z), (0.53 * f.width, b, z + 0.06))))
    return _closed(draw, f, *extras)


def van(draw: Draw) -> MeshPart:
    """Return a van or minibus."""
    f = form_of(draw, "van")
    return _closed(draw, f, _rack(draw, f)) if draw.chance(0.35) else _closed(draw, f)


def _sports(draw: Draw) -> MeshPart:
    f = form_of(draw, "sports")
    return _closed(draw, f, _wing(draw, f)) if draw.chance(0.5) else _closed(draw, f)


def _muscle(draw: Draw) -> MeshPart:
    f, extras = form_of(draw, "muscle"), []
    if draw.chance(0.4):
        extras.append(_wing(draw, f))
    if draw.chance(0.5):  # an air scoop
        y, w, z = f.y(0.6 * f.cowl), draw.between(0.15, 0.35), f.belt
        high = z + draw.between(0.0, 0.15)
        extras.append(cuboid((-w, y - 0.3, f.hood - 0.1), (w, y + 0.3, high), edge=0.04, steps=2))
    return _closed(draw, f, *extras)


def _pickup(draw: Draw) -> MeshPart:
    """A cab and an open bed with a cover, hoops or a box."""
    f, load = form_of(draw, "pickup"), draw.pick(("open", "open", "cover", "box", "bars"))
    floor, x, t = f.belt - draw.between(0.35, 0.5), f.width / 2, 0.06
    a, b, axle = f.y(f.tail) + 0.05, f.y(1.0), f.y(f.rear_axle)
    parts = [hull(draw, replace(f, deck=floor)), cabin(draw, f), wheels(draw, f), trim(draw, f)]
    parts.append(pair(cuboid((x - t - 0.06, a, f.wheel + 0.2), (x - 0.04, b, f.deck))))
    parts.append(cuboid((0.05 - x, b - t, floor - 0.2), (x - 0.05, b, f.deck)))
    parts.append(cuboid((0.05 - x, a - t, floor), (x - 0.05, a, f.deck)))
    parts.append(pair(cuboid((x - 0.4, axle - 0.45, floor), (x - t, axle + 0.45, floor + 0.2))))
    if load == "cover":
        parts.append(cuboid((0.06 - x, a, f.deck - 0.02), (x - 0.06, b, f.deck + 0.03), edge=0.01))
    elif load == "box":
        top = f.height + draw.between(0.1, 0.7)
        parts.append(cuboid((0.02 - x, a - 0.02, f.deck - 0.05), (x - 0.02, b + 0.1, top), edge=0.03))
    elif load == "bars":
        y, z = a + 0.1, f.height
        hoop = bent([(0.08 - x, y, f.deck), (0.15 - x, y, z), (x - 0.15, y, z), (x - 0.08, y, f.deck)], 0.1)
        parts += [tube(hoop, 0.035, draw.round(8)), tube(hoop, 0.03, 8).at(y=draw.between(0.4, 0.9))]
    return join(parts)


def _open(draw: Draw) -> MeshPart:
    """A car without a roof: a windscreen, seats, a roll bar or a folded hood."""
    f = form_of(draw, draw.pick(("sports", "sedan", "muscle", "micro")))
    parts = [hull(draw, f), wheels(draw, f), trim(draw, f), seats(draw, f, draw.pick(((0.5,), (0.46, 0.64))))]
    u, rise = np.linspace(-1, 1, draw.round(9)), draw.between(0.2, 0.45)
    low, high = (
        np.column_stack([0.42 * f.width * k * u, f.y(f.cowl) + lean + 0.12 * u**2, np.full(len(u), z)])
        for k, lean, z in ((1.0, 0.0, f.belt), (0.9, 0.9 * rise, f.belt + rise))
    )
    parts += [quad_grid(np.stack([low, high])), tube(high, 0.02, 6)]
    parts += [bar(low[i], high[i], 0.04, 0.04) for i in (0, -1)]
    rear, z = f.y(draw.between(0.6, 0.7)), f.belt
    if draw.chance(0.5):
        hoop = bent([(-0.5, rear, z), (-0.5, rear, z + 0.4), (0.5, rear, z + 0.4), (0.5, rear, z)], 0.15)
        parts.append(tube(hoop, 0.03, draw.round(8)))
    else:
        w = 0.4 * f.width
        parts.append(cuboid((-w, rear, z - 0.05), (w, rear + 0.35, z + draw.between(0.1, 0.25)), edge=0.07, steps=3))
    return join(parts)


STYLES = (
    _sedan, _hatch, _suv, _pickup, _sports, van, _open, _wagon, jeep, _muscle, _sedan, vintage, _hatch, bubble, racer,
)  # fmt: skip

EVERYDAY = (_hatch, _hatch, _sedan, _wagon, _suv)
"""Styles of most cars on a road; `_hatch` is twice as common."""
