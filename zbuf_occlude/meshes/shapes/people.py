"""People on foot and on bicycles, in several poses and builds, with limbs between joints. Front towards -y, metres.

Segments are fractions of the stature (Drillis and Contini 1966): thigh 0.245, shank 0.246,
foot 0.039 high, upper arm 0.186, forearm and hand 0.254, hips at 0.530, shoulders at 0.818.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.meshes.shapes.curves import circle
from zbuf_occlude.meshes.shapes.draw import Draw
from zbuf_occlude.meshes.shapes.kit import MeshPart, cuboid, ellipsoid, join, rod, tube

THIGH, SHANK, FOOT, UPPER_ARM, FOREARM, TRUNK = 0.245, 0.246, 0.039, 0.186, 0.254, 0.288
SHOULDER, HIP = 0.115, 0.06
"""Half the distance between the shoulders, and between the hips, as fractions of the stature."""
WHEEL, CRANK = 0.34, 0.17
"""Radius of a bicycle's wheel and length of its crank, metres."""


@dataclass(frozen=True)
class Body:
    """A person's size.

    Parameters
    ----------
    stature : float
        Metres.
    girth : float
        Factor on the thickness of limbs and trunk.
    segments : int
        Number of segments of round parts.
    """

    stature: float
    girth: float
    segments: int

    def limb(self, ends: list[FloatArray], radii: tuple[float, ...]) -> MeshPart:
        """Return rods from joint to joint; `radii` at the joints are fractions of the stature."""
        r = [self.stature * self.girth * radius for radius in radii]
        pieces = zip(ends, ends[1:], r, r[1:], strict=False)
        return join(rod(a, b, start, self.segments, end) for a, b, start, end in pieces)

    def head_and_trunk(self, hips: FloatArray, lean: float) -> tuple[MeshPart, FloatArray]:
        """Return trunk and head above the hips, leaning forward by degrees, and the centre of the shoulders."""
        s, g = self.stature, self.girth
        along = np.array([0.0, -np.sin(np.radians(lean)), np.cos(np.radians(lean))])
        shoulders = hips + TRUNK * s * along
        trunk = ellipsoid((0, 0, 0), (0.105 * s * g, 0.07 * s * g**1.5, 0.185 * s), 2 * self.segments)
        neck = rod(shoulders - 0.03 * s * along, shoulders + 0.07 * s * along, 0.03 * s, self.segments)
        head = ellipsoid(
            shoulders + s * (0.115 * along + np.array([0, -0.015, 0.0])), s * np.array([0.044, 0.055, 0.07]), 20
        )
        yoke = ellipsoid(shoulders - 0.02 * s * along, s * np.array([SHOULDER, 0.045 * g, 0.04]), self.segments)
        middle = hips + 0.46 * TRUNK * s * along
        return join([trunk.turned("x", lean).at(*middle), yoke, neck, head]), shoulders


def swung(root: FloatArray, lengths: tuple[float, float], angles: tuple[float, float]) -> list[FloatArray]:
    """Return the joints of a limb below a root; it is turned forward by degrees, its part beyond the joint by more."""
    joints = [root]
    for length, angle in zip(lengths, np.radians(np.cumsum(angles)), strict=True):
        joints.append(joints[-1] + length * np.array([0.0, -np.sin(angle), -np.cos(angle)]))
    return joints


def reaching(root: FloatArray, lengths: tuple[float, float], end: FloatArray, bend: FloatArray) -> list[FloatArray]:
    """Return the joints of a limb from a root towards an end, as far as its length allows, bent towards `bend`."""
    first, second = lengths
    way = end - root
    distance = min(float(np.linalg.norm(way)), 0.999 * (first + second))
    along = way / np.linalg.norm(way)
    before = (first**2 - second**2 + distance**2) / (2 * distance)
    across = bend - (bend @ along) * along
    joint = root + before * along + np.sqrt(max(first**2 - before**2, 0.0)) * across / np.linalg.norm(across)
    return [root, joint, root + distance * along]


def body_of(draw: Draw, stature: float, girth: float) -> Body:
    """Return a body with a drawn number of segments."""
    return Body(stature, girth, draw.round(12))


Swing = Callable[[Draw], tuple[tuple[float, float], ...]]


