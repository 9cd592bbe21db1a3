"""Bottles: wine, beer, water, jugs, flasks, sprays, dispensers and more. Upright, decimetres."""

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.meshes.shapes.curves import bent, circle, cosd, polygon, rectangle, sind, smooth, superellipse
from zbuf_occlude.meshes.shapes.draw import Draw
from zbuf_occlude.meshes.shapes.kit import (
    MeshPart,
    cuboid,
    cylinder,
    ellipsoid,
    join,
    loft,
    pair,
    prism,
    quad_grid,
    revolve,
    rod,
    tube,
)


def round_corners(profile: ArrayLike, draw: Draw) -> FloatArray:
    """Return a profile of (radius, z) rows with slightly rounded corners, as of glass."""
    return bent(profile, draw.between(0.03, 0.12), max(2, draw.round(5) - 2))


def notched(count: int, depth: float) -> FloatArray:
    """Return a circle whose every second point is `depth` farther out: ribs, teeth, flutes."""
    return circle(count) * np.where(np.arange(count) % 2, 1.0, 1.0 + depth)[:, None]


def closure(draw: Draw, r: float, z: float, kind: str) -> MeshPart:
    """Return a closure for a neck of radius r whose mouth is at height z."""
    n = draw.round(20)
    if kind == "cork":
        return cylinder(0.92 * r, z - 0.2, z + draw.between(0.05, 0.3), n, r * draw.between(0.92, 1.2))
    if kind == "crown":
        return revolve([(1.15 * r, z - 0.06), (1.02 * r, z + 0.06), (0, z + 0.08)], 42, notched(42, 0.1))
    if kind == "screw":
        half = draw.between(0.06, 0.22)
        ribs = notched(2 * draw.round(16), 0.05)
        return revolve([(1.15 * r, z - half), (1.15 * r, z + half), (0, z + half)], 0, ribs)
    if kind == "ball":
        s = draw.between(1.1, 2.2) * r
        return ellipsoid((0, 0, z + 0.9 * s), (s, s, s), n) + cylinder(0.9 * r, z - 0.15, z + 0.2, n)
    if kind == "cone":
        tip = z + draw.between(0.3, 0.85)
        return revolve([(1.1 * r, z - 0.05), (1.1 * r, z + 0.08), (0.25 * r, tip), (0.0, tip + 0.03)], n)
    if kind == "flip":
        lid = cylinder(1.25 * r, 0, 0.05, n).at(y=-1.25 * r).turned("x", -draw.between(0, 110))
        return cylinder(1.25 * r, z - 0.15, z + 0.15, n) + lid.at(0, 1.25 * r, z + 0.17)
    if kind == "foil":
        return revolve([(1.06 * r, z - 1.0), (1.08 * r, z - 0.1), (1.22 * r, z), (1.1 * r, z + 0.12), (0, z + 0.14)], n)
    return revolve([(1.15 * r, z - 0.12), (1.22 * r, z - 0.06), (1.15 * r, z), (0.8 * r, z)], n)


def glass(draw: Draw, profile: FloatArray, closures: tuple[str, ...], section: FloatArray | None = None) -> MeshPart:
    """Return a bottle from its profile: the outer surface, sometimes the inner one and a label, and a closure."""
    n = draw.round(28)
    parts = [revolve(profile, n, section)]
    kind = draw.pick(closures)
    if kind == "open" or draw.chance(0.15):
        wall = draw.between(0.02, 0.05)
        inner = np.maximum(profile - (wall, 0), (0.02, profile[:, 1].min() + 2 * wall))
        parts.append(revolve(inner, n, section))
    if kind != "open":
        parts.append(closure(draw, float(profile[-1, 0]), float(profile[-1, 1]), kind))
    if section is None and draw.chance(0.4):
        parts.append(paper_label(draw, profile))
    return join(parts)


