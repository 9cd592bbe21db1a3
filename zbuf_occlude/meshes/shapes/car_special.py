"""Special cars: jeeps, rounded cars, cars before 1940, racers. Nose towards -y, metres."""

import numpy as np

from zbuf_occlude.meshes.shapes.car_parts import Form, form_of, hull, seats, trim, wheel, wheels
from zbuf_occlude.meshes.shapes.curves import bent, circle, cosd, rectangle, sind, smooth
from zbuf_occlude.meshes.shapes.draw import Draw
from zbuf_occlude.meshes.shapes.furniture import frame
from zbuf_occlude.meshes.shapes.kit import (
    MeshPart,
    along,
    bar,
    boxes,
    cuboid,
    cylinder,
    ellipsoid,
    join,
    loft,
    pair,
    quad_grid,
    repeated,
    revolve,
    rod,
    shell,
    tube,
)


def jeep(draw: Draw) -> MeshPart:
    """Return a jeep of flat sheets: a tub, square wings, hoops or a canvas top, a spare wheel behind."""
    w, length = draw.between(1.4, 1.75), draw.between(3.0, 4.4)
    z, r = draw.between(0.42, 0.65), draw.between(0.34, 0.48)
    belt, y0, y1 = z + draw.between(0.45, 0.7), -length / 2, length / 2
    cowl, top, half = y0 + draw.between(0.3, 0.42) * length, belt + draw.between(0.5, 0.9), draw.between(0.28, 0.4) * w
    x = w / 2
    tub = boxes(
        [(-x, cowl, z), (-x, cowl, z), (x - 0.05, cowl, z), (-x, y1 - 0.05, z)],
        [(x, y1, z + 0.05), (0.05 - x, y1, belt), (x, y1, belt), (x, y1, belt)],
    )
    lamp = cylinder(0.09, 0, 0.06, draw.round(14)).turned("x", 90).at(0.78 * half, y0, belt - 0.15)
    slat = cuboid((-0.02, y0 - 0.03, z + 0.1), (0.02, y0 + 0.02, belt - 0.1))
    grille = repeated(slat, along("x", np.linspace(-0.5 * half, 0.5 * half, draw.whole(5, 8))))
    middle, wide = 0.5 * (half + x), 0.4 * (x - half) + 0.1
    wing = cuboid((half, y0 - 0.05, 2 * r + 0.05), (x + 0.05, cowl - 0.1, 2 * r + 0.11))
    wing = wing + bar((middle, cowl - 0.15, 2 * r + 0.08), (middle, cowl + 0.2, z), wide, 0.05)
    f = Form(length, w + 0.1, top, belt, belt, belt, 0.35, 0.36, 0.9, 0.95, z, r, 0.18, draw.between(0.74, 0.82))
    hood = cuboid((-half, y0, z), (half, cowl + 0.1, belt), edge=draw.pick((0.0, 0.04)))
    parts = [tub, hood, pair(wing + lamp), grille]
    parts += [wheels(draw, f, draw.between(0.18, 0.32)), seats(draw, f, (0.5, 0.72))]
    parts.append(cuboid((-0.45 * w, y0 - 0.12, z), (0.45 * w, y0 - 0.02, z + 0.14)))
    parts.append(bar((0, y0 + 0.2, r), (0, y1 - 0.2, r), 0.6 * w, 0.12))
    parts.append(frame(w, top - belt, 0.05, 0.04).at(0, cowl + 0.02, belt))
    if draw.chance(0.8):
        parts.append(wheel(draw, r, 0.22).turned("z", 90).at(0, y1 + 0.12, belt - 0.05))
    roof = draw.pick(("none", "hoops", "canvas", "hard"))
    if roof in ("hoops", "canvas"):
        hoop = bent([(0.05 - x, 0, belt), (0.1 - x, 0, top), (x - 0.1, 0, top), (x - 0.05, 0, belt)], 0.15)
        parts += [tube(hoop, 0.03, draw.round(7)).at(y=y) for y in (cowl + 0.9, y1 - 0.15)]
        if roof == "canvas":
            parts.append(quad_grid(np.stack([hoop * 1.02 + (0, y, -0.01) for y in (cowl + 0.02, cowl + 0.9, y1)])))
    elif roof == "hard":
        parts.append(cuboid((-x, cowl, top - 0.03), (x, y1, top + 0.04), edge=0.03, steps=2))
        parts += [pair(cuboid((x - 0.07, y, belt), (x, y + 0.08, top))) for y in (cowl + 1.0, y1 - 0.1)]
    return join(parts)


