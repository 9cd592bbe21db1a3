"""The rays of a sensor, in its own frame: x forward, y to the left, z up; and how each kind of sensor lays them out."""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.arrays import FloatArray, IntArray, as_indices, as_vectors, frozen, sealed
from zbuf_occlude.errors import ArgumentError, OptionError

MOST_RAYS = 8_500_000
"""A mistyped number must not fill the memory."""

RUN_RAYS = 64
"""Neighbouring rays of a ring that are asked together whether they are near a direction."""


class _Runs(NamedTuple):
    """Runs of `RUN_RAYS` rays of like ring; the last one filled up by repeating its last ray."""

    rays: NDArray[np.intp]  # (runs, RUN_RAYS)
    middles: FloatArray  # (runs, 3), unit length
    half_angles: FloatArray  # (runs,) to the farthest ray from the middle


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays from the sensor's origin. Immutable.

    Parameters
    ----------
    directions : (n, 3) float
        Sensor frame (x forward, y left, z up), of any length but 0; stored with length 1.
    rings : (n,) int
        Laser, 0 the lowest; of a camera the row of the picture, 0 the uppermost.
    columns : (n,) int
        Firing, counted along the turn; of a camera the column of the picture, 0 the leftmost.
    """

    directions: FloatArray
    rings: IntArray
    columns: IntArray

    def __post_init__(self) -> None:
        directions = as_vectors(self.directions, "directions")
        lengths = np.linalg.norm(directions, axis=1, keepdims=True)
        if not (lengths > 0).all():
            raise ArgumentError(f"directions must have a length; row {int(lengths.argmin())} is zero. Leave it out.")
        object.__setattr__(self, "directions", sealed(directions / lengths))
        for name in ("rings", "columns"):
            values = as_indices(getattr(self, name), name, columns=None, upper=np.iinfo(np.int32).max)
            if len(values) != len(directions):
                raise ArgumentError(f"{name} must be one per direction ({len(directions)}); got {len(values)}.")
            object.__setattr__(self, name, frozen(values))

    def __len__(self) -> int:
        return len(self.directions)

    def __repr__(self) -> str:
        return f"Rays({len(self)})"

    def select(self, which: ArrayLike) -> "Rays":
        """Return the rays that a boolean mask or an index array picks, in its order."""
        chosen = np.asarray(which)
        return Rays(self.directions[chosen], self.rings[chosen], self.columns[chosen])

    def near(self, direction: FloatArray, angle: float) -> NDArray[np.intp]:
        """Return which rays are within an angle (radians) of a unit direction (3,), ascending; runs are asked first."""
        rays, middles, half_angles = self._runs
        maybe = np.arccos(np.clip(middles @ direction, -1.0, 1.0)) <= half_angles + (angle + 1e-6)
        found = rays[maybe].reshape(-1)
        near = np.zeros(len(self), dtype=bool)
        near[found[self.directions[found] @ direction >= np.cos(min(angle, np.pi))]] = True
        return np.flatnonzero(near)

    @cached_property
    def _runs(self) -> _Runs:
        order = np.argsort(self.rings, kind="stable")
        rays = np.pad(order, (0, -len(order) % RUN_RAYS), mode="edge").reshape(-1, RUN_RAYS)
        directions = self.directions[rays]
        middles = directions.sum(axis=1)
        middles /= np.maximum(np.linalg.norm(middles, axis=1, keepdims=True), np.finfo(np.float64).tiny)
        cosines = np.einsum("rki,ri->rk", directions, middles).min(axis=1)
        return _Runs(rays, middles, np.arccos(np.clip(cosines, -1.0, 1.0)))


def pinhole(
    *,
    width: int,
    height: int,
    fov: float | None = None,
    f: float | None = None,
    cx: float | None = None,
    cy: float | None = None,
) -> Rays:
    """Return the rays of a camera without distortion, through its pixels' centres, row by row.

    Parameters
    ----------
    width, height : int
        Pixels.
    fov : float
        Horizontal field of view, degrees. Give either this or `f`.
    f : float
        Focal length, pixels.
    cx, cy : float
        Where the axis meets the picture, pixels from its upper left corner; its middle by default.
    """
    _not_too_many(width * height)
    if (fov is None) == (f is None):
        raise OptionError(f"a pinhole must be given fov or f, and not both; got fov={fov}, f={f}.")
    focal = f or width / 2.0 / np.tan(np.radians(fov or 0.0) / 2.0)
    rows, columns = np.divmod(np.arange(width * height), width)
    right = (columns + 0.5 - (width / 2.0 if cx is None else cx)) / focal
    down = (rows + 0.5 - (height / 2.0 if cy is None else cy)) / focal
    return Rays(np.stack([np.ones_like(right), -right, -down], axis=1), rows, columns)


def spinning(*, lasers: Sequence[Sequence[float]], columns: int, azimuths: Sequence[float] = (-180.0, 180.0)) -> Rays:
    """Return the rays of a LiDAR that turns about its z axis, firing by firing.

    Parameters
    ----------
    lasers : sequence of (elevation, azimuth offset)
        Degrees, the lowest first.
    columns : int
        Firings of each laser per turn.
    azimuths : (float, float)
        Where the firings begin and end, degrees; the whole turn by default.
    """
    _not_too_many(columns * len(lasers))
    angles, (first, last) = np.radians(lasers), np.radians(azimuths)
    if not (np.abs(angles[:, 0]) <= np.pi / 2).all():
        raise OptionError("lasers must have elevations in [-90, 90] degrees; one has not.")
    turn = first + np.arange(columns) * ((last - first) / columns)
    azimuth = (turn[:, None] + angles[:, 1]).ravel()
    elevation = np.tile(angles[:, 0], columns)
    flat = np.cos(elevation)
    directions = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=1)
    return Rays(directions, np.tile(np.arange(len(angles)), columns), np.repeat(np.arange(columns), len(angles)))


def risley(*, frequencies: Sequence[float], wedge: float, index: float, rate: float, seconds: float) -> Rays:
    """Return the rays of a LiDAR whose one beam passes two turning wedge prisms, shot by shot; all of ring 0.

    Parameters
    ----------
    frequencies : (float, float)
        Turns per second of the two prisms; opposite signs turn opposite ways.
    wedge : float
        Angle of each prism, degrees. Their inclined faces face each other.
    index : float
        Of refraction.
    rate : float
        Shots per second.
    seconds : float
        How long a scan lasts.
    """
    n_shots = round(rate * seconds)
    _not_too_many(n_shots)
    tilt = np.radians(wedge)
    if not index * np.sin(tilt) < 1.0:
        raise OptionError(f"risley must have prisms that let light through; got wedge {wedge:g}, index {index:g}.")
    shots, directions = np.arange(n_shots, dtype=np.int32), np.empty((n_shots, 3))
    for some in np.array_split(shots, 1 + n_shots // 100_000):  # few at a time, for their memory
        first, second = (_inclined(tilt, 2.0 * np.pi * frequency * (some / rate)) for frequency in frequencies)
        axis = np.broadcast_to([1.0, 0.0, 0.0], first.shape)  # the first prism's plane face stands across the beam
        directions[some] = _refracted(_refracted(_refracted(axis, first, index), second, 1.0 / index), axis, index)
    return Rays(directions, np.zeros_like(shots), shots)


def listed(*, directions: ArrayLike, rings: ArrayLike | None = None) -> Rays:
    """Return the rays of a list: directions (n, 3) in the sensor's frame, and rings (n,), 0 by default."""
    given = as_vectors(directions, "directions")
    numbers = np.arange(len(given), dtype=np.int32)
    return Rays(given, np.zeros_like(numbers) if rings is None else np.asarray(rings), numbers)