def paper_label(draw: Draw, profile: FloatArray) -> MeshPart:
    """Return a label around part of the body: a second sheet just off the glass."""
    height = np.ptp(profile[:, 1])
    low = profile[:, 1].min() + draw.between(0.12, 0.25) * height
    z = np.linspace(low, low + draw.between(0.1, 0.28) * height, 6)
    order = np.argsort(profile[:, 1], kind="stable")
    r = np.interp(z, profile[order, 1], profile[order, 0])[:, None] * 1.012 + 0.004
    angle = np.linspace(-90, draw.pick((90, 180, 270)), draw.round(24))
    return quad_grid(np.stack([r * cosd(angle), r * sind(angle), z[:, None] * np.ones(len(angle))], axis=2))


def handle(draw: Draw, low: tuple[float, float], high: tuple[float, float], out: float, thick: float) -> MeshPart:
    """Return a handle in the xz plane from the point (x, z) `low` to the point `high`, at most `out` away."""
    (x0, z0), (x1, z1) = low, high
    x = max(x0, x1) + out
    knots = [(x0 - 0.03, 0, z0), (x, 0, 0.6 * z0 + 0.4 * z1), (x, 0, 0.15 * z0 + 0.85 * z1), (x1 - 0.03, 0, z1)]
    return tube(smooth(knots, draw.round(14)), thick, draw.round(8), flat=draw.pick((1.0, 0.6)))


# ---- styles --------------------------------------------------------------------------------------------------------


def _wine(draw: Draw) -> MeshPart:
    """Bordeaux with shoulders, Burgundy with slopes, hock as a spindle, champagne with a heavy foot."""
    r, h, neck = draw.between(0.3, 0.62), draw.between(2.3, 3.6), draw.between(0.1, 0.19)
    shape = draw.pick(("bordeaux", "burgundy", "hock", "champagne"))
    if shape == "bordeaux":
        s = draw.between(0.5, 0.7) * h
        body = [(r, 0.1), (r, s), (0.8 * r, s + 0.22), (neck, s + 0.4), (neck * 0.95, h - 0.12)]
    elif shape == "burgundy":
        s = draw.between(0.3, 0.52) * h
        body = [(r, 0.1), (r, s), (0.75 * r, s + 0.35), (neck * 1.2, s + 0.85), (neck, h - 0.12)]
    elif shape == "hock":
        s = draw.between(0.3, 0.5) * h
        body = [(0.8 * r, 0.1), (0.8 * r, s), (0.5 * r, s + 0.25 * h), (neck, s + 0.42 * h), (neck, h - 0.12)]
    else:
        r, s = 1.15 * r, draw.between(0.32, 0.45) * h
        body = [(r, 0.12), (r, s), (0.7 * r, s + 0.18 * h), (neck * 1.15, s + 0.38 * h), (neck, h - 0.15)]
    punt = [(0, 0.25), (0.6 * r, 0.02), (0.9 * r, 0)]
    lip = [(neck * 1.25, h - 0.11), (neck * 1.25, h - 0.03), (neck, h)]
    profile = np.vstack([punt, smooth(body, draw.round(24)), lip])
    return glass(draw, profile, ("open", "cork", "foil", "none", "foil", "ball"))


def _beer(draw: Draw) -> MeshPart:
    """Long neck, stubby, swing-top; a waisted soda bottle."""
    r, neck, kind = draw.between(0.26, 0.5), draw.between(0.1, 0.18), draw.pick(("long", "stubby", "contour", "swing"))
    h = draw.between(1.3, 1.9) if kind == "stubby" else draw.between(2.0, 2.8)
    if kind == "contour":
        waist = draw.between(0.6, 0.85) * r
        body = [(0.85 * r, 0.05), (r, 0.3), (waist, 0.28 * h), (1.05 * waist, 0.38 * h), (1.02 * r, 0.52 * h)]
        body += [(0.7 * r, 0.72 * h), (neck * 1.1, 0.88 * h), (neck, h - 0.08)]
    else:
        s = draw.between(0.42, 0.62) * h
        body = [(0.96 * r, 0.04), (r, 0.12), (r, s), (0.85 * r, s + 0.2), (neck * 1.2, s + 0.28 * h), (neck, h - 0.08)]
    lip = [(1.25 * neck, h - 0.07), (1.25 * neck, h - 0.02), (neck, h)]
    profile = np.vstack([[(0, 0.08), (0.7 * r, 0.0)], smooth(body, draw.round(24)), lip])
    flutes = notched(4 * draw.round(10), 0.06) if kind == "contour" and draw.chance(0.6) else None
    if kind != "swing":
        return glass(draw, profile, ("crown", "crown", "open", "ball"), flutes)
    wire = bent([(neck * 1.3, 0, h - 0.35), (neck * 2.2, 0, h - 0.1), (neck * 1.1, 0, h + 0.25)], 0.05)
    return glass(draw, profile, ("ball",)) + pair(tube(wire, 0.02, 6))