def bubble(draw: Draw) -> MeshPart:
    """Return a rounded car with protruding wings."""
    f, n = form_of(draw, "bubble"), draw.round(16)
    low, w = f.clearance + 0.25, f.width
    front, middle, rear = draw.between(0.24, 0.3), draw.between(0.48, 0.54), draw.between(0.66, 0.74)
    long, high = draw.between(0.27, 0.33), draw.between(0.8, 0.95) * f.height
    rows = [(front, 0.3, 0.27, 1.05 * f.belt), (middle, 0.39, long, f.height), (rear, 0.36, 0.3, high)]
    domes = [
        ellipsoid((0, f.y(at), low), (wide * w, long * f.length, high - low), 2 * n, low=0)
        for at, wide, long, high in rows
    ]
    parts = [hull(draw, f).scaled(x=0.78), *domes, wheels(draw, f, 0.17), trim(draw, f)]
    angle = np.linspace(-10, 190, n)
    reach = f.wheel * draw.between(1.1, 1.3)
    section = [(0.3, 1.02), (0.44, 1.0), (0.5, 0.92), (0.51, 0.82)]
    arcs = [np.column_stack([np.full(n, x * w), k * reach * cosd(angle), k * reach * sind(angle)]) for x, k in section]
    wing = pair(quad_grid(np.stack(arcs)))
    parts += [wing.at(0, f.y(axle), f.wheel) for axle in (f.front_axle, f.rear_axle)]
    a, b, z = f.y(f.front_axle) + 0.3, f.y(f.rear_axle) - 0.3, f.clearance
    board = cuboid((0.36 * w, a, z), (0.49 * w, b, z + 0.05))
    return join([*parts, pair(board)])


def vintage(draw: Draw) -> MeshPart:
    """Return a car from before 1940: a long narrow hood, an upright cabin, sweeping wings, thin wheels."""
    w, length, r = draw.between(1.5, 1.8), draw.between(3.4, 5.2), draw.between(0.34, 0.46)
    z, hood, roof = r + 0.05, draw.between(0.95, 1.2), draw.between(1.5, 1.95)
    y0, y1, cowl = 0.25 - length / 2, length / 2 - draw.between(0.0, 0.3), -draw.between(0.0, 0.15) * length
    closed = draw.chance(0.7)
    arch = np.column_stack([cosd(a := np.linspace(0, 180, draw.round(10))), 0.55 + 0.45 * sind(a)])
    section = np.vstack([[(1, 0)], arch, [(-1, 0)]])
    rings = [
        np.column_stack([0.3 * w * k * section[:, 0], np.full(len(section), y), z + (h - z) * section[:, 1]])
        for y, k, h in ((y0, 0.75, hood - 0.05), (cowl, 1.1, hood))
    ]
    middle = (y1 + cowl - 0.25) / 2
    wall = rectangle(0.86 * w, y1 - cowl - 0.25, 0.14, draw.round(4))
    walls = [(z, 0.96), (hood, 1.0), (roof - 0.1, 0.95), (roof - 0.02, 0.85), (roof, 0.6)][: 5 if closed else 2]
    house = loft(np.stack([np.column_stack([wall * k + (0, middle), np.full(len(wall), h)]) for h, k in walls]))
    front, rear = y0 + 0.2, length / 2 - 0.65
    low, top, back = 0.4, 2.05 * r, 1.4 * r
    ahead = [(front - 1.15 * r, 0.9 * r), (front - 0.4 * r, top), (front + 0.6 * r, 1.9 * r), (front + 2.3 * r, low)]
    behind = [(rear - 2.2 * r, 0.9 * low), (rear - 1.15 * r, back), (rear, top), (rear + 1.1 * r, back)]
    behind.append((rear + 1.3 * r, r))
    sweep = smooth([*ahead, *behind], draw.round(40))
    net = np.empty((3, len(sweep), 3))
    net[..., 0] = (np.array([0.56, 0.9, 1.0]) * (w / 2))[:, None]
    net[..., 1], net[..., 2] = sweep[:, 0], sweep[:, 1] + np.array([0.0, 0.0, -0.07])[:, None]
    axles = (front + length / 2) / length, (rear + length / 2) / length
    f = Form(length, w, roof, hood, hood, hood, 0.4, 0.4, 0.9, 0.95, z, r, *axles)
    lamp = revolve([(0, 0.12), (0.09, 0.05), (0.11, -0.04), (0, -0.06)], draw.round(14)).turned("x", 90)
    parts = [loft(np.stack(rings)), house, pair(shell(net, 0.02)), wheels(draw, f, 0.13, -0.08)]
    parts.append(bar((0, y0, z - 0.1), (0, y1 - 0.2, z - 0.1), 0.55 * w, 0.18))
    parts.append(pair(lamp.at(0.36 * w, y0 - 0.02, hood - 0.25)))
    parts.append(rod((-0.4 * w, y0, hood - 0.32), (0.4 * w, y0, hood - 0.32), 0.02, 6))
    parts.append(cuboid((-0.4 * w, y0 - 0.4, 0.4), (0.4 * w, y0 - 0.34, 0.5)))
    parts.append(cuboid((-0.24 * w, y0 - 0.04, z), (0.24 * w, y0, hood - 0.08), edge=0.02))
    if draw.chance(0.6):
        parts.append(wheel(draw, 0.9 * r, 0.13).turned("z", 90).at(0, y1 + 0.02, z + 0.35))
    if not closed:
        screen = cuboid((-0.4 * w, cowl - 0.02, hood), (0.4 * w, cowl, hood + 0.4))
        return join([*parts, seats(draw, f, (0.58, 0.76)), screen])
    wide, high = 0.5 * (y1 - cowl) - 0.35, roof - hood - 0.16
    panes = [
        frame(wide, high, 0.05, 0.06).turned("z", 90).at(0.425 * w, middle + k * (wide + 0.1), hood + 0.02)
        for k in (-0.52, 0.52)
    ]
    return join([*parts, pair(join(panes)), frame(0.68 * w, high, 0.05, 0.06).at(0, cowl - 0.25, hood + 0.02)])


