"""Rays of a sensor, and the patterns by which each kind of sensor casts them.

Rays are in the sensor's own frame: x forward, y to the left, z up.
"""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.base.arrays import (
    FloatArray,
    IntArray,
    as_indices,
    as_selection,
    as_vectors,
    readonly_copy,
    set_readonly,
    unit_vectors,
)
from zbuf_occlude.base.errors import ArgumentError, OptionError

MAX_RAYS = 8_500_000
"""Maximum rays of a sensor: a mistyped number must not fill the memory."""

PLASTIC = 1.32471795724474602596
"""Plastic number, the real root of x^3 = x + 1: the base of the sequence R2."""
RUN_RAYS = 64
"""Neighbouring rays of a ring whose bounding cone `Rays.near` tests before the rays themselves."""


class _Runs(NamedTuple):
    """Runs of `RUN_RAYS` rays, ordered by ring; the last run is padded with its last ray."""

    rays: NDArray[np.intp]  # (runs, RUN_RAYS)
    middles: FloatArray  # (runs, 3), unit length
    half_angles: FloatArray  # (runs,) to the farthest ray from the middle


@dataclass(frozen=True, eq=False)
class Rays:
    """The rays of a sensor. Immutable.

    Parameters
    ----------
    directions : (n, 3) float
        Sensor frame (x forward, y left, z up). Any length but 0; stored as unit vectors.
    rings : (n,) int
        Number of the laser, 0 the lowest. For a camera: row of the image, 0 the uppermost.
    columns : (n,) int
        Number of the firing along the revolution. For a camera: column of the image, 0 the leftmost.
    origins : (n, 3) float, optional
        Start of each ray, sensor frame. Default: the sensor's origin.
    times : (n,) float, optional
        Time of each ray, seconds from the start of the revolution or image. Default: all at once.
    """

    directions: FloatArray
    rings: IntArray
    columns: IntArray
    origins: FloatArray | None = None
    times: FloatArray | None = None

    def __post_init__(self) -> None:
        directions = as_vectors(self.directions, "directions")
        lengths = np.linalg.norm(directions, axis=1, keepdims=True)
        if not (lengths > 0).all():
            raise ArgumentError(
                f"directions must have a length above 0; row {int(lengths.argmin())} is zero. Leave it out."
            )
        checked: dict[str, NDArray[Any]] = {"directions": set_readonly(directions / lengths)}
        for name in ("rings", "columns"):
            checked[name] = readonly_copy(
                as_indices(getattr(self, name), name, columns=None, upper=np.iinfo(np.int32).max)
            )
        if self.origins is not None:
            checked["origins"] = set_readonly(as_vectors(self.origins, "origins"))
        if self.times is not None:
            checked["times"] = times = set_readonly(np.asarray(self.times, dtype=np.float64))
            if times.ndim != 1:
                raise ArgumentError(f"times must be one number per direction ({len(directions)}); got {times.shape}.")
            if not np.isfinite(times).all():
                raise ArgumentError(f"times must be finite; row {int(np.isfinite(times).argmin())} is not.")
        for name, values in checked.items():
            if len(values) != len(directions):
                raise ArgumentError(f"{name} must be one per direction ({len(directions)}); got {len(values)}.")
        vars(self).update(checked)

    def __len__(self) -> int:
        return len(self.directions)

    def __repr__(self) -> str:
        return f"Rays({len(self)})"

    @cached_property
    def spread(self) -> float:
        """Greatest distance of a ray's start from the sensor's origin, metres."""
        return 0.0 if self.origins is None else float(np.linalg.norm(self.origins, axis=1).max(initial=0.0))

    def select(self, which: ArrayLike) -> "Rays":
        """Return the rays that a boolean mask or an index array selects, in its order."""
        chosen = as_selection(which, len(self), "rays")
        origins, times = (None if each is None else each[chosen] for each in (self.origins, self.times))
        return Rays(self.directions[chosen], self.rings[chosen], self.columns[chosen], origins, times)

    def near(self, direction: FloatArray, angle: float) -> NDArray[np.intp]:
        """Return the indices of the rays within `angle` (radians) of a unit direction (3,), ascending."""
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
        middles = unit_vectors(directions.sum(axis=1))
        cosines = np.einsum("rki,ri->rk", directions, middles).min(axis=1)
        return _Runs(rays, middles, np.arccos(np.clip(cosines, -1.0, 1.0)))