def _water(draw: Draw) -> MeshPart:
    """Plastic bottles with rings and a petaloid base; a canister for a cooler."""
    r, h, neck = draw.between(0.28, 0.75), draw.between(1.7, 3.4), draw.between(0.1, 0.22)
    z = np.linspace(0.25, draw.between(0.62, 0.78) * h, 2 * draw.round(24))
    rings, depth = draw.whole(2, 9), draw.between(0.01, 0.1)
    wave = r * (1 - depth * (0.5 + 0.5 * np.cos(2 * np.pi * rings * (z - z[0]) / np.ptp(z))))
    wave *= 1 - draw.pick((0.0, 0.15, 0.28)) * np.exp(-(((z / h - 0.42) / 0.09) ** 2))
    top = h - z[-1]
    throat = [(0.5 * r, h - 0.35 * top), (neck, h - 0.2 * top), (neck, h)]
    knots = [(wave[-1], z[-1]), (0.9 * r, z[-1] + 0.2 * top), *throat]
    profile = np.vstack([np.column_stack([wave, z]), smooth(knots, draw.round(12))[1:]])
    n = 5 * draw.round(8)
    petals = 0.5 + 0.5 * np.cos(5 * np.radians(360 * np.arange(n) / n))
    size = np.array([[0.35], [0.55], [1.0]]) + np.array([[0.35], [0.35], [0.0]]) * petals
    foot = np.empty((3, n, 3))
    foot[..., :2] = wave[0] * size[..., None] * circle(n)
    foot[..., 2] = np.array([[0.0], [0.08], [0.25]]) + np.array([[0.08], [0.04], [0.0]]) * (1 - petals)
    collar = revolve([(neck * 1.4, h - 0.17 * top), (neck * 1.4, h - 0.14 * top)], n)
    parts = [revolve(profile, n), loft(foot, caps="first"), collar]
    parts.append(closure(draw, neck, h, draw.pick(("screw", "screw", "cone", "flip"))))
    if draw.chance(0.4):
        parts.append(paper_label(draw, profile))
    return join(parts)


def _spirit(draw: Draw) -> MeshPart:
    """Square, oval, many-sided or flat: whisky, gin, hip flask, scent."""
    h, wide, n = draw.between(1.1, 2.9), draw.between(0.32, 0.85), draw.round(32)
    flat = draw.pick((1.0, 1.0, draw.between(0.3, 0.75)))
    kind = draw.pick(("square", "oval", "sides", "flutes", "squircle"))
    section = {
        "square": rectangle(2, 2, draw.between(0.1, 0.5), draw.round(5)),
        "oval": circle(n),
        "sides": polygon(draw.pick((5, 6, 8)), 0, 2),
        "squircle": superellipse(n, 4.0),
        "flutes": notched(4 * draw.round(9), 0.08),
    }[kind]
    s, slope = draw.between(0.4, 0.78) * h, draw.between(0.02, 0.4)
    taper, neck = draw.between(0.75, 1.25), draw.between(0.1, 0.22)
    throat = neck / wide * 1.3
    shoulder = [(1.0, s), (0.9, s + 0.04 + 0.3 * slope), (throat, s + slope + 0.08)]
    profile = np.array([(0, 0), (0.92 * taper, 0), (taper, 0.06), *shoulder]) * (wide, 1)
    top, n = s + slope + draw.between(0.2, 0.9), draw.round(20)
    lip = [(1.25 * neck, top - 0.07), (1.25 * neck, top), (neck, top)]
    stem = [(neck * 1.3, s + slope), (neck, s + slope + 0.12), (neck, top - 0.08)]
    parts = [revolve(profile, 0, section).scaled(y=flat), revolve([*stem, *lip], n)]
    stopper = draw.pick(("ball", "cork", "screw", "square", "open"))
    if stopper == "square":
        a = draw.between(1.2, 2.6) * neck
        parts.append(cuboid((-a, -a * flat, top), (a, a * flat, top + draw.between(0.15, 0.6)), edge=0.03))
    elif stopper != "open":
        parts.append(closure(draw, neck, top, stopper))
    if kind == "square" and draw.chance(0.6):
        paper = prism(rectangle(1.3 * wide, 0.02), 0.25 * s, 0.75 * s)
        parts.append(paper.at(y=-wide * flat * max(1.0, taper)))
    return join(parts)


