"""Airplanes: airliners, business jets, light aircraft, gliders, biplanes, turboprops; the table of all styles."""

import numpy as np

from zbuf_occlude.meshes.shapes.airplane_military import bomber, delta, drone, fighter, flying_wing, twin_boom, warbird
from zbuf_occlude.meshes.shapes.airplane_parts import (
    Wing,
    airliner_body,
    canopy,
    fuselage,
    gear,
    jet,
    panel,
    piston,
    pod,
    propeller,
    tail,
)
from zbuf_occlude.meshes.shapes.draw import Draw
from zbuf_occlude.meshes.shapes.kit import MeshPart, bar, cuboid, join, pair, rod


def _airliner(draw: Draw) -> MeshPart:
    """Swept low wings with two or four jets below them."""
    r, tip = draw.between(0.036, 0.07), draw.between(0.18, 0.36)
    half, sweep, chord = draw.between(0.36, 0.6), draw.between(0.3, 0.8), draw.between(0.13, 0.25)
    y, rise, knee = -draw.between(0.05, 0.17), draw.between(0.03, 0.14), draw.pick((0.0, 0.25))
    wing = Wing(y, -0.55 * r, half, sweep, rise, chord, tip, knee=knee)
    parts = [airliner_body(draw, r, upsweep=draw.between(0.3, 0.8)), wing.build(draw)]
    y, size = draw.between(0.3, 0.37), draw.between(0.12, 0.19)
    parts.append(tail(draw, y, 0.5 * r, size, draw.pick(("low", "low", "low", "cross"))))
    size = r * draw.between(0.38, 0.75)
    for at in draw.pick(((0.33,), (0.27,), (0.4,), (0.3, 0.58))):
        x, y, z = wing.edge(at, 0, -1.15 * size)
        thin, long = 0.1 * size, 1.2 * size
        pylon = cuboid((x - thin, y - long, z + 0.8 * size), (x + thin, y + long, z + 1.3 * size))
        parts.append(pair(jet(draw, size, 3.4 * size).at(x, y - 2.2 * size, z) + pylon))
    if draw.chance(0.5):
        parts.append(wing.winglets(draw))
    if draw.chance(0.25):  # an upper deck
        hump = [(0, 0.1, 0.1, 0.5), (0.2, 0.7, 0.7, 0.8), (0.6, 0.7, 0.7, 0.8), (1, 0.1, 0.1, 0.5)]
        parts.append(fuselage(draw, hump, r, 0.45).at(y=-0.2))
    if draw.chance(0.4):
        parts.append(gear(draw, [(0, -0.38), (1.6 * r, 0.06)], -0.5 * r, -2.4 * r, 0.35 * r))
    return join(parts)


def _business(draw: Draw) -> MeshPart:
    """Jets beside the tail and a high tailplane."""
    r, half = draw.between(0.042, 0.07), draw.between(0.36, 0.55)
    sweep, chord = draw.between(0.05, 0.65), draw.between(0.12, 0.21)
    y, rise, taper = -draw.between(-0.02, 0.12), draw.between(0.03, 0.1), draw.between(0.25, 0.5)
    wing = Wing(y, -0.7 * r, half, sweep, rise, chord, taper)
    parts = [airliner_body(draw, r, upsweep=draw.between(0.3, 0.7), droop=0.3), wing.build(draw)]
    parts.append(tail(draw, draw.between(0.3, 0.36), 0.4 * r, draw.between(0.14, 0.21), draw.pick(("T", "T", "cross"))))
    size, y, z = r * draw.between(0.4, 0.7), draw.between(0.14, 0.25), draw.between(0.2, 0.6) * r
    stub = cuboid((0.5 * r, y + size, z - 0.1 * size), (r + 0.6 * size, y + 2.6 * size, z + 0.1 * size))
    parts.append(pair(jet(draw, size, draw.between(3.5, 5) * size).at(r + 0.95 * size, y, z) + stub))
    if draw.chance(0.25):
        parts.append(jet(draw, size, 3 * size).at(0, 0.3, 1.3 * r))
    if draw.chance(0.5):
        parts.append(wing.winglets(draw))
    if draw.chance(0.4):
        parts.append(gear(draw, [(0, -0.36), (1.3 * r, 0.08)], -0.5 * r, -2.2 * r, 0.3 * r))
    return join(parts)


