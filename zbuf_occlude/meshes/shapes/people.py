"""People on foot and on bicycles: limbs in the phases of a stride, builds, clothes, luggage. Front towards -y, metres.

Segments are fractions of the stature (Drillis and Contini 1966): thigh 0.245, shank 0.246,
foot 0.039 high, upper arm 0.186, forearm and hand 0.254, hips at 0.530, shoulders at 0.818.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.meshes.shapes.curves import circle, superellipse
from zbuf_occlude.meshes.shapes.draw import Draw
from zbuf_occlude.meshes.shapes.kit import MeshPart, cuboid, ellipsoid, join, loft, rod, tube

THIGH, SHANK, FOOT, UPPER_ARM, FOREARM, TRUNK = 0.245, 0.246, 0.039, 0.186, 0.254, 0.288
SHOULDER, HIP = 0.115, 0.05
"""Half the distance between the shoulders, and between the hips, as fractions of the stature."""
SOLE = 0.025
"""Thickness of a shoe's sole, metres; assumed. Statures are barefoot."""
WHEEL, CRANK = 0.34, 0.17
"""Radius of a bicycle's wheel and length of its crank, metres."""
LEG = ((0.056, 0.052, 0.045, 0.036), (0.036, 0.037, 0.031, 0.023))
ARM = ((0.033, 0.03, 0.027, 0.024), (0.024, 0.024, 0.021, 0.016))
"""Radii of thigh and shank, of upper arm and forearm, from joint to joint, fractions of the stature; assumed."""
TORSO = np.array([
    (-0.24, 0.048, 0.045), (-0.12, 0.088, 0.066), (0.08, 0.094, 0.07), (0.38, 0.081, 0.058), (0.66, 0.093, 0.066),
    (0.86, 0.104, 0.06), (0.97, 0.09, 0.046), (1.04, 0.05, 0.036), (1.1, 0.03, 0.03), (1.24, 0.028, 0.03),
])  # fmt: skip
"""Cross-sections from crotch to neck: height over `TRUNK` above the hips, half width, half depth; assumed."""
MAN, WOMAN = (0.95, 1.02, 1.06), (1.05, 0.93, 0.93)
"""Factors on the widths of hips, waist and shoulders; assumed."""


@dataclass(frozen=True)
class Body:
    """A person's size and build.

    Parameters
    ----------
    stature : float
        Metres, barefoot.
    girth : float
        Factor on the thickness of limbs and trunk.
    widths : (3,) float
        Factors on the widths of hips, waist and shoulders.
    segments : int
        Number of segments of round parts.
    """

    stature: float
    girth: float
    widths: tuple[float, float, float]
    segments: int

    def limb(self, ends: list[FloatArray], radii: Sequence[Sequence[float]], cloth: float = 1.0) -> MeshPart:
        """Return tubes from joint to joint with balls between them; `radii` are fractions of the stature."""
        parts = []
        for a, b, profile in zip(ends, ends[1:], radii, strict=False):
            r = self.stature * self.girth * cloth * np.array(profile)
            path = a + np.linspace(0.0, 1.0, len(r))[:, None] * (b - a)
            parts += [tube(path, r, self.segments), ellipsoid(a, (r[0],) * 3, self.segments)]
        return join(parts)

    def rings(self, rows: FloatArray) -> FloatArray:
        """Return cross-sections (m, n, 3) about the vertical through the hips; `rows` are as those of `TORSO`."""
        s, g = self.stature, self.girth
        outline = superellipse(2 * self.segments, 2.5)
        wide = np.interp(rows[:, 0], (0.0, 0.4, 0.9, 1.08), (*self.widths, 1.0)) * rows[:, 1]
        deep = rows[:, 2] * np.interp(rows[:, 0], (0.0, 0.38, 0.8, 1.08), (g, g**2, g, 1.0))
        found = np.empty((len(rows), len(outline), 3))
        found[..., 0] = s * (wide * np.interp(rows[:, 0], (0.9, 1.08), (g, 1.0)))[:, None] * outline[:, 0]
        found[..., 1] = s * deep[:, None] * outline[:, 1]
        found[..., 2] = TRUNK * s * rows[:, :1]
        return found

    def head_and_trunk(self, hips: FloatArray, lean: float) -> tuple[MeshPart, FloatArray]:
        """Return trunk and head above the hips, leaning forward by degrees, and the centre of the shoulders."""
        s = self.stature
        along = np.array([0.0, -np.sin(np.radians(lean)), np.cos(np.radians(lean))])
        shoulders = hips + TRUNK * s * along
        large = (1.75 / s) ** 0.5  # heads of children are larger for their stature
        upright = np.array([0.0, -0.35 * np.sin(np.radians(lean)), 1.0])
        middle = shoulders + s * ((0.182 - 0.067 * large) * upright + np.array([0.0, -0.012, 0.0]))
        head = ellipsoid(middle, s * large * np.array([0.044, 0.056, 0.067]), 2 * self.segments)
        neck = rod(shoulders, middle, 0.031 * s, self.segments)
        trunk = loft(self.rings(TORSO)).turned("x", lean).at(*hips)
        return join([trunk, neck, head]), shoulders