def _bulb(draw: Draw) -> MeshPart:
    """Round bellies: chianti, carafe, flask, decanter, gourd."""
    r, h, neck = draw.between(0.5, 1.0), draw.between(1.6, 3.0), draw.between(0.09, 0.22)
    kind = draw.pick(("ball", "gourd", "cone", "drop", "ship"))
    end, top = [(neck * 1.2, 0.84 * h), (neck, h)], [(0.25 * r, 0.86 * h), (neck, h)]
    body = {
        "ball": [(0.5 * r, 0.0), (0.95 * r, 0.35 * r), (r, r), (0.7 * r, 1.65 * r), (neck, 2.05 * r), (neck, h)],
        "gourd": [(0.5 * r, 0), (0.85 * r, 0.3 * h), (0.35 * r, 0.52 * h), (0.5 * r, 0.68 * h), *top],
        "cone": [(0.97 * r, 0.0), (r, 0.1), (0.55 * r, 0.45 * h), (neck * 1.2, 0.72 * h), *end],
        "drop": [(0.3 * r, 0.0), (0.7 * r, 0.25 * h), (0.75 * r, 0.4 * h), (0.4 * r, 0.65 * h), *end],
        "ship": [(0.95 * r, 0), (1.15 * r, 0.08 * h), (0.9 * r, 0.25 * h), (neck * 1.3, 0.5 * h), *end],
    }[kind]
    h = max(h, body[-2][1] + 0.1)
    body[-1] = (body[-1][0], h)
    lip = [(neck * 1.25, h), (neck * 1.25, h + 0.06), (neck, h + 0.06)]
    profile = np.vstack([[(0.0, 0.06)], smooth(body, draw.round(28)), lip])
    parts = [glass(draw, profile, ("open", "ball", "cork", "cone", "open"))]
    if draw.chance(0.3):
        parts.append(handle(draw, (0.75 * r, 0.4 * h), (neck, 0.92 * h), draw.between(0.1, 0.3), 0.06))
    if kind == "ball" and draw.chance(0.5):  # a straw basket
        latitude = np.linspace(-75, 10, 8)
        belt = np.column_stack([1.04 * r * cosd(latitude), r + 1.04 * r * sind(latitude)])
        parts.append(revolve(belt, draw.round(24)))
    return join(parts)