def racer(draw: Draw) -> MeshPart:
    """Return a single-seater: a slender body and bare wheels, with wings in front and behind or without."""
    length, w, r, n = draw.between(3.6, 5.4), draw.between(1.5, 2.1), draw.between(0.28, 0.4), draw.round(16)
    modern, fat = draw.chance(0.65), draw.between(0.8, 1.3)
    rows = [
        (0.0, 0.08, 0.3), (0.1, 0.12, 0.4), (0.3, 0.2, 0.55), (0.45, 0.28, 0.62), (0.55, 0.3, 0.7), (0.7, 0.28, 0.72),
        (0.9, 0.16, 0.5), (1.0, 0.1, 0.4),
    ]  # fmt: skip
    spine = smooth(rows, draw.round(22))
    ring = circle(n)
    rings = np.empty((len(spine), n, 3))
    rings[..., 0] = fat * spine[:, 1:2] * ring[:, 0]
    rings[..., 1] = (spine[:, :1] - 0.5) * length
    rings[..., 2] = 0.12 + (spine[:, 2:] - 0.12) * (0.5 + 0.5 * ring[:, 1])
    front, rear = -draw.between(0.24, 0.34) * length, draw.between(0.3, 0.4) * length
    small = r * draw.between(0.85, 1.0)
    fore, aft = wheel(draw, small, 0.28), wheel(draw, r, draw.between(0.28, 0.42))
    parts = [loft(rings), pair(fore.at(w / 2 - 0.14, front, small)), pair(aft.at(w / 2 - 0.18, rear, r))]
    for y in (front, rear):
        arms = [
            rod((0.1, y + k, z), (w / 2 - 0.2, y, r + z - 0.35), 0.018, 6) for k in (-0.2, 0.2) for z in (0.3, 0.45)
        ]
        parts.append(pair(join(arms)))
    y0, y1, span, high = -0.5 * length, 0.47 * length, draw.between(0.34, 0.48) * w, draw.between(0.65, 1.0)
    if modern:
        parts.append(cuboid((-span, y0 - 0.1, 0.12), (span, y0 + 0.3, 0.15)))
        parts.append(cuboid((-span, y1, high), (span, y1 + 0.35, high + 0.03)))
        parts.append(pair(cuboid((span, y0 - 0.15, 0.1), (span + 0.01, y0 + 0.35, 0.3))))
        parts.append(pair(cuboid((span, y1 - 0.05, 0.45), (span + 0.01, y1 + 0.4, high + 0.12))))
        low, far = (0.18, -0.05 * length, 0.1), (0.62, 0.24 * length, 0.5)
        parts.append(pair(cuboid(low, far, edge=0.1, steps=draw.whole(1, 3))))
        parts.append(cuboid((-0.06, 0.4 * length, 0.4), (0.06, 0.5 * length, high)))
        parts.append(ellipsoid((0, 0.1 * length, 0.85), (0.13, 0.35, 0.16), n))
        if draw.chance(0.5):
            rear, front = 0.06 * length, -0.02 * length
            halo = bent([(-0.3, rear, 0.6), (-0.25, front, 0.85), (0.25, front, 0.85), (0.3, rear, 0.6)], 0.2)
            parts.append(tube(halo, 0.03, 6))
    else:
        pipe = bent([(0.3, 0.0, 0.35), (0.36, 0.1, 0.3), (0.36, 0.5 * length, 0.3)], 0.1)
        parts += [tube(pipe, 0.05, draw.round(8)), cuboid((-0.25, y0 + 0.08, 0.25), (0.25, y0 + 0.14, 0.5), edge=0.004)]
    parts.append(ellipsoid((0, -0.02 * length, 0.75), (0.14, 0.16, 0.15), n))
    parts.append(cuboid((-0.2, -0.06 * length, 0.5), (0.2, 0.02 * length, 0.68), edge=0.06, steps=2))
    return join(parts)