def swung(
    root: FloatArray, lengths: tuple[float, float], angles: tuple[float, float], outwards: float = 0.0
) -> list[FloatArray]:
    """Return the joints of a limb below a root; it is turned forward by degrees, its part beyond the joint by more.

    `outwards` are degrees towards +x.
    """
    joints, aside = [root], np.radians(outwards)
    for length, angle in zip(lengths, np.radians(np.cumsum(angles)), strict=True):
        down = np.array([np.sin(aside), -np.sin(angle) * np.cos(aside), -np.cos(angle) * np.cos(aside)])
        joints.append(joints[-1] + length * down)
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
    """Return a body of a drawn build, with a drawn number of segments."""
    build = draw.pick((MAN, WOMAN)) if stature > 1.5 else (1.0, 1.0, 1.0)
    return Body(stature, girth, build, draw.round(12))


# ---- poses -----------------------------------------------------------------------------------------------------------

Swing = Callable[[Draw], tuple[tuple[float, float], ...]]
SWING_KNEE = 55.0
"""Bend of the knee in the middle of a walker's swing beyond that in stance, degrees (Perry 1992: about 60 in all)."""


def _leg(phase: float, amplitude: float, knee: float, flex: float) -> tuple[float, float]:
    """Return hip and knee of a leg at a phase of the stride, radians; it swings forward where the cosine is positive.

    `knee` is the bend in stance, `flex` the further one in the middle of the swing, degrees.
    """
    return amplitude * np.sin(phase) + 0.2 * amplitude, -knee - flex * max(np.cos(phase), 0.0) ** 1.5


def _stride(
    draw: Draw, amplitude: float, knee: float, flex: float, arm: float, elbow: float
) -> tuple[tuple[float, float], ...]:
    """Return legs at opposite phases of a stride, and arms that swing against them."""
    phase = draw.between(0, 2 * np.pi)
    phases = phase, phase + np.pi
    legs = tuple(_leg(each, amplitude, knee, flex) for each in phases)
    return legs + tuple((-arm * np.sin(each), elbow + 0.3 * arm * max(-np.sin(each), 0.0)) for each in phases)


def _standing(draw: Draw) -> tuple[tuple[float, float], ...]:
    return tuple((side * draw.between(0, 4), -draw.between(0, 4)) for side in (1, -1)) + tuple(
        (draw.between(-6, 8), draw.between(5, 25)) for _ in range(2)
    )


def _walking(draw: Draw) -> tuple[tuple[float, float], ...]:
    pace = draw.between(17, 27)
    return _stride(draw, pace, draw.between(4, 12), SWING_KNEE, draw.between(0.4, 1.2) * pace, draw.between(10, 35))


def _running(draw: Draw) -> tuple[tuple[float, float], ...]:
    return _stride(draw, draw.between(34, 48), draw.between(18, 30), 80.0, draw.between(30, 45), draw.between(75, 100))


def _on_the_phone(draw: Draw) -> tuple[tuple[float, float], ...]:
    first, second, _, other = (_walking if draw.chance(0.5) else _standing)(draw)
    return first, second, (draw.between(15, 40), draw.between(110, 140)), other