def _light(draw: Draw) -> MeshPart:
    """One propeller in front; a high wing with struts or a low wing; wheels or floats."""
    r, high, cabin = draw.between(0.055, 0.09), draw.chance(0.55), draw.between(1.1, 1.6)
    rows = [
        (0.02, 0.6, 0.6, 0.0), (0.08, 0.85, 0.8, 0.0), (0.2, 1.0, 0.95, 0.05), (0.32, 1.0, cabin, 0.25),
        (0.45, 1.0, cabin, 0.25), (0.6, 0.7, 0.75, 0.2), (0.85, 0.35, 0.4, 0.3), (1.0, 0.1, 0.2, 0.35),
    ]  # fmt: skip
    body = fuselage(draw, rows, r, power=draw.pick((2.0, 2.8, 4.0)))
    rise = draw.between(0.0, 0.04) if high else draw.between(0.04, 0.14)
    z0, half, chord = (1.45 * r if high else -0.6 * r), draw.between(0.5, 0.82), draw.between(0.14, 0.24)
    y, sweep, taper = -draw.between(0.2, 0.28), draw.between(-0.02, 0.07), draw.between(0.45, 1.0)
    wing = Wing(y, z0, half, sweep, rise, chord, taper, 0.14)
    kind = draw.pick(("low", "low", "cross", "T", "V"))
    parts = [body, wing.build(draw), tail(draw, 0.33, 0.4 * r, draw.between(0.13, 0.2), kind)]
    parts.append(propeller(draw, draw.between(0.1, 0.16)).at(y=-0.52))
    if high:
        foot = (0.5 * r, wing.y + 0.4 * chord, -0.6 * r)
        parts.append(pair(bar(foot, wing.edge(0.5, 0.4 * chord), 0.013, 0.007)))
    ground = -draw.between(2.0, 3.0) * r
    if draw.chance(0.25):
        legs = [bar((0.4 * r, y, -0.6 * r), (1.5 * r, y, ground + 0.3 * r), 0.011, 0.007) for y in (-0.22, 0.0)]
        parts.append(pair(join([pod(draw, 0.33 * r, 0.75).at(1.5 * r, -0.06, ground), *legs])))
    elif draw.chance(0.6):
        parts.append(gear(draw, [(1.6 * r, -0.12), (0, -0.38)], -0.6 * r, ground, 0.35 * r))
    else:
        parts.append(gear(draw, [(1.6 * r, -0.28)], -0.6 * r, ground, 0.42 * r))
        parts.append(gear(draw, [(0, 0.46)], 0.1 * r, -0.5 * r, 0.18 * r))
    return join(parts)


def _biplane(draw: Draw) -> MeshPart:
    """Two or three wings above each other, with struts."""
    r = draw.between(0.05, 0.09)
    rows = [
        (0.0, 0.7, 0.7, 0.0), (0.07, 0.95, 0.95, 0.0), (0.25, 0.95, 1.0, 0.0), (0.5, 0.8, 0.95, 0.05),
        (0.8, 0.4, 0.5, 0.1), (1.0, 0.08, 0.15, 0.15),
    ]  # fmt: skip
    half, chord, gap = draw.between(0.42, 0.75), draw.between(0.13, 0.22), draw.between(0.16, 0.28)
    y, stagger, count = -draw.between(0.2, 0.3), draw.between(-0.06, 0.12), draw.pick((2, 2, 2, 3))
    levels = -0.9 * r + gap * np.linspace(0, 1 if count == 2 else 1.25, count)
    fronts, lower, taper = y - stagger * np.linspace(0, 1, count), draw.between(0.65, 1.0), draw.between(0.7, 1.0)
    parts = [fuselage(draw, rows, r, power=draw.pick((2.0, 3.0, 5.0)))]
    for i, (front, z) in enumerate(zip(fronts, levels, strict=True)):
        reach = half * (lower + (1 - lower) * i / (count - 1))
        parts.append(Wing(front, z, reach, 0.04, 0.03, chord, taper, 0.08).build(draw))
    for x in draw.pick(((0.7,), (0.4, 0.75))):
        for back in (0.15 * chord, 0.75 * chord):
            a, b = (x * lower * half, fronts[0] + back, levels[0]), (x * lower * half, fronts[-1] + back, levels[-1])
            parts.append(pair(bar(a, b, 0.011, 0.007)))
    top = (1.2 * r, fronts[-1] + 0.3 * chord, levels[-1])
    parts.append(pair(bar((0.6 * r, y + 0.3 * chord, 0.6 * r), top, 0.008, 0.007)))
    parts.append(tail(draw, 0.36, 0.1 * r, draw.between(0.1, 0.16), "low"))
    parts.append(propeller(draw, draw.between(0.13, 0.2)).at(y=-0.53))
    parts.append(cuboid((-0.4 * r, 0.05, 0.85 * r), (0.4 * r, 0.07, 1.25 * r)))
    parts.append(gear(draw, [(1.7 * r, y + 0.1)], -0.6 * r, -2.7 * r, 0.5 * r))
    parts.append(rod((-1.7 * r, y + 0.1, -2.2 * r), (1.7 * r, y + 0.1, -2.2 * r), 0.005, 6))
    return join(parts)


