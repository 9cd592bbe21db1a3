"""How much of a target others hide, measured; and where to put something so that it hides a stated share."""

from functools import lru_cache

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints
from zbuf_occlude.scenes.scene import Placed, moved
from zbuf_occlude.visibility import prepare
from zbuf_occlude.visibility.interface import Occluder

N_POINTS = 60_000
"""On the whole target. Of them a sixth to a third shows, so a share's standard deviation is at most half a percent."""
N_TRIED = 3_000
"""Of them this many are asked about while a place is looked for."""
METHOD = "exact"
HALVINGS = 10
CLOSE = 0.004
"""A share this near to the one wanted will do."""


@lru_cache(maxsize=32)
def ready(mesh: Mesh) -> Occluder:
    """Make a mesh ready, once for all scenes that it stands in; `METHOD` has nothing to close."""
    return prepare(mesh, METHOD)


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
    tried = positions[:: max(1, len(positions) // N_TRIED)]
    occluder, to_mesh = ready(candidate.mesh), np.linalg.inv(candidate.pose)  # lines stay lines
    foot = candidate.pose[:3, 3]
    points, from_eye, step = (vectors @ to_mesh[:3, :3].T for vectors in (tried - foot, eye - foot, across))

    def hidden_at(shift: float) -> float:
        moved_on = SurfacePoints.free(points - shift * step)
        return 1.0 - float(occluder.visible(moved_on, (from_eye - shift * step)[None]).mean())

    most = hidden_at(0.0)
    near, far, best, found = 0.0, 0.0, 0.0, most
    if most > share + CLOSE:
        far = float(np.ptp(positions @ across) + np.ptp(candidate.vertices @ across)) + 0.1
        for _ in range(HALVINGS):
            middle = (near + far) / 2.0
            hidden = hidden_at(middle)
            if abs(hidden - share) < abs(found - share):
                best, found = middle, hidden
            if abs(hidden - share) <= CLOSE:
                break
            near, far = (middle, far) if hidden > share else (near, middle)
    pose = moved(to=best * across) @ candidate.pose
    return Placed(candidate.mesh, candidate.label, pose, candidate.albedo), found
