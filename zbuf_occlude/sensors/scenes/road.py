"""A road along a path: ground, parked road users, people, poles and house fronts on both sides, drawn from a seed."""

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.shapes import traffic
from zbuf_occlude.meshes.shapes.families import MEMBERS
from zbuf_occlude.sensors.scenes.kinds import GROUND_HALF, box_mesh, plate_mesh, pole_mesh
from zbuf_occlude.sensors.scenes.scene import Placed, moved, upright_pose

LONGEST = 5_000.0
"""Maximum length of the path, metres: about 3,000 objects stand beside it, in memory."""
BEYOND = 60.0
"""Metres by which the road goes on before the first and after the last point of a path."""
SPACING = {"user": 8.0, "pole": 25.0, "building": 18.0}
"""Metres along the road between two places of each kind, on each side; all numbers of this table are assumed."""
OFFSETS = {"user": (3.5, 5.5), "pole": (6.5, 7.0), "building": (13.0, 16.0)}
"""Metres from the path to the middle of each kind, drawn uniformly."""
CLASSES = {"car": 0.55, "van": 0.1, "truck": 0.05, "bus": 0.03, "pedestrian": 0.17, "cyclist": 0.1}
"""Shares of the classes of road users."""
OCCUPANCY = 0.6
"""Share of the places of road users that are taken."""


def ground_about(path: FloatArray) -> Placed:
    """Return the ground, z = 0, which reaches `GROUND_HALF` metres beyond the points of a path (m, 3) on all sides."""
    low, high = path[:, :2].min(axis=0), path[:, :2].max(axis=0)
    half = GROUND_HALF + float((high - low).max()) / 2.0
    return Placed(plate_mesh(half), "ground", moved(to=(*((low + high) / 2.0), 0.0)), is_background=True)


def road_along(path: FloatArray, seed: np.random.SeedSequence) -> list[Placed]:
    """Return the ground and the objects beside a path (m, 3) of a rig; nothing stands nearer to it than its own side.

    Objects that would stand in the way of a path that comes back, or in each other's, are left out. A path longer than
    `LONGEST` is an OptionError.
    """
    length = float(np.hypot(*np.diff(path[:, :2], axis=0).T).sum())
    if length > LONGEST:
        raise OptionError(
            f"the path of a drawn street must be at most {LONGEST:g} m long; it is {length:.0f} m. Give fewer "
            "--sweeps, or a scene of your own by --scene FILE.json."
        )
    rng, line = np.random.default_rng(seed), _extended(path[:, :2])
    steps = np.diff(line, axis=0)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])
    placed, taken = [ground_about(path)], np.empty((0, 3))
    for kind, spacing in SPACING.items():
        for at in np.arange(spacing / 2.0, along[-1], spacing):
            for side in (1.0, -1.0):
                mesh, label = _drawn(kind, rng)
                offset, place = rng.uniform(*OFFSETS[kind]), at + rng.uniform(-0.2, 0.2) * spacing
                step = int(np.clip(np.searchsorted(along, place) - 1, 0, len(steps) - 1))
                ahead = steps[step] / np.hypot(*steps[step])
                middle = line[step] + (place - along[step]) * ahead + side * offset * np.array([-ahead[1], ahead[0]])
                if mesh is None or np.hypot(*(line - middle).T).min() < offset - 0.3:
                    continue
                radius = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)[:2])) / 2.0
                if (np.hypot(*(taken[:, :2] - middle).T) < 0.8 * (taken[:, 2] + radius)).any():
                    continue
                taken = np.vstack([taken, [*middle, radius]])
                yaw = float(np.arctan2(ahead[1], ahead[0])) + (np.pi / 2.0 if kind == "user" else 0.0)
                pose = upright_pose(yaw, [*middle, 0.0])
                placed.append(Placed(mesh, label, pose, is_background=kind != "user"))
    return placed


def _extended(line: FloatArray) -> FloatArray:
    """Return the distinct points of a path (m, 2), with straight ends that go on; along x where it does not move."""
    line = line[np.append(True, np.hypot(*np.diff(line, axis=0).T) > 1e-3)]
    first, last = (line[1] - line[0], line[-1] - line[-2]) if len(line) > 1 else np.eye(2)[[0, 0]]
    ends = [line[:1] - BEYOND * first / np.hypot(*first), line, line[-1:] + BEYOND * last / np.hypot(*last)]
    whole = np.concatenate(ends)
    share = np.linspace(0.0, 1.0, 60)[1:-1, None]  # points on the ends too: what stands there keeps clear of them
    return np.concatenate([
        whole[:1], whole[0] + share * (whole[1] - whole[0]), whole[1:-1], whole[-2] + share * (whole[-1] - whole[-2]),
        whole[-1:],
    ])  # fmt: skip


def _drawn(kind: str, rng: np.random.Generator) -> tuple[Mesh | None, str]:
    """Return an object of a kind and its class; no mesh where a place stays free. Its front is towards -y."""
    share, number = rng.random(), int(rng.integers(MEMBERS))
    if kind == "pole":
        return pole_mesh(0.1, 6.0), "pole"
    if kind == "building":
        return box_mesh(float(rng.integers(10, 17)), 8.0, float(rng.integers(6, 13))), "building"
    label = str(rng.choice(list(CLASSES), p=list(CLASSES.values())))
    return (traffic.make(label, number) if share < OCCUPANCY else None), label
