"""Beams: up to 16 rays from one place, and the pyramid of four planes through it that holds them."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.image_space.layout import ENDLESS, PACKET
from zbuf_occlude.vectors import cross, dot

FARTHEST_ORIGIN = 16.0
"""Scene units. Errors grow with an origin's distance; from farther away rays go one by one."""

NARROW = 0.99
"""Cosine between a beam's axis and its rays, at least; wider beams meet too much, and go ray by ray."""

N_PLANES = 4
AXIS = N_PLANES
"""Row of `State.planes` with the beam's axis; the rows before it are the planes."""


class Beam(NamedTuple):
    """Up to 16 rays from one place.

    Parameters
    ----------
    together : bool
        Whether they are a beam at all; the rest means nothing otherwise.
    rays : int64
        Mask of the lanes in use.
    origin : tuple of 3 float32, scene space
    world_origin : tuple of 3 float64
    reach : float32
        Largest distance of anything in the scene from the origin, 1 at least.
    """

    together: bool
    rays: np.int64
    origin: tuple[np.float32, np.float32, np.float32]
    world_origin: tuple[float, float, float]
    reach: np.float32


class State(NamedTuple):
    """What is known of the rays of a beam, a lane for each.

    Parameters
    ----------
    world_directions : (16, 3) float64
        The caller's.
    units : (16,) float64
        Scene units per length of these.
    directions : (3, 16) float32
        Of length 1.
    planes : (5, 4) float32
        Inward unit normals of the beam's planes, then its axis; each with the offset that makes it 0 at the origin.
    face_ids : (16,) int64
        The nearest face so far, -1 for none.
    lows, highs : (16,) float32
        Bounds of its distance, scene units.
    fractions : (16,) float64
        How many directions away it is; -1 where only the bounds are known.
    """

    world_directions: FloatArray
    units: FloatArray
    directions: NDArray[np.float32]
    planes: NDArray[np.float32]
    face_ids: IntArray
    lows: NDArray[np.float32]
    highs: NDArray[np.float32]
    fractions: FloatArray


@njit
def make_state():
    """Return an empty `State`."""
    return State(
        world_directions=np.empty((PACKET, 3)),
        units=np.empty(PACKET),
        directions=np.empty((3, PACKET), dtype=np.float32),
        planes=np.empty((N_PLANES + 1, 4), dtype=np.float32),
        face_ids=np.empty(PACKET, dtype=np.int64),
        lows=np.empty(PACKET, dtype=np.float32),
        highs=np.empty(PACKET, dtype=np.float32),
        fractions=np.empty(PACKET),
    )


@njit(_nrt=False)
def make_beam(scene, origins, directions, chosen, state):
    """Put some rays into `state`, and return them as a beam, if they are one.

    Parameters
    ----------
    scene : Scene
    origins, directions : (n, 3) or (1, 3), and (n, 3) float64, world space
    chosen : (m,) int64
        Which of them; at most 16.
    state : State
    """
    o = origins[chosen[0] if len(origins) > 1 else 0]
    world_origin = (o[0], o[1], o[2])
    local = _scene_place(scene, world_origin)
    distance = math.sqrt(dot(local, local))
    together = distance <= FARTHEST_ORIGIN
    if len(origins) > 1:
        for i in chosen:
            other = origins[i]
            together &= other[0] == o[0] and other[1] == o[1] and other[2] == o[2]
    mean = (0.0, 0.0, 0.0)
    for lane in range(PACKET):
        d = directions[chosen[min(lane, len(chosen) - 1)]]
        squared = dot(d, d)
        together &= 1e-200 < squared < 1e200
        length = math.sqrt(squared) if squared > 0.0 else 1.0
        inverse = 1.0 / length
        unit = (d[0] * inverse, d[1] * inverse, d[2] * inverse)
        mean = (mean[0] + unit[0], mean[1] + unit[1], mean[2] + unit[2])
        for axis in range(3):
            state.world_directions[lane, axis] = d[axis]
            state.directions[axis, lane] = unit[axis]
        state.units[lane] = length * scene.scale
        state.face_ids[lane], state.fractions[lane] = -1, math.inf
        state.lows[lane], state.highs[lane] = ENDLESS, ENDLESS
    together = together and _fit_planes(local, mean, state)
    return Beam(
        together=together,
        rays=(np.int64(1) << len(chosen)) - 1,
        origin=(np.float32(local[0]), np.float32(local[1]), np.float32(local[2])),
        world_origin=world_origin,
        reach=np.float32(distance + 1.01),
    )


@njit(_nrt=False)
def _scene_place(scene, place):
    return (
        (place[0] - scene.centre[0]) * scene.scale,
        (place[1] - scene.centre[1]) * scene.scale,
        (place[2] - scene.centre[2]) * scene.scale,
    )


@njit(_nrt=False)
def _fit_planes(local, mean, state):
    """Lay four planes around the rays, two along their run and two across it; return whether they are narrow."""
    length = math.sqrt(dot(mean, mean))
    if length < 1.0:
        return False
    axis = (mean[0] / length, mean[1] / length, mean[2] / length)
    across = (
        np.float64(state.directions[0, PACKET - 1] - state.directions[0, 0]),
        np.float64(state.directions[1, PACKET - 1] - state.directions[1, 0]),
        np.float64(state.directions[2, PACKET - 1] - state.directions[2, 0]),
    )
    upward = cross(axis, across)
    size = math.sqrt(dot(upward, upward))
    if size < 1e-6:  # as good as one direction: any side will do
        upward = cross(axis, (1.0, 0.0, 0.0) if abs(axis[0]) < 0.7 else (0.0, 1.0, 0.0))
        size = math.sqrt(dot(upward, upward))
    upward = (upward[0] / size, upward[1] / size, upward[2] / size)
    across = cross(upward, axis)
    left, right, bottom, top, least = math.inf, -math.inf, math.inf, -math.inf, 1.0
    for lane in range(PACKET):
        d = (
            np.float64(state.directions[0, lane]),
            np.float64(state.directions[1, lane]),
            np.float64(state.directions[2, lane]),
        )
        depth = dot(d, axis)
        least = min(least, depth)
        if least < NARROW:
            return False
        inverse = 1.0 / depth
        x, y = dot(d, across) * inverse, dot(d, upward) * inverse
        left, right, bottom, top = min(left, x), max(right, x), min(bottom, y), max(top, y)
    _fill_plane(state.planes[0], 1.0, across, -left, axis, local)
    _fill_plane(state.planes[1], -1.0, across, right, axis, local)
    _fill_plane(state.planes[2], 1.0, upward, -bottom, axis, local)
    _fill_plane(state.planes[3], -1.0, upward, top, axis, local)
    _fill_plane(state.planes[AXIS], 0.0, across, 1.0, axis, local)
    return True


@njit(_nrt=False)
def _fill_plane(plane, sign, side, slant, axis, local):
    """Write the plane through the origin whose normal is ``sign side + slant axis``."""
    normal = (
        sign * side[0] + slant * axis[0],
        sign * side[1] + slant * axis[1],
        sign * side[2] + slant * axis[2],
    )
    inverse = 1.0 / math.sqrt(dot(normal, normal))
    for i in range(3):
        plane[i] = normal[i] * inverse
    plane[3] = -dot(normal, local) * inverse