POSES: dict[str, tuple[Swing, tuple[float, float], float]] = {
    "standing": (_standing, (-2, 4), 0.2),
    "walking": (_walking, (0, 7), 0.35),
    "walking with the arms still": (lambda draw: (*_walking(draw)[:2], *_standing(draw)[2:]), (0, 7), 0.2),
    "running": (_running, (8, 18), 0.1),
    "on the phone": (_on_the_phone, (0, 10), 0.15),
}
"""Angles of each pose, degrees: hip and knee, then shoulder and elbow, left before right; the range of the trunk's
lean; the pose's share of pedestrians, assumed."""


# ---- people on foot --------------------------------------------------------------------------------------------------


def pedestrian(draw: Draw, stature: float, girth: float) -> MeshPart:
    """Return a person on foot in a drawn pose, with drawn clothes and luggage; the lowest sole at z = 0."""
    body, s = body_of(draw, stature, girth), stature
    swings, leans, _ = POSES[str(draw.rng.choice(list(POSES), p=[share for *_, share in POSES.values()]))]
    angles, lean, side = swings(draw), draw.between(*leans), draw.pick((-1, 1))
    trousers, sleeves, apart = draw.between(0.95, 1.25), draw.between(0.95, 1.3), draw.between(2, 14)
    trunk, shoulders = body.head_and_trunk(np.zeros(3), lean)
    parts = [trunk]
    for x, swing in zip((side, -side), angles[:2], strict=True):
        joints = swung(np.array([HIP * s * x, 0, 0]), (THIGH * s, SHANK * s), swing)
        parts += [body.limb(joints, LEG, trousers), _shoe(joints[-1], s, sum(swing))]
    ground = min(float(part.points[:, 2].min()) for part in parts)
    parts += _worn(draw, body, lean, shoulders)
    hands = []
    for x, swing in zip((side, -side), angles[2:], strict=True):
        root = shoulders + np.array([SHOULDER * s * girth * body.widths[2] * x, 0, -0.025 * s])
        joints = swung(root, (UPPER_ARM * s, 0.8 * FOREARM * s), swing, apart * x)
        parts += [body.limb(joints, ARM, sleeves), ellipsoid(joints[-1], s * np.array([0.016, 0.024, 0.04]), 12)]
        hands.append(joints[-1])
    parts += _carried(draw, s, shoulders, hands, ground)
    return join(parts).at(z=-min(float(part.points[:, 2].min()) for part in parts))


def _shoe(ankle: FloatArray, stature: float, degrees: float) -> MeshPart:
    """Return a foot that points forward from an ankle, turned with the shank."""
    low, high = np.array([-0.027, -0.11, -FOOT]) * stature, np.array([0.027, 0.045, 0.012]) * stature
    shoe = cuboid(low - np.array([0, 0, SOLE]), high, edge=0.018 * stature, steps=2)
    points = shoe.points.copy()
    toes = np.clip(-points[:, 1] / (0.11 * stature), 0.0, 1.0)
    points[:, 2] -= 0.6 * toes * np.maximum(points[:, 2] + FOOT * stature, 0.0)
    return shoe.warped(points).turned("x", -0.6 * degrees).at(*ankle)


def _worn(draw: Draw, body: Body, lean: float, shoulders: FloatArray) -> list[MeshPart]:
    """Return a coat, a skirt, or nothing more; and a hat, a hood, or nothing."""
    s, found = body.stature, []
    kind, head = draw.pick(("", "", "", "coat", "jacket", "skirt")), draw.pick(("", "", "", "", "hat", "hood"))
    flare, hem = draw.between(1.05, 1.35), draw.between(-1.15, -0.55)
    if kind == "coat":
        rows = np.array([(hem, 0.1 * flare, 0.1 * flare), (0.0, 0.104, 0.084), *(TORSO[3:7] * (1, 1.13, 1.2))])
        found.append(loft(body.rings(rows)).turned("x", lean))
    elif kind == "jacket":
        rows = np.array([(-0.2, 0.102, 0.084), (0.1, 0.108, 0.088), *(TORSO[3:7] * (1, 1.2, 1.3))])
        found.append(loft(body.rings(rows)).turned("x", lean))
    elif kind == "skirt":
        found.append(loft(body.rings(np.array([(hem, 0.115 * flare, 0.115 * flare), (0.2, 0.094, 0.074)]))))
    if head == "hat":
        found.append(ellipsoid(shoulders + np.array([0, -0.02 * s, 0.163 * s]), s * np.array([0.085, 0.085, 0.02]), 16))
    elif head == "hood":
        found.append(ellipsoid(shoulders + np.array([0, 0.002, 0.11 * s]), s * np.array([0.056, 0.062, 0.077]), 16))
    return found