def _jug(draw: Draw) -> MeshPart:
    """A gallon jug with a handle at the neck; an amphora with two; a ewer with a lip."""
    r, h, neck = draw.between(0.45, 0.9), draw.between(1.6, 3.0), draw.between(0.13, 0.3)
    kind = draw.pick(("gallon", "amphora", "ewer"))
    if kind == "gallon":
        s, top = draw.between(0.45, 0.68) * h, draw.between(0.8, 0.9) * h
        knots = [(0.97 * r, 0.05), (r, 0.15), (r, s), (0.7 * r, 0.5 * (s + top)), (neck, top), (neck, h)]
        profile = np.vstack([[(0, 0.05), (0.8 * r, 0)], smooth(knots, draw.round(22))])
        ear = handle(draw, (neck, top - 0.06 * h), (neck, 0.97 * h), draw.between(0.1, 0.35), 0.05)
        return glass(draw, profile, ("screw", "cork", "open")) + (pair(ear) if draw.chance(0.4) else ear)
    if kind == "amphora":
        belly, collar = draw.between(0.45, 0.65) * h, draw.between(0.78, 0.84) * h
        knots = [(0.12 * r, 0.0), (0.2 * r, 0.1), (0.6 * r, 0.5 * belly), (0.85 * r, belly)]
        knots += [(0.55 * r, 0.5 * (belly + collar)), (neck, collar), (neck, 0.95 * h), (neck * 1.5, h)]
        profile = smooth(knots, draw.round(28))
        ears = pair(handle(draw, (0.75 * r, belly + 0.06 * h), (neck, 0.95 * h), draw.between(0.0, 0.25), 0.05))
        skin = glass(draw, profile, ("open", "open", "cork"))
        return join([skin, ears, cylinder(0.35 * r, -0.06, 0.03, draw.round(20), 0.2 * r)])
    belly = draw.between(0.15, 0.4) * h
    knots = [(0.55 * r, 0), (0.8 * r, belly), (0.65 * r, belly + 0.2 * h)]
    knots += [(neck, 0.75 * h), (neck * 1.1, 0.9 * h), (neck * 1.8, h)]
    skin = glass(draw, np.vstack([[(0, 0.03)], smooth(knots, draw.round(26))]), ("open",))
    lip = skin.points.copy()
    lip[:, 0] -= 0.5 * neck * np.clip((lip[:, 2] / h - 0.88) / 0.12, 0, 1) ** 2 * np.clip(-lip[:, 0] / neck, 0, 2)
    ear = handle(draw, (0.7 * r, belly + 0.1 * h), (neck, 0.93 * h), draw.between(0.15, 0.5), 0.06)
    return skin.warped(lip) + ear


def _dispenser(draw: Draw) -> MeshPart:
    """Soap and shampoo: a pump or a trigger on a body of any cross-section."""
    wide, h, n, flat = draw.between(0.32, 0.72), draw.between(1.0, 2.4), draw.round(28), draw.between(0.45, 1.0)
    waist = draw.between(0.6, 0.85)
    body = draw.pick((
        [(0.97, 0), (1, 0.05), (1, 0.82), (0.8, 0.93)],
        [(1.0, 0), (1.03, 0.05), (waist, 0.7), (0.5, 0.95)],
        [(0.95, 0), (1.0, 0.12), (waist, 0.5), (0.9, 0.75), (0.6, 0.95)],
        [(0.6, 0), (0.9, 0.15), (1.05, 0.4), (waist, 0.75), (0.45, 0.95)],
    ))  # fmt: skip
    profile = np.vstack([[(0, 0)], smooth([*body, (0.35, 1)], draw.round(20))]) * (wide, h)
    parts = [revolve(profile, n, superellipse(n, draw.between(2.0, 5.0)) * (1, flat))]
    parts.append(cylinder(0.42 * wide * flat, h - 0.03, h + 0.22, n))
    if draw.chance(0.5):  # a pump
        top, reach = h + draw.between(0.25, 0.6), draw.between(0.3, 0.8)
        spout = bent([(0, 0, top), (-reach, 0, top), (-reach - 0.05, 0, top - 0.15)], 0.08)
        parts += [cylinder(0.06, h, top, 12), cylinder(0.13, top - 0.05, top + 0.08, draw.round(14))]
        parts.append(tube(spout, np.linspace(0.07, 0.04, len(spout)), draw.round(8)))
    else:  # a trigger
        z, reach = h + draw.between(0.2, 0.4), draw.between(0.4, 0.65)
        lever = smooth([(-0.25, 0, z), (-0.42, 0, z - 0.25), (-0.36, 0, z - 0.65)], 7)
        parts.append(cuboid((-reach, -0.14, z), (0.38, 0.14, z + 0.32), edge=0.08, steps=draw.whole(1, 3)))
        parts += [cylinder(0.12, h + 0.1, z + 0.1, 12), tube(lever, 0.07, draw.round(8))]
        parts.append(rod((-reach - 0.16, 0, z + 0.16), (-reach + 0.02, 0, z + 0.16), 0.08, draw.round(10)))
    return join(parts)