def _glider(draw: Draw) -> MeshPart:
    """Very long, very thin wings."""
    r, hump = draw.between(0.04, 0.065), draw.between(0.9, 1.4)
    rows = [
        (0.0, 0.05, 0.05, -0.2), (0.06, 0.6, 0.7, -0.1), (0.2, 1.0, 1.15 * hump, 0.0), (0.35, 0.85, hump, 0.05),
        (0.5, 0.4, 0.45, 0.15), (0.9, 0.2, 0.22, 0.2), (1.0, 0.08, 0.1, 0.2),
    ]  # fmt: skip
    half, chord = draw.between(0.8, 1.6), draw.between(0.09, 0.16)
    sweep, rise = draw.between(-0.05, 0.08), draw.between(0.0, 0.12)
    y, taper, knee = -draw.between(0.12, 0.24), draw.between(0.25, 0.7), draw.pick((0.0, 0.6))
    wing = Wing(y, 0.8 * r, half, sweep, rise, chord, taper, 0.13, knee)
    kind = draw.pick(("T", "T", "V", "cross"))
    parts = [fuselage(draw, rows, r), wing.build(draw), tail(draw, 0.4, 0.2 * r, draw.between(0.12, 0.2), kind)]
    parts.append(canopy(draw, -0.32, 0.5 * r, 0.6 * r, 0.25, 0.75 * r))
    if draw.chance(0.5):
        parts.append(wing.winglets(draw))
    if draw.chance(0.3):  # struts, as on trainers
        parts.append(pair(bar((0.5 * r, wing.y + 0.05, -0.6 * r), wing.edge(0.35, 0.05), 0.012, 0.006)))
    return join(parts)


def _turboprop(draw: Draw) -> MeshPart:
    """Two or four propellers on the wing: commuter, cargo, seaplane, old airliner."""
    cargo = draw.chance(0.4)
    r = draw.between(0.06, 0.09) if cargo else draw.between(0.042, 0.065)
    high = cargo or draw.chance(0.55)
    half, chord, z = draw.between(0.42, 0.75), draw.between(0.1, 0.18), (0.95 * r if high else -0.7 * r)
    y, sweep = -draw.between(0.03, 0.16), draw.between(-0.02, 0.12)
    wing = Wing(y, z, half, sweep, draw.between(0.0, 0.09), chord, draw.between(0.3, 0.75), 0.14)
    kind = draw.pick(("low", "T") if cargo else ("low", "T", "cross", "twin"))
    parts = [airliner_body(draw, r, upsweep=0.9 if cargo else 0.55, droop=0.2), wing.build(draw)]
    parts.append(tail(draw, 0.34, 0.7 * r, draw.between(0.15, 0.23), kind))
    size, blade = r * draw.between(0.3, 0.48), draw.between(0.05, 0.085)
    for at in draw.pick(((0.3,), (0.25,), (0.3, 0.58))):
        x, y, height = wing.edge(at)
        parts.append(pair(piston(draw, size, 6 * size, blade).at(x, y - 3.2 * size, height - 0.3 * size)))
    if draw.chance(0.25):  # a flying boat
        hull = [(0, 0.05, 0.05, 0), (0.2, 0.7, 0.6, -0.1), (0.7, 0.7, 0.6, -0.1), (1, 0.05, 0.05, 0.2)]
        parts.append(fuselage(draw, hull, r, 0.6).at(0, -0.15, -0.8 * r))
        x, y, height = wing.edge(0.75, 0.4 * chord)
        post = bar((x, y, -0.5 * r), (x, y, height), 0.015, 0.008)
        parts.append(pair(pod(draw, 0.3 * r, 0.16).at(x, y, -0.5 * r) + post))
    elif draw.chance(0.5):
        parts.append(gear(draw, [(0, -0.38), (1.4 * r, 0.0)], -0.6 * r, -2.1 * r, 0.35 * r))
    return join(parts)


def _canard(draw: Draw) -> MeshPart:
    """A home-built airplane: the small wing in front, the propeller behind."""
    r, half, chord = draw.between(0.06, 0.09), draw.between(0.6, 0.9), draw.between(0.16, 0.24)
    rows = [
        (0, 0.2, 0.2, -0.1), (0.15, 0.7, 0.7, 0), (0.4, 1.0, 1.15, 0.15), (0.65, 0.95, 1.0, 0.1), (0.9, 0.6, 0.6, 0),
        (1, 0.4, 0.4, 0),
    ]  # fmt: skip
    y, sweep, rise = draw.between(0.0, 0.1), draw.between(0.3, 0.55), draw.between(-0.02, 0.05)
    wing = Wing(y, -0.2 * r, half, sweep, rise, chord, draw.between(0.35, 0.6))
    parts = [fuselage(draw, rows, r), wing.build(draw), canopy(draw, -0.1, 0.7 * r, 0.7 * r, 0.35, 0.9 * r)]
    front = draw.between(0.25, 0.42)
    parts.append(pair(panel(draw, (0, -0.42, 0), (front, -0.42 + draw.between(0, 0.08), 0), (0.09, 0.06))))
    parts.append(pair(panel(draw, wing.edge(1.0), wing.edge(1.0, 0.12, 0.2) * 1.01, (0.1, 0.06))))
    parts.append(propeller(draw, draw.between(0.12, 0.17)).turned("z", 180).at(y=0.52))
    if draw.chance(0.6):
        parts.append(gear(draw, [(1.8 * r, 0.1), (0, -0.36)], -0.5 * r, -2.4 * r, 0.35 * r))
    return join(parts)


STYLES = (
    _airliner, _light, fighter, _business, _biplane, _turboprop, _airliner, delta, warbird, _glider, fighter,
    flying_wing, _light, bomber, twin_boom, drone, _canard,
)  # fmt: skip
