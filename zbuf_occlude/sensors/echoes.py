"""Beams of a sensor: the surfaces that their rays meet, and the echoes that come back."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import FloatArray, IntArray, unit_vectors
from zbuf_occlude.sensors.casting import cast
from zbuf_occlude.sensors.rays import Rays
from zbuf_occlude.sensors.sensor import NoiseModel
from zbuf_occlude.visibility.interface import FirstHits, VisibilityQuery

_CROSS = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
_SPREAD = 0.5
"""Offset of a beam's four outer rays along both axes, over its half angle: they lie at 0.7 of its radius."""


class Echoes(NamedTuple):
    """Returns of beams, in the order of the rays; those of one beam the nearest first. All arrays are (m,)."""

    rays: NDArray[np.intp]
    face_ids: IntArray
    ranges: FloatArray
    n_returns: IntArray
    numbers: IntArray
    shares: FloatArray
    lights: FloatArray  # share of its rays' light that meets it and comes back through the faces in front

    def select(self, which: NDArray[Any]) -> "Echoes":
        """Return the echoes that a mask or indices select."""
        return Echoes._make(each[which] for each in self)


def _light(hits: FirstHits, transmittance: FloatArray) -> tuple[FirstHits, FloatArray, FloatArray]:
    """Return the hits (n, r, l) that light meets, the share of the ray's light there, and the share that comes back.

    A face of transmittance T is met by the share 1 - T of the light that reaches it. On its way back the light is
    attenuated by the same factors again.
    """
    through = np.where(hits.face_ids >= 0, transmittance[hits.face_ids], 1.0)
    reaching = np.concatenate([np.ones_like(through[..., :1]), np.cumprod(through[..., :-1], axis=2)], axis=2)
    meeting = reaching * (1.0 - through)
    lit = meeting > 0.0
    hits = FirstHits(np.where(lit, hits.face_ids, -1), np.where(lit, hits.distances, np.inf))
    return hits, meeting, meeting * reaching


def echoes_of(hits: FirstHits, model: NoiseModel, transmittance: FloatArray | None) -> Echoes:
    """Return the echoes of n beams of r rays that met l faces each, (n, r, l).

    Surfaces nearer to each other than `echo_separation` give one echo. `returns` says which echoes are kept. The share
    of an echo is that of the beam's light that met it. `transmittance` (f,) is the share of light that faces let pass.
    """
    n_beams, n_rays, n_layers = hits.face_ids.shape
    light: list[Any] = []
    if transmittance is not None:
        hits, *light = _light(hits, transmittance)
    elif n_rays == n_layers == 1:
        some = np.flatnonzero(hits.face_ids[:, 0, 0] >= 0)
        ones, wholes = np.ones(len(some), dtype=np.int32), np.ones(len(some))
        return Echoes(some, hits.face_ids[some, 0, 0], hits.distances[some, 0, 0], ones, ones, wholes, wholes)
    flat = [each.reshape(n_beams, n_rays * n_layers) for each in (*hits, *light)]
    order = np.argsort(flat[1], axis=1, kind="stable")
    # (5, n): NumPy is slow along short rows
    faces, ranges, *light = (np.ascontiguousarray(np.take_along_axis(each, order, axis=1).T) for each in flat)
    meeting, returning = light or (1.0, 1.0)
    ray_of = order.T // n_layers
    met = faces >= 0
    with np.errstate(invalid="ignore"):
        apart = np.diff(ranges, axis=0) > (model.echo_separation if model.noise else 0.0)
    echo = np.zeros(ranges.shape, dtype=np.int32)
    np.cumsum(apart & met[1:], axis=0, out=echo[1:])
    n_returns = np.where(met[0], 1 + np.where(met, echo, 0).max(axis=0), 0).astype(np.int32)
    numbers = range(max(int(n_returns.max(initial=0)), 1))
    energy = np.where(met, returning / np.where(met, ranges, 1.0) ** 2, 0.0)
    if model.returns == "first":
        kept = [np.zeros(ranges.shape[1], dtype=int)]
    elif model.returns == "last":
        kept = [np.maximum(n_returns - 1, 0)]
    elif model.returns == "all":
        kept = [np.full(ranges.shape[1], number) for number in numbers]
    else:
        kept = [np.stack([(energy * (echo == number)).sum(axis=0) for number in numbers]).argmax(axis=0)]
    parts = []
    for chosen in kept:
        mine = met & (echo == chosen)
        weights = np.where(mine, energy, 0.0)
        total = weights.sum(axis=0)
        moments = (weights * np.where(met, ranges, 0.0)).sum(axis=0)
        mean = np.divide(moments, total, out=np.full(len(total), np.inf), where=total > 0)
        with np.errstate(invalid="ignore"):
            best = np.where(mine, np.abs(ranges - mean), np.inf).argmin(axis=0)
        rays = np.flatnonzero(total > 0)
        face_ids, return_numbers = faces[best[rays], rays].astype(np.int32), (chosen[rays] + 1).astype(np.int32)
        n_met = mine.sum(axis=0)
        if n_layers > 1:  # a ray that meets several faces of one echo counts once
            n_met = np.sum([(mine & (ray_of == number)).any(axis=0) for number in range(n_rays)], axis=0)
        met_by, back = ((mine * each).sum(axis=0) if light else n_met for each in (meeting, returning))
        shares, lights = met_by[rays] / n_rays, back[rays] / n_met[rays]
        parts.append(Echoes(rays, face_ids, mean[rays], n_returns[rays], return_numbers, shares, lights))
    if len(parts) == 1:
        return parts[0]
    whole = Echoes._make(np.concatenate(each) for each in zip(*parts, strict=True))
    return whole.select(np.argsort(whole.rays, kind="stable"))


def cast_beams(
    occluder: VisibilityQuery, rays: Rays, rotation: FloatArray, origin: FloatArray, model: NoiseModel
) -> FirstHits:
    """Return the hits of each beam's rays, (n, 5, l), or (n, 1, l) without divergence.

    The number l of layers is 1 where all faces are opaque.
    """
    by_ring = np.argsort(rays.rings, kind="stable")  # neighbouring rays in sequence cast up to 20 times as fast
    directions = rays.directions[by_ring] @ rotation.T
    if model.divergence == 0.0 or model.noise == 0.0:
        beams = directions[:, None]
    else:
        across, upwards = perpendiculars(directions)
        spread = _SPREAD * model.divergence / 2.0
        beams = np.empty((len(directions), len(_CROSS), 3))
        for number, (x, y) in enumerate(_CROSS):
            beams[:, number] = directions + spread * (x * across + y * upwards)
    starts = origin[None]
    if rays.origins is not None:
        starts = np.repeat(origin + rays.origins[by_ring] @ rotation.T, beams.shape[1], axis=0)
    times = None if rays.times is None else np.repeat(rays.times[by_ring], beams.shape[1])
    face_ids, distances = cast(occluder, starts, beams.reshape(-1, 3), times)
    shape, back = (*beams.shape[:2], face_ids.shape[1]), np.empty_like(by_ring)
    back[by_ring] = np.arange(len(by_ring))
    return FirstHits(face_ids.reshape(shape)[back], distances.reshape(shape)[back])


def perpendiculars(directions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two unit vectors (n, 3) perpendicular to each of some directions (n, 3) and to each other."""
    across = unit_vectors(np.cross(directions, np.eye(3)[np.abs(directions).argmin(axis=1)]))
    return across, np.cross(directions, across)