def _standing(draw: Draw) -> tuple[tuple[float, float], ...]:
    return tuple((side * draw.between(0, 4), -draw.between(0, 4)) for side in (1, -1)) + tuple(
        (draw.between(-6, 8), draw.between(5, 25)) for _ in range(2)
    )


def _walking(draw: Draw) -> tuple[tuple[float, float], ...]:
    step, arm = draw.between(15, 28), draw.between(8, 28)
    legs = (step, -draw.between(2, 10)), (-0.8 * step, -draw.between(8, 35))
    return *legs, (-arm, draw.between(8, 20)), (arm, draw.between(15, 40))


def _running(draw: Draw) -> tuple[tuple[float, float], ...]:
    step = draw.between(35, 55)
    legs = (step, -draw.between(40, 70)), (-0.5 * step, -draw.between(25, 90))
    return *legs, (-draw.between(30, 50), draw.between(75, 100)), (draw.between(15, 35), draw.between(80, 110))


def _on_the_phone(draw: Draw) -> tuple[tuple[float, float], ...]:
    first, second, _, other = (_walking if draw.chance(0.5) else _standing)(draw)
    return first, second, (draw.between(15, 40), draw.between(110, 140)), other


POSES: dict[str, tuple[Swing, tuple[float, float]]] = {
    "standing": (_standing, (-2, 4)),
    "walking": (_walking, (0, 7)),
    "running": (_running, (8, 18)),
    "on the phone": (_on_the_phone, (0, 10)),
}
"""Angles of each pose, degrees: hip and knee, then shoulder and elbow, left before right; and the range of the trunk's
lean."""


def pedestrian(draw: Draw, stature: float, girth: float) -> MeshPart:
    """Return a person on foot in a drawn pose, perhaps with a backpack, a bag or a hat; the lowest foot at z = 0."""
    body, s = body_of(draw, stature, girth), stature
    swings, leans = POSES[draw.pick(tuple(POSES))]
    angles, lean, side = swings(draw), draw.between(*leans), draw.pick((-1, 1))
    hips = np.zeros(3)
    parts, shoulders = [], np.zeros(3)
    whole, shoulders = body.head_and_trunk(hips, lean)
    parts.append(whole)
    for x, swing in zip((side, -side), angles[:2], strict=True):
        joints = swung(np.array([HIP * s * x, 0, 0]), (THIGH * s, SHANK * s), swing)
        parts += [body.limb(joints, (0.053, 0.034, 0.022)), _shoe(joints[-1], s, sum(swing))]
    hands = []
    for x, swing in zip((side, -side), angles[2:], strict=True):
        joints = swung(shoulders + np.array([SHOULDER * s * x, 0, -0.02 * s]), (UPPER_ARM * s, FOREARM * s), swing)
        parts.append(body.limb(joints, (0.03, 0.024, 0.017)))
        hands.append(joints[-1])
    parts += _carried(draw, s, shoulders, hands)
    part = join(parts)
    return part.at(z=-float(part.points[:, 2].min()))


def _shoe(ankle: FloatArray, stature: float, degrees: float) -> MeshPart:
    """Return a foot that points forward from an ankle, turned with the shank."""
    low, high = np.array([-0.027, -0.105, -FOOT]) * stature, np.array([0.027, 0.04, 0.01]) * stature
    return cuboid(low, high, edge=0.015 * stature, steps=1).turned("x", -0.6 * degrees).at(*ankle)


def _carried(draw: Draw, s: float, shoulders: FloatArray, hands: list[FloatArray]) -> list[MeshPart]:
    """Return a random item that a person carries or wears; for half of them nothing."""
    found = []
    kind = draw.pick(("", "", "", "backpack", "bag", "hat"))
    if kind == "backpack":
        low, high = (
            shoulders + np.array([-0.09 * s, 0.05 * s, -0.27 * s]),
            shoulders + np.array([0.09 * s, 0.16 * s, 0.0]),
        )
        found.append(cuboid(low, high, edge=0.03 * s, steps=2))
    elif kind == "bag":
        hand, deep = hands[0], draw.between(0.3, 0.45)
        found.append(
            cuboid(hand + np.array([-0.06, -0.18, -deep]), hand + np.array([0.06, 0.18, -0.04]), edge=0.03, steps=1)
        )
    elif kind == "hat":
        found.append(
            ellipsoid(shoulders + np.array([0, -0.015 * s, 0.165 * s]), s * np.array([0.085, 0.085, 0.02]), 16)
        )
    return found