KINDS: dict[str, Callable[..., Rays]] = {"pinhole": pinhole, "spinning": spinning, "risley": risley, "list": listed}
"""Each kind of sensor, and what makes its rays of its numbers."""


def numbers_of(kind: str) -> dict[str, Any]:
    """Return the numbers that a kind takes and their defaults; `inspect.Parameter.empty` where one must be given."""
    return {name: p.default for name, p in inspect.signature(KINDS[kind]).parameters.items()}


def _inclined(tilt: float, turned: FloatArray) -> FloatArray:
    """Normals of a face inclined by `tilt` towards where the prism has turned to, (n, 3)."""
    across = np.sin(tilt)
    return np.stack([np.full_like(turned, np.cos(tilt)), across * np.cos(turned), across * np.sin(turned)], axis=1)


def _refracted(directions: FloatArray, normals: FloatArray, ratio: float) -> FloatArray:
    """Snell's law for unit vectors; `ratio` is the index before the face over the one behind it."""
    cosine = np.einsum("ij,ij->i", directions, normals)
    behind = np.sqrt(np.maximum(0.0, 1.0 - ratio**2 * (1.0 - cosine**2)))
    return np.asarray(ratio * directions + (behind - ratio * cosine)[:, None] * normals)


def _not_too_many(n: int) -> None:
    if not 0 < n <= MOST_RAYS:
        raise OptionError(f"a sensor must have 1 to {MOST_RAYS:,} rays; this has {n:,}.")
