"""Views: where the cameras stand. The paper's position sets (Eq. 11-12, section 4.3) and the usual others."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.arrays import FloatArray, frozen
from zbuf_occlude.checks import check_int
from zbuf_occlude.errors import ArgumentError, OptionError

PAPER_DISTANCE = 4.0
"""Distance of the camera in units of the object's longest side (paper 4.1)."""

MAX_VIEWS = 1_000_000
"""A mistyped specification must not fill the memory."""


@dataclass(frozen=True, eq=False)
class Views:
    """Camera positions about a target. Immutable.

    Parameters
    ----------
    azimuth : (k,) float
        Radians, from +x towards +y.
    elevation : (k,) float
        Radians, from the xy plane, in [-pi/2, pi/2]; +pi/2 is +z.
    distance : (k,) float or float
        Distance from the target, in world units, positive.
    target : (3,) float
        What the cameras look at, world space.

    Raises
    ------
    ArgumentError
        Different lengths, values out of range or not finite.
    """

    azimuth: FloatArray
    elevation: FloatArray
    distance: FloatArray
    target: FloatArray | Sequence[float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        given = {"azimuth": self.azimuth, "elevation": self.elevation, "distance": self.distance, "target": self.target}
        try:
            *angles, target = (np.asarray(values, dtype=np.float64) for values in given.values())
        except (TypeError, ValueError) as error:
            raise ArgumentError(f"{', '.join(given)} must be numbers; {error}.") from None
        try:
            azimuth, elevation, distance = np.broadcast_arrays(*map(np.atleast_1d, angles))
        except ValueError:
            raise ArgumentError(
                "azimuth, elevation and distance must have one length; got "
                f"{np.size(self.azimuth)}, {np.size(self.elevation)} and {np.size(self.distance)}."
            ) from None
        if azimuth.ndim != 1 or target.shape != (3,):
            raise ArgumentError(f"angles must be (k,) and target (3,); got {azimuth.shape} and {target.shape}.")
        fields = {"azimuth": azimuth, "elevation": elevation, "distance": distance, "target": target}
        for name, values in fields.items():
            if not np.isfinite(values).all():
                raise ArgumentError(f"{name} must be finite; got {values[~np.isfinite(values)][0]}.")
        if (np.abs(elevation) > np.pi / 2 + 1e-9).any():
            worst = np.degrees(elevation[np.abs(elevation).argmax()])
            raise ArgumentError(f"elevation must lie in [-pi/2, pi/2]; got {worst:g} degrees. Give radians.")
        if (distance <= 0).any():
            raise ArgumentError(f"distance must be positive; got {distance.min():g}.")
        for name, values in fields.items():
            object.__setattr__(self, name, frozen(values))

    def __len__(self) -> int:
        return len(self.azimuth)

    def __repr__(self) -> str:
        return f"Views({len(self)})"

    @property
    def eyes(self) -> FloatArray:
        """Centres of projection, world space, (k, 3). At the poles the position is exactly on the z axis."""
        flat = np.where(np.abs(self.elevation) >= np.pi / 2 - 1e-9, 0.0, np.cos(self.elevation))
        direction = np.stack([flat * np.cos(self.azimuth), flat * np.sin(self.azimuth), np.sin(self.elevation)], axis=1)
        return np.asarray(self.target + self.distance[:, None] * direction)

    @property
    def ups(self) -> FloatArray:
        """Up vectors (k, 3), unit: the direction in which elevation grows, so that the poles have one too."""
        sin, cos = np.sin(self.elevation), np.cos(self.elevation)
        return np.stack([-sin * np.cos(self.azimuth), -sin * np.sin(self.azimuth), cos], axis=1)

    def select(self, which: ArrayLike) -> "Views":
        """Return the views that a boolean mask or an index array picks, in its order."""
        chosen = np.asarray(which)
        return Views(self.azimuth[chosen], self.elevation[chosen], self.distance[chosen], self.target)

    def around(self, centre: ArrayLike, scale: float) -> "Views":
        """Return the views about another target, all distances multiplied by `scale`.

        ``views.around(mesh.centre, mesh.longest_side)`` turns distances in longest sides into world units.
        """
        return Views(self.azimuth, self.elevation, self.distance * scale, np.asarray(centre, dtype=np.float64))


def paper100(distance: float = PAPER_DISTANCE) -> Views:
    """Return the paper's 100 positions (Eq. 11-12): 19 elevations 10 degrees apart, 1 to 10 azimuths on each."""
    azimuth, elevation = [], []
    for i in range(1, 20):
        n_azimuths = min(i, 20 - i)
        azimuth.append(np.arange(n_azimuths) * (2 * np.pi / n_azimuths))
        elevation.append(np.full(n_azimuths, np.radians((i - 1) * 10.0 - 90.0)))
    return Views(np.concatenate(azimuth), np.concatenate(elevation), np.asarray(distance))


def modelnet8(distance: float = PAPER_DISTANCE) -> Views:
    """Return the 25 positions of section 4.3: elevations 0, +-40, +-80 by five azimuths 72 degrees apart."""
    return _product(np.radians([-80.0, -40.0, 0.0, 40.0, 80.0]), 5, distance)


def ring(n_views: int, elevation: float, distance: float = PAPER_DISTANCE) -> Views:
    """Return `n_views` equally spaced azimuths at one elevation (radians)."""
    return _product(np.asarray([elevation]), n_views, distance)


def grid(
    n_elevations: int,
    n_azimuths: int,
    elevations: tuple[float, float] = (-np.pi / 2, np.pi / 2),
    distance: float = PAPER_DISTANCE,
) -> Views:
    """Return equally spaced elevations (ends included, radians) by equally spaced azimuths.

    Section 4.3 suggests ``elevations=(0, radians(50))`` for automated driving.
    """
    _positive(n_elevations, "n_elevations")
    low, high = elevations
    levels = np.linspace(low, high, n_elevations) if n_elevations > 1 else np.asarray([(low + high) / 2])
    return _product(levels, n_azimuths, distance)


def fibonacci(n_views: int, distance: float = PAPER_DISTANCE) -> Views:
    """Return `n_views` positions spread evenly over the sphere on a Fibonacci (golden angle) spiral."""
    index = np.arange(_positive(n_views, "n_views"))
    elevation = np.arcsin(1.0 - (2.0 * index + 1.0) / n_views)
    azimuth = (index * np.pi * (3.0 - np.sqrt(5.0))) % (2 * np.pi)
    return Views(azimuth, elevation, np.asarray(distance))


def random(
    n_views: int,
    elevations: tuple[float, float] = (-np.pi / 2, np.pi / 2),
    distance: float = PAPER_DISTANCE,
    seed: int = 0,
) -> Views:
    """Return `n_views` positions uniform over the sphere's band between two elevations (radians)."""
    rng = np.random.default_rng(seed)
    low, high = np.sin(elevations[0]), np.sin(elevations[1])
    elevation = np.arcsin(np.clip(rng.uniform(low, high, _positive(n_views, "n_views")), -1, 1))
    return Views(rng.uniform(0, 2 * np.pi, n_views), elevation, np.asarray(distance))


def from_csv(path: str | Path) -> Views:
    """Read views from a CSV with the columns azimuth, elevation (degrees) and, optionally, distance.

    Distances are in longest sides of the object; without the column they are the paper's 4.

    Raises
    ------
    OptionError
        The file is missing, lacks a column, has no rows, or holds something that is not a number or out of range.
    """
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise OptionError(f"views must be a readable CSV; {path}: {error}.") from None
    if not rows or not {"azimuth", "elevation"} <= set(rows[0]):
        found = ", ".join(map(str, rows[0])) if rows else "no rows"
        raise OptionError(f"{path} must have the columns azimuth,elevation[,distance] and a row; found: {found}.")
    try:
        table = np.array([[float(r[c]) for c in ("azimuth", "elevation")] for r in rows])
        distance = np.array([float(r.get("distance") or PAPER_DISTANCE) for r in rows])
    except (TypeError, ValueError) as error:
        raise OptionError(f"{path} must hold numbers, angles in degrees; {error}.") from None
    if (np.abs(table[:, 1]) > 90).any():
        worst = table[np.abs(table[:, 1]).argmax(), 1]
        raise OptionError(f"{path} must hold elevations in [-90, 90] degrees from the xy plane; got {worst:g}.")
    try:
        return Views(np.radians(table[:, 0]), np.radians(table[:, 1]), distance)
    except ArgumentError as error:
        raise OptionError(f"{path}, a table of views in degrees: {error}") from None


SPECS = "paper100, modelnet8, ring:N@EL, grid:ELxAZ[@EL0..EL1], fibonacci:N, random:N[@EL0..EL1], or a CSV file"

_NUMBER = r"([-+]?\d+(?:\.\d*)?)"
_RANGE = rf"(?:@{_NUMBER}\.\.{_NUMBER})?"


def parse(spec: str, *, distance: float = PAPER_DISTANCE, seed: int = 0) -> Views:
    """Make views from what a person types: angles in degrees, distances in longest sides.

    Parameters
    ----------
    spec : str
        One of `SPECS`.
    distance : float
        For all but a CSV.
    seed : int
        For ``random``.

    Raises
    ------
    OptionError
        Not understood; the message says what there is.
    """
    if match := re.fullmatch(rf"ring:(\d+)@{_NUMBER}", spec):
        return ring(int(match[1]), _band(match[2], match[2])[0], distance)
    if match := re.fullmatch(rf"grid:(\d+)x(\d+){_RANGE}", spec):
        return grid(int(match[1]), int(match[2]), _band(match[3], match[4]), distance)
    if match := re.fullmatch(r"fibonacci:(\d+)", spec):
        return fibonacci(int(match[1]), distance)
    if match := re.fullmatch(rf"random:(\d+){_RANGE}", spec):
        return random(int(match[1]), _band(match[2], match[3]), distance, seed)
    if spec == "paper100":
        return paper100(distance)
    if spec == "modelnet8":
        return modelnet8(distance)
    if spec.lower().endswith(".csv"):
        return from_csv(spec)
    raise OptionError(f"views must be {SPECS}; got {spec!r}.")


def _band(low: str | None, high: str | None) -> tuple[float, float]:
    low_degrees, high_degrees = float(low or -90.0), float(high or 90.0)
    if not -90.0 <= low_degrees <= high_degrees <= 90.0:
        raise OptionError(f"elevations must run upwards within -90..90; got {low_degrees:g}..{high_degrees:g}.")
    return np.radians(low_degrees), np.radians(high_degrees)


def _product(elevations: FloatArray, n_azimuths: int, distance: float) -> Views:
    azimuths = np.arange(_positive(n_azimuths, "n_azimuths")) * (2 * np.pi / n_azimuths)
    _positive(len(elevations) * n_azimuths, "the number of views")
    return Views(np.tile(azimuths, len(elevations)), np.repeat(elevations, n_azimuths), np.asarray(distance))


def _positive(count: int, name: str) -> int:
    check_int(name, count, 1)
    if count > MAX_VIEWS:
        raise OptionError(f"{name} must be at most {MAX_VIEWS:,}; got {count}.")
    return int(count)