def _squeeze(draw: Draw) -> MeshPart:
    """Ketchup, glue, mustard, lotion: soft bodies with a nozzle, some of them on their cap."""
    wide, h, n, flat = draw.between(0.28, 0.65), draw.between(1.1, 2.5), draw.round(26), draw.between(0.35, 1.0)
    shoulder, neck = draw.between(0.6, 1.0), draw.between(0.25, 0.6)
    knots = [(0.0, 0.02), (0.9, 0.0), (1.0, 0.08), (draw.between(0.75, 1.25), 0.45)]
    knots += [(shoulder, 0.8), (0.5 * (shoulder + neck), 0.95), (neck, 1.0)]
    profile = np.maximum(smooth(knots, draw.round(24)) * (wide, h), (0.0, -1.0))
    body = revolve(profile, n, superellipse(n, 2.4) * (1, flat))
    if draw.chance(0.3):
        cap = cylinder(0.8 * wide, 0, 0.4, n, 0.75 * wide).scaled(y=0.5 + 0.5 * flat)
        return body.scaled(z=-1).at(z=h + 0.3) + cap
    return body + closure(draw, neck * wide, h, draw.pick(("cone", "screw", "flip")))


def _canister(draw: Draw) -> MeshPart:
    """Thermos, sports bottle, shaker, pill jar, baby bottle, gas bottle."""
    r, n = draw.between(0.32, 0.65), draw.round(28)
    kind = draw.pick(("thermos", "sport", "pills", "baby", "gas", "shaker"))
    h = draw.between(0.9, 1.5) if kind == "pills" else draw.between(1.7, 3.0)
    if kind == "gas":
        z, angle = draw.between(0.6, 0.8) * h, np.linspace(0, 78, 9)
        dome = np.column_stack([r * cosd(angle), z + 0.8 * r * sind(angle)])
        skin = revolve(np.vstack([[(0, 0.1), (0.8 * r, 0.05), (r, 0.2)], dome]), n)
        collar = revolve([(0.6 * r, z + 0.6 * r), (0.6 * r, z + r + 0.1)], n)
        base = revolve([(0.8 * r, 0.0), (0.8 * r, 0.2)], n)
        valve = cylinder(0.16, z + 0.75 * r, z + 0.75 * r + 0.3, n)
        return join([skin, collar, base, valve, cuboid((-0.25, -0.05, z + r), (0.1, 0.05, z + r + 0.1))])
    if kind == "pills":
        steps = [(0, 0), (r, 0), (r, 0.75 * h), (0.8 * r, 0.8 * h), (0.8 * r, 0.9 * h)]
        return revolve(round_corners(steps, draw), n) + closure(draw, 0.85 * r, h - 0.1, draw.pick(("screw", "flip")))
    s = draw.between(0.6, 0.78) * h
    upper = [(0.92 * r, s + 0.02 * h), (0.92 * r, s + 0.05 * h), (0.75 * r, s + 0.07 * h)]
    parts = [revolve(round_corners([(0, 0), (r * draw.between(0.8, 1.1), 0), (r, s), *upper], draw), n)]
    if kind == "thermos":
        cup = [(0.95 * r, s + 0.03 * h), (0.9 * r, s + 0.06 * h), (0.75 * r, 1.02 * h), (0, 1.02 * h)]
        parts.append(revolve(round_corners(cup, draw), n))
        if draw.chance(0.7):
            parts.append(handle(draw, (r, 0.3 * s), (r, 0.9 * s), draw.between(0.12, 0.4), 0.06))
    elif kind == "baby":
        teat = [(0.9, 0.1), (0.9, 0.3), (0.5, 0.4), (0.22, 0.7), (0.25, 0.95), (0, 1.0)]
        parts.append(revolve(smooth(teat, draw.round(16)) * (r, h - s), n).at(z=s))
    elif kind == "sport":
        lid = np.array([(1.02, -0.1), (1.02, 0.35), (0.4, 0.5), (0.22, 0.6), (0.22, 0.95), (0, 1.0)])
        parts.append(revolve(np.column_stack([lid[:, 0] * r, s + lid[:, 1] * (h - s)]), n))
        if draw.chance(0.6):
            z, top = s + 0.3 * (h - s), h + 0.25
            loop = bent([(-0.8 * r, 0, z), (-0.8 * r, 0, top), (0.8 * r, 0, top), (0.8 * r, 0, z)], 0.4)
            parts.append(tube(loop, 0.06, draw.round(8)))
    else:
        cap = [(0.95 * r, s + 0.03 * h), (0.6 * r, 0.95 * h), (0.35 * r, h), (0.35 * r, 1.08 * h), (0, 1.1 * h)]
        parts.append(revolve(round_corners(cap, draw), n))
    return join(parts)


