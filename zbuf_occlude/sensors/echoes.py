"""What each beam of a sensor meets, and which echoes of it come back."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray, IntArray
from zbuf_occlude.sensors.casting import cast
from zbuf_occlude.sensors.sensor import NoiseModel, Rays
from zbuf_occlude.visibility.interface import FirstHits, VisibilityQuery

_CROSS = np.array([[0.0, 0.0], [1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
_SPREAD = 0.5
"""How far along both axes a beam's four outer rays go, of its half angle: 0.7 of its radius."""


class Echoes(NamedTuple):
    """Returns of beams, in the order of the rays, those of one beam the nearest first; (m,) each."""

    rays: NDArray[np.intp]
    face_ids: IntArray
    ranges: FloatArray
    n_returns: IntArray
    numbers: IntArray
    shares: FloatArray
    lights: FloatArray  # of the light of its rays what meets it and comes back through what is before it

    def select(self, which: NDArray[Any]) -> "Echoes":
        """Return those that a mask or indices pick."""
        return Echoes._make(each[which] for each in self)


def _light(hits: FirstHits, transmittance: FloatArray) -> tuple[FirstHits, FloatArray, FloatArray]:
    """Return hits (n, r, l), the share of a ray's light that meets each, and what comes back of it.

    A face that lets the share T pass is met by the share 1 - T of the light that reaches it. On its way back light
    loses as much again.
    """
    through = np.where(hits.face_ids >= 0, transmittance[hits.face_ids], 1.0)
    reaching = np.concatenate([np.ones_like(through[..., :1]), np.cumprod(through[..., :-1], axis=2)], axis=2)
    meeting = reaching * (1.0 - through)
    lit = meeting > 0.0
    hits = FirstHits(np.where(lit, hits.face_ids, -1), np.where(lit, hits.distances, np.inf))
    return hits, meeting, meeting * reaching


def echoes_of(hits: FirstHits, faults: NoiseModel, transmittance: FloatArray | None) -> Echoes:
    """Return what comes back of each beam of r rays that met l faces each, (n, r, l): near surfaces run together.

    Of separate surfaces one is kept, or all. A return's share is that of the beam's light that met it. `transmittance`
    (f,) is the share of light that faces let pass.
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
    # (5, n): numpy is slow along short rows
    faces, ranges, *light = (np.ascontiguousarray(np.take_along_axis(each, order, axis=1).T) for each in flat)
    meeting, returning = light or (1.0, 1.0)
    ray_of = order.T // n_layers
    met = faces >= 0
    with np.errstate(invalid="ignore"):
        apart = np.diff(ranges, axis=0) > (faults.echo_separation if faults.noise else 0.0)
    echo = np.zeros(ranges.shape, dtype=np.int32)
    np.cumsum(apart & met[1:], axis=0, out=echo[1:])
    n_returns = np.where(met[0], 1 + np.where(met, echo, 0).max(axis=0), 0).astype(np.int32)
    numbers = range(max(int(n_returns.max(initial=0)), 1))
    energy = np.where(met, returning / np.where(met, ranges, 1.0) ** 2, 0.0)
    if faults.returns == "first":
        kept = [np.zeros(ranges.shape[1], dtype=int)]
    elif faults.returns == "last":
        kept = [np.maximum(n_returns - 1, 0)]
    elif faults.returns == "all":
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
        if n_layers > 1:  # a ray that meets a pane and what stands just behind it counts once
            n_met = np.sum([(mine & (ray_of == number)).any(axis=0) for number in range(n_rays)], axis=0)
        met_by, back = ((mine * each).sum(axis=0) if light else n_met for each in (meeting, returning))
        shares, lights = met_by[rays] / n_rays, back[rays] / n_met[rays]
        parts.append(Echoes(rays, face_ids, mean[rays], n_returns[rays], return_numbers, shares, lights))
    if len(parts) == 1:
        return parts[0]
    whole = Echoes._make(np.concatenate(each) for each in zip(*parts, strict=True))
    return whole.select(np.argsort(whole.rays, kind="stable"))


def cast_beams(
    occluder: VisibilityQuery, rays: Rays, rotation: FloatArray, origin: FloatArray, faults: NoiseModel
) -> FirstHits:
    """What each beam's rays meet, (n, 5, l), or (n, 1, l) without divergence; l is 1 where all faces are opaque."""
    by_ring = np.argsort(rays.rings, kind="stable")  # neighbours follow each other: up to twenty times as fast to cast
    directions = rays.directions[by_ring] @ rotation.T
    if faults.divergence == 0.0 or faults.noise == 0.0:
        beams = directions[:, None]
    else:
        across, upwards = square_to(directions)
        spread = _SPREAD * faults.divergence / 2.0
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


def unit_vectors(vectors: FloatArray) -> FloatArray:
    """Return vectors (n, 3) in the same directions, of length 1; those of length 0 stay."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), np.finfo(np.float64).tiny))


def square_to(directions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two unit vectors (n, 3) square to each of some directions (n, 3) and to each other."""
    across = unit_vectors(np.cross(directions, np.eye(3)[np.abs(directions).argmin(axis=1)]))
    return across, np.cross(directions, across)
