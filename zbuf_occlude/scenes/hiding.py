"""How much of a target others hide, measured; and where to put something so that it hides a stated share."""

from dataclasses import dataclass

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.sampling import SurfacePoints, sample_surface
from zbuf_occlude.scenes.scene import Placed, moved
from zbuf_occlude.visibility import prepare
from zbuf_occlude.visibility.interface import Occluder

N_POINTS = 60_000
"""On the whole target. Of them a sixth to a third shows, so a share's standard deviation is at most half a percent."""
N_TRIED = 3_000
"""Of them so many are asked about while a place is looked for."""
METHOD = "exact"
HALVINGS = 10
CLOSE = 0.004
"""A share this near to the one wanted will do."""


@dataclass(frozen=True, eq=False)
class Target:
    """A target, and the points of it that show when nothing else is there.

    Parameters
    ----------
    mesh : Mesh
        In its place, world space.
    points : SurfacePoints
        On all of it.
    """

    mesh: Mesh
    points: SurfacePoints

    @classmethod
    def of(cls, mesh: Mesh, seed: np.random.SeedSequence) -> "Target":
        """Sample a target for its shares to be measured on."""
        return cls(mesh, sample_surface(mesh, n_points=N_POINTS, seed=seed))

    def showing(self, eyes: FloatArray) -> BoolArray:
        """Which points each eye (k, 3) sees of the target alone, (k, n)."""
        with prepare(self.mesh, METHOD) as occluder:
            return occluder.visible(self.points, eyes)


def hidden_share(positions: FloatArray, eye: FloatArray, occluder: Occluder, shift: FloatArray | None = None) -> float:
    """Return the share of some positions (n, 3), which an eye sees, that a mesh hides when moved by `shift`."""
    if not len(positions):
        return 0.0
    by = np.zeros(3) if shift is None else shift
    return 1.0 - float(occluder.visible(SurfacePoints.free(positions - by), (eye - by)[None]).mean())


def placed_to_hide(candidate: Placed, positions: FloatArray, eye: FloatArray, share: float) -> tuple[Placed, float]:
    """Move an object across the line of sight until it hides a share of some positions.

    Parameters
    ----------
    candidate : Placed
        Where it hides most: between eye and target.
    positions : (n, 3) float
        Of the target, those that the eye sees.
    eye : (3,) float
    share : float
        Wanted, in [0, 1].

    Returns
    -------
    placed : Placed
    hidden : float
        The share that it hides there, of a few; the greatest found where the one wanted cannot be reached.
    """
    sight = positions.mean(axis=0) - eye
    across = np.array([-sight[1], sight[0], 0.0]) / max(float(np.hypot(sight[0], sight[1])), 1e-9)
    with prepare(candidate.world_mesh, METHOD) as occluder:
        tried = positions[:: max(1, len(positions) // N_TRIED)]
        most = hidden_share(tried, eye, occluder)
        near, far, best, found = 0.0, 0.0, 0.0, most
        if most > share + CLOSE:
            reach = np.ptp(positions @ across) + np.ptp(candidate.vertices @ across)
            far = float(reach) + 0.1
            for _ in range(HALVINGS):
                middle = (near + far) / 2.0
                hidden = hidden_share(tried, eye, occluder, middle * across)
                if abs(hidden - share) < abs(found - share):
                    best, found = middle, hidden
                if abs(hidden - share) <= CLOSE:
                    break
                near, far = (middle, far) if hidden > share else (near, middle)
    pose = moved(to=best * across) @ candidate.pose
    return Placed(candidate.mesh, candidate.label, pose, candidate.albedo), found