def _detergent(draw: Draw) -> MeshPart:
    """A plastic can with an integral handle and a large cap off centre."""
    w, d, h, n = draw.between(0.8, 1.6), draw.between(0.4, 0.9), draw.between(1.3, 2.4), draw.round(28)
    s, aside = draw.between(0.4, 0.7), draw.between(0.0, 0.25)
    z = np.array([0, 0.06, s - 0.1, s + 0.05, 0.5 * s + 0.45, 0.92, 0.97])
    grow = np.array([0.94, 1, 1, 0.96, draw.between(0.65, 0.85), 0.45, 0.3])
    rings = np.empty((len(z), n, 3))
    rings[..., :2] = grow[:, None, None] * superellipse(n, draw.between(3, 7)) * (0.5 * w, 0.5 * d)
    rings[..., 0] -= aside * w * np.clip((z - s) / (1 - s), 0, 1)[:, None]
    rings[..., 2] = h * z[:, None]
    knots = [(0.44 * w, 0, (s - 0.05) * h), (0.46 * w, 0, 0.75 * h), (0.2 * w, 0, 0.95 * h), (-0.12 * w, 0, 0.9 * h)]
    grip = tube(smooth(knots, draw.round(14)), draw.between(0.07, 0.15), draw.round(10))
    cap = draw.between(0.13, 0.3)
    spout = closure(draw, cap, 1.02 * h, draw.pick(("screw", "screw", "flip"))) + cylinder(cap, 0.9 * h, 1.03 * h, n)
    parts = [loft(rings), grip, spout.at(-aside * w)]
    if draw.chance(0.4):
        parts.append(cuboid((-0.3 * w, -0.51 * d, 0.15 * h), (0.3 * w, -0.49 * d, (s - 0.15) * h)))
    return join(parts)


def _vial(draw: Draw) -> MeshPart:
    """Scent and ink: a small neck on a low body, with a stopper of any size."""
    r, h, n = draw.between(0.45, 0.9), draw.between(0.6, 1.3), draw.round(26)
    power = draw.pick((2.0, 2.0, 3.0, 6.0))
    body = draw.pick((
        [(0.8, 0), (1.0, 0.15), (1.0, 0.6), (0.7, 0.9)],
        [(0.5, 0), (1.0, 0.45), (0.8, 0.8), (0.4, 0.95)],
        [(1.0, 0), (0.9, 0.4), (0.6, 0.85)],
    ))  # fmt: skip
    section = superellipse(n, power) * (1, draw.between(0.4, 1.0))
    skin = revolve(np.vstack([[(0, 0)], smooth([*body, (0.25, 1.0)], draw.round(20))]) * (r, h), n, section)
    neck, top = 0.25 * r, h + draw.between(0.08, 0.3)
    parts = [skin, cylinder(neck, h - 0.05, top, n)]
    kind, s = draw.pick(("ball", "crystal", "disc", "tall")), draw.between(0.2, 0.5)
    if kind == "ball":
        parts.append(ellipsoid((0, 0, top + 0.8 * s), (s, s, s), n))
    elif kind == "crystal":
        profile = np.array([(0.3, 0), (1.0, 0.7), (0.6, 1.6), (0.0, 1.8)]) * s
        parts.append(revolve(profile, 0, polygon(draw.whole(4, 8))).at(z=top))
    elif kind == "disc":
        parts.append(cylinder(1.3 * s, -0.06, 0.06, n).turned("x", 90).at(z=top + 1.2 * s))
    else:
        parts.append(cylinder(1.2 * neck, top - 0.05, top + 2.2 * s, n))
    return join(parts)


STYLES = (
    _wine, _beer, _water, _spirit, _bulb, _dispenser, _jug, _squeeze, _canister, _wine, _spirit, _detergent, _vial
)  # fmt: skip