def pinhole(
    *,
    width: int,
    height: int,
    fov: float | None = None,
    f: float | None = None,
    fy: float | None = None,
    cx: float | None = None,
    cy: float | None = None,
    readout: float = 0.0,
) -> Rays:
    """Return the rays of a camera without distortion, through the centres of its pixels, row by row.

    Parameters
    ----------
    width, height : int
        Pixels.
    fov : float, optional
        Horizontal field of view, degrees. Either `fov` or `f` is needed.
    f, fy : float, optional
        Focal lengths, pixels. `fy` is `f` by default.
    cx, cy : float, optional
        Principal point, pixels from the upper left corner. Default: the middle of the image.
    readout : float
        Seconds from the first row to the end of the last one (rolling shutter); 0: all rows at once.
    """
    _check_count(width * height)
    if (fov is None) == (f is None):
        raise OptionError(f"a pinhole must be given fov or f, and not both; got fov={fov}, f={f}.")
    focal = f or width / 2.0 / np.tan(np.radians(fov or 0.0) / 2.0)
    rows, columns = np.divmod(np.arange(width * height), width)
    right = (columns + 0.5 - (width / 2.0 if cx is None else cx)) / focal
    down = (rows + 0.5 - (height / 2.0 if cy is None else cy)) / (fy or focal)
    times = rows * (readout / height) if readout else None
    return Rays(np.stack([np.ones_like(right), -right, -down], axis=1), rows, columns, times=times)


def spinning(
    *,
    lasers: Sequence[Sequence[float]],
    columns: int,
    azimuths: Sequence[float] = (-180.0, 180.0),
    turns: float = 10.0,
    offsets: Sequence[Sequence[float]] | None = None,
) -> Rays:
    """Return the rays of a LiDAR that turns about its z axis, firing by firing.

    Parameters
    ----------
    lasers : (l, 2) float
        Elevation and azimuth offset of each laser, degrees, the lowest first.
    columns : int
        Firings per revolution.
    azimuths : (float, float)
        Azimuths of the first and the last firing, degrees. A whole revolution ends one step before the second azimuth.
    turns : float
        Revolutions per second.
    offsets : (l, 2) float, optional
        Metres of each laser above the sensor's origin, and to the left of it as seen along the ray. Default: 0.
    """
    _check_count(columns * len(lasers))
    angles, (first, last) = np.radians(lasers), np.radians(azimuths)
    if not (np.abs(angles[:, 0]) <= np.pi / 2).all():
        steepest = float(np.degrees(np.abs(angles[:, 0]).max()))
        raise OptionError(f"lasers must have elevations in [-90, 90] degrees; one has {steepest:g}.")
    _check_lowest_first("lasers", [elevation for elevation, _ in lasers])
    is_whole = np.isclose(abs(last - first), 2.0 * np.pi)  # the last azimuth would repeat the first
    turn = first + np.arange(columns) * ((last - first) / max(columns if is_whole else columns - 1, 1))
    azimuth = (turn[:, None] + angles[:, 1]).ravel()
    elevation = np.tile(angles[:, 0], columns)
    flat = np.cos(elevation)
    directions = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=1)
    firings, rings = np.divmod(np.arange(columns * len(angles), dtype=np.int32), len(angles))
    if offsets is not None and len(offsets) != len(lasers):
        raise OptionError(f"offsets must be one per laser ({len(lasers)}); got {len(offsets)}. Give both, or neither.")
    origins = None if offsets is None else beside_axis(azimuth, np.tile(np.asarray(offsets, np.float64), (columns, 1)))
    return Rays(directions, rings, firings, origins, times=firings / (columns * turns))


