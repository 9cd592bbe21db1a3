"""Military airplanes: old and new fighters, deltas, flying wings, bombers, drones."""

import numpy as np

from zbuf_occlude.meshes.shapes.airplane_parts import (
    Wing,
    airliner_body,
    canopy,
    fin,
    foil,
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
from zbuf_occlude.meshes.shapes.kit import (
    MeshPart,
    around,
    boxes,
    cuboid,
    cylinder,
    ellipsoid,
    join,
    loft,
    pair,
    quad_grid,
    revolve,
    rod,
)


def warbird(draw: Draw) -> MeshPart:
    """Return a fighter of 1940: a big propeller, a canopy, rounded wings; radial or pointed nose."""
    r, radial = draw.between(0.052, 0.085), draw.chance(0.5)
    nose = [(0.0, 0.85, 0.85, 0), (0.06, 1.05, 1.05, 0)] if radial else [(0.0, 0.35, 0.35, 0), (0.1, 0.65, 0.75, 0)]
    rear = [
        (0.25, 0.85, 1.0, 0), (0.45, 0.8, 1.05, 0.05), (0.7, 0.5, 0.75, 0.1), (0.9, 0.2, 0.4, 0.2), (1, 0.05, 0.1, 0.25)
    ]  # fmt: skip
    half, chord, knee = draw.between(0.45, 0.7), draw.between(0.19, 0.32), draw.pick((0.0, 0.8, 1.6))
    sweep, rise = draw.between(0.02, 0.25), draw.between(0.04, 0.14)
    wing = Wing(-draw.between(0.2, 0.3), -0.7 * r, half, sweep, rise, chord, draw.between(0.2, 0.6), 0.13, knee)
    parts = [fuselage(draw, [*nose, *rear], r), wing.build(draw)]
    parts.append(tail(draw, 0.34, 0.4 * r, draw.between(0.12, 0.18), "low"))
    parts.append(canopy(draw, draw.between(-0.08, 0.06), 0.8 * r, 0.45 * r, draw.between(0.14, 0.32), 0.75 * r))
    parts.append(propeller(draw, draw.between(0.13, 0.2)).at(y=-0.53))
    if draw.chance(0.5):
        parts.append(gear(draw, [(2.2 * r, -0.25)], -0.7 * r, -2.6 * r, 0.4 * r))
        parts.append(gear(draw, [(0, 0.45)], 0.1 * r, -0.6 * r, 0.18 * r))
    if draw.chance(0.4):  # guns
        for at in (0.3, 0.36):
            parts.append(pair(rod(wing.edge(at, -0.06), wing.edge(at, 0.1), 0.005, 6)))
    return join(parts)


def fighter(draw: Draw) -> MeshPart:
    """Return a modern jet fighter: one or two engines in the body, one or two fins, missiles."""
    r, twin = draw.between(0.04, 0.062), draw.chance(0.5)
    wide = r * (draw.between(1.3, 1.9) if twin else 1.05)
    rows = [
        (0.0, 0.02 * r, 0.02 * r, -0.1 * r), (0.08, 0.35 * r, 0.35 * r, 0.0), (0.2, 0.7 * r, 0.8 * r, 0.1 * r),
        (0.35, 0.9 * wide, 0.95 * r, 0.0), (0.6, wide, 0.9 * r, 0.0), (0.85, 0.95 * wide, 0.75 * r, 0.0),
        (0.97, 0.8 * wide, 0.6 * r, 0.0),
    ]  # fmt: skip
    sweep, chord = draw.between(0.25, 1.3), draw.between(0.2, 0.42)
    y, half, rise = -draw.between(-0.04, 0.16), draw.between(0.27, 0.46), draw.between(-0.1, 0.08)
    wing = Wing(y, 0, half, sweep, rise, chord, draw.between(0.12, 0.45), 0.05)
    parts = [fuselage(draw, rows, power=draw.pick((2.0, 2.6, 3.5))), wing.build(draw)]
    parts.append(canopy(draw, -0.24, 0.6 * r, 0.5 * r, draw.between(0.16, 0.26), 0.85 * r))
    y, size = draw.between(0.26, 0.34), draw.between(0.11, 0.2)
    if twin or draw.chance(0.2):
        cant = draw.between(0.0, 0.5)
        parts.append(pair(fin(draw, (0.8 * wide, y, 0.3 * r), size, 0.8 * size, draw.between(0.3, 0.9), cant)))
    else:
        parts.append(fin(draw, (0, y - 0.05, 0.5 * r), 1.15 * size, 1.1 * size, draw.between(0.5, 1.0)))
    plane = draw.pick(("tail", "tail", "canard", "none"))
    if plane != "none":
        k = size * draw.between(0.7, 1.1) * (1.0 if plane == "tail" else 0.75)
        a = np.array([0.6 * wide, y + 0.05 if plane == "tail" else -0.22, 0.0])
        b = a + np.array([1.1, 0.7, draw.between(-0.1, 0.1)]) * k
        parts.append(pair(panel(draw, a, b, (0.9 * k, 0.35 * k), 0.05)))
    pipe = [(0.75 * r, 0), (0.6 * r, 0.09), (0.5 * r, 0.02), (0, 0.02)]
    nozzle = revolve(pipe, draw.round(14)).turned("x", -90).at(y=0.44)
    parts.append(pair(nozzle.at(0.5 * wide)) if twin else nozzle)
    if draw.chance(0.75):  # slanted intakes
        x = 0.95 * wide
        intake = boxes((x - 0.35 * r, -0.18, -0.6 * r), (x + 0.3 * r, 0.15, 0.45 * r))
        slant = intake.points.copy()
        slant[:, 1] += 0.6 * r * ((slant[:, 2] < 0) & (slant[:, 1] < 0))
        parts.append(pair(intake.warped(slant)))
    for at in draw.pick(((), (0.5,), (0.45, 0.7), (1.0,), (0.55, 1.0))):
        below = 0.0 if at == 1.0 else 0.3 * r
        store = pod(draw, draw.between(0.1, 0.3) * r, draw.between(0.12, 0.22))
        parts.append(pair(store.at(*wing.edge(at, 0.06, -below))))
    return join(parts)


def delta(draw: Draw) -> MeshPart:
    """Return an airplane with a delta wing: an interceptor, a supersonic airliner, a shuttle."""
    kind = draw.pick(("fighter", "liner", "shuttle"))
    r = {"fighter": 0.05, "liner": 0.03, "shuttle": 0.08}[kind] * draw.between(0.75, 1.3)
    half = {"fighter": 0.29, "liner": 0.22, "shuttle": 0.33}[kind] * draw.between(0.75, 1.35)
    blunt = 0.6 if kind == "shuttle" else 0.05
    nose = 0.35 + 0.4 * blunt
    rows = [
        (0.0, 0.4 * blunt, 0.4 * blunt, -0.2), (0.08, nose, nose, -0.05), (0.25, 0.95, 0.95, 0.0), (0.6, 1.0, 1.0, 0.0),
        (0.9, 0.9, 0.9, 0.0), (0.98, 0.7, 0.8, 0.0),
    ]  # fmt: skip
    y0, y1 = -draw.between(0.1, 0.3), draw.between(0.32, 0.44)
    t = np.linspace(0, 1, draw.round(10))
    bow = 2.4 if kind == "liner" else draw.pick((1.0, 1.0, 1.6, 2.2))
    lead, section = y0 + (y1 - y0) * t ** (1 / bow), foil(0.045, max(4, draw.round(8)))
    chord = (y1 + 0.03 - lead)[:, None]
    rings = np.empty((len(t), len(section), 3))
    rings[..., 0], rings[..., 1] = half * t[:, None], lead[:, None] + chord * section[:, 0]
    rings[..., 2] = -0.5 * r + chord * section[:, 1]
    parts = [fuselage(draw, rows, r), pair(loft(rings))]
    high, deep = draw.between(0.1, 0.22), draw.between(0.15, 0.26)
    parts.append(fin(draw, (0, 0.2, 0.6 * r), high, deep, draw.between(0.5, 1.1)))
    if kind == "fighter":
        parts.append(canopy(draw, -0.22, 0.55 * r, 0.45 * r, 0.2, 0.8 * r))
        parts.append(pair(ellipsoid((r, -0.05, 0), (0.45 * r, 0.14, 0.7 * r), draw.round(12))))
        if draw.chance(0.5):
            parts.append(pair(panel(draw, (0.6 * r, -0.2, 0.3 * r), (0.11, -0.13, 0.3 * r), (0.09, 0.03), 0.05)))
    elif kind == "liner":
        parts.append(pair(cuboid((0.4 * half, 0.12, -1.5 * r), (0.62 * half, 0.44, -0.5 * r), edge=0.05 * r)))
    else:
        bells = around(revolve([(0.2 * r, 0), (0.42 * r, 0.06)], draw.round(14)).at(0.45 * r), 3, 90)
        pods = pair(ellipsoid((0.75 * r, 0.38, 0.75 * r), (0.35 * r, 0.12, 0.35 * r), draw.round(12)))
        parts += [bells.turned("x", -90).at(y=0.46), pods]
    return join(parts)


def flying_wing(draw: Draw) -> MeshPart:
    """Return a flying wing, with a small body or none."""
    chord, sweep = draw.between(0.42, 0.8), draw.between(0.3, 0.9)
    rise, taper = draw.between(0.0, 0.07), draw.between(0.1, 0.35)
    wing = Wing(-0.4 * chord, 0, 1.0, sweep, rise, chord, taper, draw.between(0.06, 0.13))
    size = draw.between(0.7, 1.3)
    radii = (0.16 * size, 0.42 * chord, 0.1 * chord * size)
    parts = [wing.build(draw), ellipsoid((0, 0.02 * chord, 0), radii, draw.round(18))]
    if draw.chance(0.6):
        x, radii = draw.between(0.18, 0.34), (0.05, 0.28 * chord, 0.07 * chord)
        parts.append(pair(ellipsoid((x, 0.1 * chord + sweep * x * 0.5, 0.03 * chord), radii, draw.round(12))))
    kind = draw.pick(("clean", "fins", "props", "facets", "tips"))
    if kind == "fins":
        parts.append(pair(fin(draw, (0.2, 0.3 * chord, 0.0), 0.25 * chord, 0.3 * chord, 0.7, 0.3)))
    elif kind == "tips":
        parts.append(pair(fin(draw, wing.edge(1.0), 0.35 * chord, taper * chord, 0.7, 0.1)))
    elif kind == "props":
        shaft = rod((0.28, 0.3 * chord, 0.02 * chord), (0.28, 0.88 * chord, 0.02 * chord), 0.03 * chord, 8)
        parts.append(pair(propeller(draw, 0.16).turned("z", 180).at(0.28, 0.9 * chord, 0.02 * chord) + shaft))
    elif kind == "facets":
        plan = [(0, -0.75, 0), (0.3, 0.1, 0), (0.12, 0.75, 0), (-0.12, 0.75, 0), (-0.3, 0.1, 0)]
        ring = np.array(plan) * (0.9, chord, 1)
        peak = np.array([0, -0.05 * chord, draw.between(0.15, 0.35) * chord])
        parts.append(loft(np.stack([ring, 0.3 * ring + 0.7 * peak]), caps="last"))
        parts.append(loft(np.stack([ring, 0.6 * ring - (0, 0, 0.1 * chord)]), caps="last"))
        parts.append(pair(fin(draw, (0.06, 0.55 * chord, 0), 0.4 * chord, 0.25 * chord, 0.8, 0.7)))
    return join(parts)


def twin_boom(draw: Draw) -> MeshPart:
    """Return an airplane with two tail booms joined by a tailplane, and a pod between them."""
    half, x, r = draw.between(0.5, 0.85), draw.between(0.13, 0.25), draw.between(0.03, 0.055)
    pusher, chord = draw.chance(0.4), draw.between(0.14, 0.25)
    rows = [(0, 0.4, 0.4, 0), (0.08, 0.9, 0.9, 0), (0.25, 1.0, 1.1, 0), (0.6, 0.6, 0.6, 0.1), (1, 0.2, 0.3, 0.2)]
    if pusher:
        boom = rod((0, -0.15, 0), (0, 0.48, 0), 0.5 * r, draw.round(10))
    else:
        boom = fuselage(draw, rows, r, 0.95) + propeller(draw, draw.between(0.12, 0.17)).at(y=-0.5)
    height = draw.between(0.12, 0.22)
    one = boom.at(x) + fin(draw, (x, 0.38, 0.0 if pusher else -0.08), height, 0.12, 0.3)
    nacelle = [(0, 0.1, 0.1, 0), (0.2, 0.9, 1.0, 0.1), (0.5, 1.1, 1.4, 0.3), (0.9, 0.5, 0.7, 0.2), (1, 0.3, 0.3, 0.1)]
    fat = draw.between(0.9, 1.8) * r
    parts = [pair(one), fuselage(draw, nacelle, fat, draw.between(0.4, 0.6)).at(y=-0.2)]
    sweep, rise, taper = draw.between(0.0, 0.12), draw.between(0.0, 0.1), draw.between(0.35, 0.8)
    parts.append(Wing(-0.25, 0, half, sweep, rise, chord, taper, 0.14).build(draw))
    z = draw.pick((0.05, 0.8 * height))
    parts.append(pair(panel(draw, (0, 0.4, z), (x * 1.1, 0.4, z), (0.1, 0.1))))
    parts.append(canopy(draw, -0.22, 0.9 * fat, 0.6 * fat, 0.2, fat))
    if pusher:
        parts.append(propeller(draw, min(0.12, 0.85 * x)).turned("z", 180).at(y=0.1))
    if draw.chance(0.5):
        parts.append(gear(draw, [(x, -0.1), (0, -0.38)], 0.0, -3.2 * r, 0.6 * r))
    return join(parts)


def bomber(draw: Draw) -> MeshPart:
    """Return a bomber with long thin wings: jets in pods, or piston engines and turrets."""
    r, half = draw.between(0.034, 0.055), draw.between(0.48, 0.75)
    if draw.chance(0.5):
        y, z = -draw.between(0.1, 0.2), draw.pick((-0.6, 0.7)) * r
        wing = Wing(y, z, half, draw.between(0.35, 0.75), draw.between(-0.03, 0.05), 0.16, 0.38)
        parts = [airliner_body(draw, r, upsweep=0.4), wing.build(draw)]
        parts.append(tail(draw, 0.34, 0.5 * r, draw.between(0.13, 0.2), "low"))
        size, twin = 0.45 * r, draw.chance(0.5)
        for at in draw.pick(((0.3, 0.6), (0.35,), (0.25, 0.5, 0.75))):
            x, y, z = wing.edge(at)
            one = jet(draw, size, 4 * size)
            pylon = cuboid((x - 0.15 * size, y - 2 * size, z - 1.6 * size), (x + 0.15 * size, y + size, z))
            parts.append(pair((pair(one.at(1.02 * size)) if twin else one).at(x, y - 3.2 * size, z - 2 * size) + pylon))
        return join(parts)
    knee = draw.pick((0.0, 0.6))
    z, y = draw.pick((-0.5, 0.0, 0.6)) * r, -draw.between(0.12, 0.2)
    sweep, rise, chord = draw.between(0.05, 0.2), draw.between(0.03, 0.09), draw.between(0.15, 0.22)
    wing = Wing(y, z, half, sweep, rise, chord, 0.37, 0.14, knee)
    parts = [airliner_body(draw, r, upsweep=0.3, droop=0.0), wing.build(draw)]
    parts.append(tail(draw, 0.33, 0.4 * r, draw.between(0.14, 0.2), draw.pick(("low", "twin"))))
    size, blade = 0.6 * r, draw.between(0.07, 0.1)
    for at in draw.pick(((0.27,), (0.25, 0.5), (0.25, 0.5))):
        x, y, z = wing.edge(at)
        parts.append(pair(piston(draw, size, 5 * size, blade).at(x, y - 2.5 * size, z)))
    for y, z in ((-0.25, 0.9 * r), (0.1, 0.95 * r), (0.05, -0.95 * r)):
        gun = rod((0.15 * r, y, z), (0.15 * r, y - 1.2 * r, z * 1.25), 0.05 * r, 6)
        parts.append(ellipsoid((0, y, z), (0.45 * r, 0.45 * r, 0.45 * r), draw.round(12)) + pair(gun))
    return join(parts)


def drone(draw: Draw) -> MeshPart:
    """Return a slim unmanned airplane with a V tail, or a frame under a sail."""
    if draw.chance(0.6):
        r = draw.between(0.04, 0.06)
        rows = [
            (0, 0.2, 0.2, 0.3), (0.07, 0.9, 1.1, 0.4), (0.2, 0.9, 1.0, 0.2), (0.4, 0.6, 0.6, 0), (0.85, 0.55, 0.6, 0),
            (0.95, 0.4, 0.4, 0),
        ]  # fmt: skip
        y, half, sweep = -draw.between(-0.02, 0.1), draw.between(0.65, 1.2), draw.between(-0.02, 0.15)
        wing = Wing(y, -0.2 * r, half, sweep, draw.between(-0.02, 0.06), draw.between(0.09, 0.14), 0.45)
        parts = [fuselage(draw, rows, r), wing.build(draw), propeller(draw, 0.1).turned("z", 180).at(y=0.5)]
        tip = (draw.between(0.12, 0.2), 0.4, draw.pick((-1, 1)) * draw.between(0.08, 0.16))
        parts.append(pair(panel(draw, (0, 0.36, 0), tip, (0.09, 0.06))))
        parts.append(ellipsoid((0, -0.38, -r), (0.4 * r, 0.4 * r, 0.4 * r), 10))
        return join([*parts, gear(draw, [(0.8 * r, 0.05), (0, -0.3)], -0.2 * r, -2.8 * r, 0.3 * r)])
    half, chord = draw.between(0.5, 0.85), draw.between(0.18, 0.3)
    z, sweep = draw.between(0.2, 0.34), draw.pick((0.0, draw.between(0.3, 0.6)))
    u, v = np.meshgrid(np.linspace(-1, 1, draw.round(12)), np.linspace(0, 1, 6), indexing="ij")
    height = z + 0.12 * chord * np.sin(np.pi * v) + 0.05 * half * np.abs(u)
    sail = np.stack([half * u, -0.3 + sweep * half * np.abs(u) + chord * (1 - 0.4 * np.abs(u)) * v, height], axis=2)
    frame = [((0, -0.4, -0.12), (0, 0.5, 0.0)), ((0, -0.15, -0.1), (0, -0.1, z))]
    brace = ((0.5 * half, -0.25 + 0.25 * sweep * half, z), (0.0, -0.2, -0.1))
    parts = [quad_grid(sail), *(rod(a, b, 0.004, 8) for a, b in frame), pair(rod(*brace, 0.003, 6))]
    parts.append(cuboid((-0.035, -0.22, -0.12), (0.035, -0.05, -0.06), edge=0.004))
    parts.append(propeller(draw, 0.12).turned("z", 180).at(0, 0.1, 0.1))
    parts.append(gear(draw, [(0.12, 0.0), (0, -0.35)], -0.08, -0.25, 0.028))
    parts.append(cylinder(0.02, 0.05, 0.14, 10).turned("x", 90).at(0, 0.15, 0.1))
    if sweep == 0.0:
        parts.append(tail(draw, 0.42, 0.0, 0.14, "low"))
    return join(parts)