def cyclist(draw: Draw, stature: float, girth: float) -> MeshPart:
    """Return a bicycle of a random kind with its rider and a random crank angle; its wheels stand on z = 0."""
    body, s = body_of(draw, stature, girth), stature
    lean, bar_z, bar_y = draw.pick(((8.0, 1.12, -0.32), (28.0, 1.04, -0.42), (52.0, 0.92, -0.5)))
    lean += draw.between(-5, 5)
    saddle = np.array([0.0, 0.22, 0.3 + 0.36 * s + draw.between(-0.03, 0.03)])
    crank, turn = np.array([0.0, 0.08, 0.29]), draw.between(0, 2 * np.pi)
    long = draw.between(-0.04, 0.06)
    parts = [_bicycle(saddle, crank, np.array([0.0, bar_y, bar_z]), long, draw.round(24))]
    hips = saddle + np.array([0, 0, 0.05 * s])
    whole, shoulders = body.head_and_trunk(hips, lean)
    parts.append(whole)
    forward, outward = np.array([0.0, -1.0, 0.2]), np.array([0.0, 0.5, -1.0])
    for x, phase in ((1, turn), (-1, turn + np.pi)):
        pedal = crank + np.array([0.12 * x, -CRANK * np.cos(phase), CRANK * np.sin(phase)])
        leg = reaching(
            hips + np.array([HIP * s * x, 0, 0]), (THIGH * s, SHANK * s), pedal + np.array([0, 0.04, 0.07]), forward
        )
        parts += [body.limb(leg, (0.053, 0.034, 0.022)), _shoe(leg[-1], s, 15.0)]
        parts.append(rod(crank + np.array([0.08 * x, 0, 0]), pedal, 0.012, 6))
        shoulder = shoulders + np.array([SHOULDER * s * x, 0, -0.02 * s])
        hand = np.array([0.27 * x, bar_y, bar_z + 0.03])
        arm = reaching(shoulder, (UPPER_ARM * s, FOREARM * s), hand, outward + np.array([0.3 * x, 0, 0]))
        parts.append(body.limb(arm, (0.03, 0.024, 0.017)))
    if draw.chance(0.3):
        low, high = shoulders + np.array([-0.09 * s, 0.05, -0.2 * s]), shoulders + np.array([0.09 * s, 0.2, 0.04 * s])
        parts.append(cuboid(low, high, edge=0.04, steps=2))
    if draw.chance(0.5):
        parts.append(cuboid((-0.14, 0.35, WHEEL + 0.38), (0.14, 0.68, WHEEL + 0.41)))  # a carrier
    return join(parts)


def _bicycle(saddle: FloatArray, crank: FloatArray, bar: FloatArray, long: float, segments: int) -> MeshPart:
    """Return frame, wheels, handlebar and saddle; the axles are 1.08 m plus twice `long` apart."""
    hub, fork = np.array([0.0, 0.53 + long, WHEEL]), np.array([0.0, -0.55 - long, WHEEL])
    head = np.array([0.0, -0.4, 0.8])
    ends = (
        (hub, crank),
        (hub, saddle),
        (crank, saddle),
        (crank, head),
        (saddle - np.array([0, 0, 0.15]), head),
        (fork, head),
    )
    parts = [rod(a, b, 0.02, 6) for a, b in (*ends, (head, bar))]
    parts.append(rod(bar - np.array([0.29, 0, 0]), bar + np.array([0.29, 0, 0]), 0.016, 6))
    parts.append(ellipsoid(saddle, (0.08, 0.14, 0.035), 12))
    ring = np.insert(circle(segments) * (WHEEL - 0.022), 0, 0.0, axis=1)
    for centre in (hub, fork):
        parts.append(tube(ring, 0.022, 6, closed=True).at(*centre))
        for angle in np.linspace(0, np.pi, 5)[:-1]:
            spoke = np.array([0.0, np.cos(angle), np.sin(angle)]) * (WHEEL - 0.03)
            parts.append(rod(centre - spoke, centre + spoke, 0.006, 5))
    return join(parts)