def beside_axis(azimuths: FloatArray, offsets: FloatArray) -> FloatArray:
    """Return the positions (n, 3) of lasers that point along `azimuths` (radians); `offsets` (n, 2) are up and left."""
    up, left = offsets.T
    return np.stack([-left * np.sin(azimuths), left * np.cos(azimuths), up], axis=1)


def risley(
    *,
    frequencies: Sequence[float],
    wedge: float,
    index: float,
    rate: float,
    seconds: float,
    begin: float = 0.0,
    fan: Sequence[float] = (0.0,),
) -> Rays:
    """Return the rays of a LiDAR whose beams pass two rotating wedge prisms, shot by shot.

    Parameters
    ----------
    frequencies : (float, float)
        Revolutions of each prism per second; opposite signs mean opposite directions.
    wedge : float
        Angle of each prism, degrees. The inclined faces of the two prisms face each other.
    index : float
        Index of refraction of the prisms.
    rate : float
        Shots per second, of all lasers.
    seconds : float
        Duration of a scan.
    begin : float
        Seconds from the moment at which both prisms are at angle 0 to the first shot.
    fan : (l,) float
        Elevation of each laser's beam before the prisms, degrees, the lowest first. All lasers shoot at once; each is a
        ring.
    """
    n_columns = round(rate * seconds / len(fan))
    _check_count(n_columns * len(fan))
    _check_lowest_first("fan", fan)
    tilt = np.radians(wedge)
    if not index * np.sin(tilt) < 1.0:
        raise OptionError(
            f"index times the sine of wedge must be below 1, or the prisms reflect all light; got wedge {wedge:g}, "
            f"index {index:g}."
        )
    columns, rings = (each.astype(np.int32) for each in np.divmod(np.arange(n_columns * len(fan)), len(fan)))
    times, directions = columns * len(fan) / rate, np.empty((len(columns), 3))
    rises = np.arcsin(np.sin(np.radians(fan)) / index)  # within the first prism, whose flat face is normal to the axis
    beams = np.stack([np.cos(rises), np.zeros(len(fan)), np.sin(rises)], axis=1)
    for some in np.array_split(np.arange(len(columns)), 1 + len(columns) // 100_000):  # in blocks, to limit memory
        first, second = (_inclined(tilt, 2.0 * np.pi * each * (begin + times[some])) for each in frequencies)
        axis = np.broadcast_to([1.0, 0.0, 0.0], first.shape)
        between = _refract(_refract(beams[rings[some]], first, index), second, 1.0 / index)
        directions[some] = _refract(between, axis, index)
    return Rays(directions, rings, columns, times=times)


def non_repetitive(
    *, azimuths: Sequence[float], elevations: Sequence[float], rate: float, seconds: float, begin: float = 0.0
) -> Rays:
    """Return the rays of a LiDAR whose shots fill its field of view more and more densely; all are of ring 0.

    It approximates patterns that makers do not publish. The shots are evenly spread over the solid angle at any moment
    and never repeat: the sequence R2 of Roberts (2018), of low discrepancy, in azimuth and in the sine of elevation.

    Parameters
    ----------
    azimuths, elevations : (float, float)
        Edges of the field of view, degrees.
    rate : float
        Shots per second.
    seconds : float
        Duration of a scan.
    begin : float
        Seconds from the first shot of the sequence to the first one of the scan.
    """
    n_shots = round(rate * seconds)
    _check_count(n_shots)
    shots = np.arange(n_shots, dtype=np.int32)
    steps = 0.5 + round(begin * rate) + shots
    (left, right), (low, high) = np.radians(azimuths), np.sin(np.radians(elevations))
    azimuth = left + (right - left) * (steps / PLASTIC % 1.0)
    up = low + (high - low) * (steps / PLASTIC**2 % 1.0)
    level = np.sqrt(1.0 - up**2)
    directions = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), up], axis=1)
    return Rays(directions, np.zeros_like(shots), shots, times=shots / rate)


