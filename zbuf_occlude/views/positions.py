"""Sets of camera positions: the paper's (Eq. 11-12, section 4.3) and the usual others."""

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.checks import check_int
from zbuf_occlude.errors import ArgumentError, OptionError
from zbuf_occlude.seeds import generator
from zbuf_occlude.views.model import Views

PAPER_DISTANCE = 4.0
"""Distance of the camera in units of the object's longest side (paper 4.1)."""

MAX_VIEWS = 1_000_000
"""A mistyped specification must not fill the memory."""

Seed = int | np.random.SeedSequence


def from_angles(azimuth: float, elevation: float, distance: float = PAPER_DISTANCE, roll: float = 0.0) -> Views:
    """Return one view, by angles in degrees as they are typed, about the origin.

    Parameters
    ----------
    azimuth : float
        Degrees from +x towards +y.
    elevation : float
        Degrees above the xy plane, within -90..90; 90 is +z.
    distance : float
        In whatever unit; `Views.around` turns longest sides into those of a mesh.
    roll : float
        Degrees; positive turns the camera's top towards its right.

    Raises
    ------
    ArgumentError
        Not finite, or out of range.

    Examples
    --------
    >>> zo.views.from_angles(azimuth=90, elevation=0, distance=2).eyes.round(6).tolist()
    [[0.0, 2.0, 0.0]]
    """
    try:
        angles = np.array([azimuth, elevation, roll], dtype=np.float64)
    except (TypeError, ValueError):
        angles = np.full(0, np.nan)
    if angles.shape != (3,):
        raise ArgumentError(
            f"azimuth, elevation and roll must be numbers; got {azimuth!r:.40}, {elevation!r:.40} and {roll!r:.40}."
        )
    if not np.abs(angles[1]) <= 90.0:
        raise ArgumentError(f"elevation must lie in [-90, 90], degrees; got {elevation}.")
    radians = np.radians(angles)
    return Views(radians[:1], radians[1:2], np.asarray(distance), roll=radians[2:])


def paper100(distance: float = PAPER_DISTANCE) -> Views:
    """Return the paper's 100 positions (Eq. 11-12): 19 elevations 10 degrees apart, 1 to 10 azimuths on each.

    Examples
    --------
    >>> len(zo.views.paper100())
    100
    """
    azimuth, elevation = [], []
    for i in range(1, 20):
        n_azimuths = min(i, 20 - i)
        azimuth.append(np.arange(n_azimuths) * (2 * np.pi / n_azimuths))
        elevation.append(np.full(n_azimuths, np.radians((i - 1) * 10.0 - 90.0)))
    return Views(np.concatenate(azimuth), np.concatenate(elevation), np.asarray(distance))


def modelnet8(distance: float = PAPER_DISTANCE) -> Views:
    """Return the 25 positions of section 4.3: elevations 0, +-40, +-80 by five azimuths 72 degrees apart.

    Examples
    --------
    >>> len(zo.views.modelnet8())
    25
    """
    return _product(np.radians([-80.0, -40.0, 0.0, 40.0, 80.0]), 5, distance)


def ring(n_views: int, elevation: float, distance: float = PAPER_DISTANCE) -> Views:
    """Return `n_views` equally spaced azimuths at one elevation (radians).

    Examples
    --------
    >>> np.degrees(zo.views.ring(4, np.radians(20)).azimuth).tolist()
    [0.0, 90.0, 180.0, 270.0]
    """
    return _product(np.asarray([elevation]), n_views, distance)


def grid(
    n_elevations: int,
    n_azimuths: int,
    elevations: tuple[float, float] = (-np.pi / 2, np.pi / 2),
    distance: float = PAPER_DISTANCE,
) -> Views:
    """Return equally spaced elevations (ends included, radians) by equally spaced azimuths.

    Section 4.3 suggests ``elevations=(0, radians(50))`` for automated driving.

    Examples
    --------
    >>> len(zo.views.grid(3, 4))
    12
    """
    _positive(n_elevations, "n_elevations")
    low, high = elevations
    levels = np.linspace(low, high, n_elevations) if n_elevations > 1 else np.asarray([(low + high) / 2])
    return _product(levels, n_azimuths, distance)


def fibonacci(n_views: int, distance: float = PAPER_DISTANCE) -> Views:
    """Return `n_views` positions spread evenly over the sphere on a Fibonacci (golden angle) spiral.

    Examples
    --------
    >>> zo.views.fibonacci(50, distance=2.0)
    Views(50 views about (0, 0, 0))
    """
    index = np.arange(_positive(n_views, "n_views"))
    elevation = np.arcsin(1.0 - (2.0 * index + 1.0) / n_views)
    azimuth = (index * np.pi * (3.0 - np.sqrt(5.0))) % (2 * np.pi)
    return Views(azimuth, elevation, np.asarray(distance))


def random(
    n_views: int,
    elevations: tuple[float, float] = (-np.pi / 2, np.pi / 2),
    distance: float = PAPER_DISTANCE,
    seed: Seed = 0,
) -> Views:
    """Return `n_views` positions uniform over the sphere's band between two elevations (radians).

    Examples
    --------
    >>> bool((zo.views.random(9, elevations=(0.0, 0.5), seed=1).elevation >= 0).all())
    True
    """
    rng = generator(seed)
    if not -np.pi / 2 <= elevations[0] <= elevations[1] <= np.pi / 2:
        raise OptionError(f"elevations must run upwards within -pi/2..pi/2; got {elevations[0]:g}..{elevations[1]:g}.")
    low, high = np.sin(elevations[0]), np.sin(elevations[1])
    elevation = np.arcsin(np.clip(rng.uniform(low, high, _positive(n_views, "n_views")), -1, 1))
    return Views(rng.uniform(0, 2 * np.pi, n_views), elevation, np.asarray(distance))


def random_so3(n_views: int, distance: float = PAPER_DISTANCE, seed: Seed = 0) -> Views:
    """Return `n_views` poses uniform over all rotations: positions uniform over the sphere, each with a uniform roll.

    References
    ----------
    PCN (Yuan et al. 2018) draws its camera poses so, for each object anew.

    Examples
    --------
    >>> zo.views.random_so3(3, seed=1).poses.shape
    (3, 4, 4)
    """
    rng = generator(seed)
    elevation = np.arcsin(rng.uniform(-1, 1, _positive(n_views, "n_views")))
    azimuth, roll = rng.uniform(0, 2 * np.pi, (2, n_views))
    return Views(azimuth, elevation, np.asarray(distance), roll=roll)


def _product(elevations: FloatArray, n_azimuths: int, distance: float) -> Views:
    azimuths = np.arange(_positive(n_azimuths, "n_azimuths")) * (2 * np.pi / n_azimuths)
    _positive(len(elevations) * n_azimuths, "the number of views")
    return Views(np.tile(azimuths, len(elevations)), np.repeat(elevations, n_azimuths), np.asarray(distance))


def _positive(count: int, name: str) -> int:
    check_int(name, count, 1)
    if count > MAX_VIEWS:
        raise OptionError(f"{name} must be at most {MAX_VIEWS:,}; got {count}.")
    return int(count)