def _carried(draw: Draw, s: float, shoulders: FloatArray, hands: list[FloatArray], ground: float) -> list[MeshPart]:
    """Return a drawn piece of luggage; for half of the people nothing. `ground` is the height of the lowest sole."""
    kind, deep = draw.pick(("", "", "", "", "backpack", "bag", "shoulder bag", "trolley")), draw.between(0.3, 0.45)
    thick = draw.between(0.09, 0.16)
    hand = min(hands, key=lambda each: float(each[2]))
    if kind == "backpack":
        low = shoulders + np.array([-0.09 * s, 0.045 * s, -0.28 * s])
        return [cuboid(low, shoulders + np.array([0.09 * s, (0.05 + thick) * s, 0.0]), edge=0.03 * s, steps=2)]
    if kind == "bag":
        low, high = hand + np.array([-thick / 2, -0.18, -deep]), hand + np.array([thick / 2, 0.18, -0.06])
        return [cuboid(low, high, edge=0.03, steps=1), rod(hand, hand - np.array([0, 0, 0.1]), 0.012, 6)]
    if kind == "shoulder bag":
        x = np.sign(hand[0]) * (0.13 * s + thick / 2)
        low, high = np.array([x - thick / 2, -0.15, -0.05 * s]), np.array([x + thick / 2, 0.15, 0.1 * s])
        strap = rod((x, 0.0, 0.1 * s), shoulders + np.array([0.6 * np.sign(x) * SHOULDER * s, 0, 0.01]), 0.015, 6)
        return [cuboid(low, high, edge=0.04, steps=2), strap]
    if kind == "trolley":
        foot = np.array([hand[0], hand[1] + 0.3, ground])
        case = cuboid((-0.2, 0.0, 0.04), (0.2, 0.22, 0.04 + 1.5 * deep), edge=0.04, steps=2).turned("x", -20)
        return [case.at(*foot), rod(hand, foot + np.array([0, 0.1, deep]), 0.015, 6)]
    return []


# ---- people on bicycles ----------------------------------------------------------------------------------------------


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
    cloth, wears_helmet = draw.between(0.95, 1.3), draw.chance(0.4)
    if wears_helmet:
        parts.append(
            ellipsoid(
                shoulders + s * np.array([0, -0.02 - lean / 1500.0, 0.128]), s * np.array([0.053, 0.07, 0.053]), 20
            )
        )
    forward, outward = np.array([0.0, -1.0, 0.2]), np.array([0.0, 0.5, -1.0])
    for x, phase in ((1, turn), (-1, turn + np.pi)):
        pedal = crank + np.array([0.12 * x, -CRANK * np.cos(phase), CRANK * np.sin(phase)])
        leg = reaching(
            hips + np.array([HIP * s * x, 0, 0]), (THIGH * s, SHANK * s), pedal + np.array([0, 0.04, 0.07]), forward
        )
        parts += [body.limb(leg, LEG, cloth), _shoe(leg[-1], s, 15.0)]
        parts.append(rod(crank + np.array([0.08 * x, 0, 0]), pedal, 0.012, 6))
        shoulder = shoulders + np.array([SHOULDER * s * girth * body.widths[2] * x, 0, -0.025 * s])
        hand = np.array([0.27 * x, bar_y + 0.03, bar_z + 0.03])
        arm = reaching(shoulder, (UPPER_ARM * s, 0.8 * FOREARM * s), hand, outward + np.array([0.3 * x, 0, 0]))
        parts += [body.limb(arm, ARM, cloth), ellipsoid(arm[-1], s * np.array([0.022, 0.03, 0.022]), 12)]
    if draw.chance(0.3):
        backpack = cuboid((-0.09 * s, 0.04 * s, 0.08 * s), (0.09 * s, 0.04 * s + 0.15, 0.3 * s), edge=0.04, steps=2)
        parts.append(backpack.turned("x", lean).at(*hips))
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