def linear(*, columns: int, spacing: float, rows: int, slopes: Sequence[float]) -> Rays:
    """Return the rays of a line scanner that moves along its y axis, column by column, from left to right.

    Parameters
    ----------
    columns : int
        Positions of the scanner; the middle one is the sensor's origin.
    spacing : float
        Metres between two columns.
    rows : int
        Rays of a column, a fan in the xz plane. Ring 0 is the lowest.
    slopes : (float, float)
        Slopes (z per x) of the first and the last ray of the fan; those between are evenly spaced.
    """
    _check_count(rows * columns)
    shifts = spacing * ((columns - 1) / 2.0 - np.arange(columns))
    up = np.linspace(slopes[0], slopes[1], rows)
    directions = np.stack([np.ones(rows), np.zeros(rows), up], axis=1)
    origins = np.zeros((columns, rows, 3))
    origins[..., 1] = shifts[:, None]
    firings, rings = np.divmod(np.arange(columns * rows, dtype=np.int32), rows)
    return Rays(np.tile(directions, (columns, 1)), rings, firings, origins.reshape(-1, 3))


def listed(*, directions: ArrayLike, rings: ArrayLike | None = None) -> Rays:
    """Return rays of given directions (n, 3), sensor frame, and rings (n,), 0 by default."""
    given = as_vectors(directions, "directions")
    numbers = np.arange(len(given), dtype=np.int32)
    return Rays(given, np.zeros_like(numbers) if rings is None else np.asarray(rings), numbers)


PATTERNS: dict[str, Callable[..., Rays]] = {
    "pinhole": pinhole,
    "spinning": spinning,
    "risley": risley,
    "non_repetitive": non_repetitive,
    "linear": linear,
    "list": listed,
}
"""The function that returns the rays, for each kind of sensor."""


def numbers_of(kind: str) -> dict[str, Any]:
    """Return the numbers that a kind takes, with their defaults; `inspect.Parameter.empty` where there is none."""
    return {name: p.default for name, p in inspect.signature(PATTERNS[kind]).parameters.items()}


def _inclined(tilt: float, angles: FloatArray) -> FloatArray:
    """Return the normals (n, 3) of a prism's inclined face at the prism's rotation angles (n,); all are radians."""
    across = np.sin(tilt)
    return np.stack([np.full_like(angles, np.cos(tilt)), across * np.cos(angles), across * np.sin(angles)], axis=1)


def _refract(directions: FloatArray, normals: FloatArray, ratio: float) -> FloatArray:
    """Return unit vectors refracted by Snell's law; `ratio` is the index before the face over that behind it."""
    cosine = np.einsum("ij,ij->i", directions, normals)
    behind = np.sqrt(np.maximum(0.0, 1.0 - ratio**2 * (1.0 - cosine**2)))
    return np.asarray(ratio * directions + (behind - ratio * cosine)[:, None] * normals)


def _check_count(n: int) -> None:
    if not 0 < n <= MAX_RAYS:
        raise OptionError(f"a sensor must have 1 to {MAX_RAYS:,} rays; it has {n:,}.")


def _check_lowest_first(name: str, elevations: Sequence[float]) -> None:
    """Raise OptionError where a laser is below the one before it: a ring is the place of its laser, 0 the lowest."""
    for i, (before, after) in enumerate(pairwise(elevations)):
        if after < before:
            raise OptionError(
                f"{name} must have the lowest elevation first; {i} has {before:g} degrees and {i + 1} has {after:g}. "
                "Sort them, and offsets with them."
            )
