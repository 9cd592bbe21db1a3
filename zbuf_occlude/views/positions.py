"""Sets of camera positions: the paper's (Eq. 11-12, section 4.3) and common others; and their specifications as text.

To add a specification: a row in `SPECIFICATIONS`, with its function here or in `cameras.py`.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.base.arrays import FloatArray, as_number
from zbuf_occlude.base.errors import OptionError, check_int, did_you_mean, shown
from zbuf_occlude.base.provenance import generator
from zbuf_occlude.meshes.conversion import MeshLike, as_mesh
from zbuf_occlude.views import cameras
from zbuf_occlude.views.model import PAPER_DISTANCE, Views, as_distance

MAX_VIEWS = 1_000_000
"""Maximum number of views: a mistyped specification must not fill the memory."""
HALF_WITHIN = 15.0
"""Angle to the axis of road users, degrees, within which a car's sensor sees half of them (`drive`)."""

Seed = int | np.random.SeedSequence | np.random.Generator


def from_angles(azimuth: float, elevation: float, distance: float = PAPER_DISTANCE, roll: float = 0.0) -> Views:
    """Return one view about the origin from angles in degrees.

    Parameters
    ----------
    azimuth : float
        Degrees from +x towards +y.
    elevation : float
        Degrees above the xy plane, within -90..90; 90 is +z.
    distance : float
        Any unit; `Views.around` converts multiples of a mesh's longest side to its units.
    roll : float
        Degrees; positive turns the camera's top towards its right.

    Raises
    ------
    ArgumentError
        A value is not finite or out of range.

    Examples
    --------
    >>> zo.views.from_angles(azimuth=90, elevation=0, distance=2).eyes.round(6).tolist()
    [[0.0, 2.0, 0.0]]
    """
    radians = np.radians(
        [
            as_number(azimuth, "azimuth", "a number, degrees"),
            as_number(elevation, "elevation", "a number in [-90, 90], degrees", lambda number: abs(number) <= 90.0),
            as_number(roll, "roll", "a number, degrees"),
        ]
    )
    return Views(radians[:1], radians[1:2], np.array([as_distance(distance)]), roll=radians[2:])


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
    return _product(np.radians([-80.0, -40.0, 0.0, 40.0, 80.0]), 5, None, distance)


def ring(
    n_views: int,
    *,
    elevation: float | tuple[float, float],
    azimuth: tuple[float, float] | None = None,
    distance: float = PAPER_DISTANCE,
    seed: Seed = 0,
) -> Views:
    """Return views at `n_views` equally spaced azimuths, and one elevation or elevations drawn between two, degrees.

    Azimuths go all round, or from one to another, ends included. Drawn elevations are uniform over the sphere.

    Examples
    --------
    >>> np.degrees(zo.views.ring(4, elevation=20).azimuth).tolist()
    [0.0, 90.0, 180.0, 270.0]
    >>> np.degrees(zo.views.ring(3, elevation=0, azimuth=(-30, 30)).azimuth).round(6).tolist()
    [-30.0, 0.0, 30.0]
    """
    if not isinstance(elevation, Sequence):
        return _product(np.asarray(_band((elevation, elevation))[:1]), n_views, azimuth, distance)
    azimuths = _spaced(n_views, azimuth)
    return Views(
        azimuths, _drawn_elevations(len(azimuths), elevation, generator(seed)), np.asarray(as_distance(distance))
    )


def grid(
    n_elevations: int,
    n_azimuths: int,
    *,
    elevation: tuple[float, float] = (-90.0, 90.0),
    azimuth: tuple[float, float] | None = None,
    distance: float = PAPER_DISTANCE,
) -> Views:
    """Return views at equally spaced elevations between two, degrees, ends included, and equally spaced azimuths.

    Azimuths go all round, or from one to another, ends included. Section 4.3 suggests ``elevation=(0, 50)`` for
    automated driving.

    Examples
    --------
    >>> len(zo.views.grid(3, 4))
    12
    """
    _positive(n_elevations, "n_elevations")
    low, high = _band(elevation)
    levels = np.linspace(low, high, n_elevations) if n_elevations > 1 else np.asarray([(low + high) / 2])
    return _product(levels, n_azimuths, azimuth, distance)


def fibonacci(
    n_views: int, distance: float = PAPER_DISTANCE, *, elevation: tuple[float, float] = (-90.0, 90.0)
) -> Views:
    """Return `n_views` positions spread evenly over the sphere on a Fibonacci (golden angle) spiral.

    Between two elevations, degrees, they are spread evenly over that band, the uppermost first.

    Examples
    --------
    >>> zo.views.fibonacci(50, distance=2.0)
    Views(50 views about (0, 0, 0))
    """
    index = np.arange(_positive(n_views, "n_views"))
    low, high = np.sin(_band(elevation))
    elevations = np.arcsin(high - (high - low) / 2.0 * ((2.0 * index + 1.0) / n_views))
    azimuth = (index * np.pi * (3.0 - np.sqrt(5.0))) % (2 * np.pi)
    return Views(azimuth, elevations, np.asarray(as_distance(distance)))


def random(
    n_views: int,
    *,
    elevation: tuple[float, float] = (-90.0, 90.0),
    azimuth: tuple[float, float] | None = None,
    distance: float = PAPER_DISTANCE,
    seed: Seed = 0,
) -> Views:
    """Return `n_views` positions distributed uniformly over the sphere between two elevations and azimuths, degrees.

    Azimuths are all round by default.

    Examples
    --------
    >>> bool((zo.views.random(9, elevation=(0, 30), seed=1).elevation >= 0).all())
    True
    """
    rng = generator(seed)
    elevations = _drawn_elevations(_positive(n_views, "n_views"), elevation, rng)
    return Views(rng.uniform(*_sector(azimuth), n_views), elevations, np.asarray(as_distance(distance)))


def drive(
    n_views: int,
    *,
    half_within: float = HALF_WITHIN,
    elevation: tuple[float, float] = (0.0, 0.0),
    distance: float = PAPER_DISTANCE,
    seed: Seed = 0,
) -> Views:
    """Return `n_views` views of a road user from the azimuths from which cars see others in traffic.

    Parameters
    ----------
    n_views : int
    half_within : float
        Degrees to the road user's axis, above 0 and below 90. Half of the views are within it: behind or before.
    elevation : (float, float)
        Degrees; drawn uniformly over the sphere between both.
    distance : float
    seed : int, SeedSequence or Generator

    Notes
    -----
    The front of a road user is towards -y, as of the built-in shapes. The azimuth from its front is
    t = atan2(tan(half_within) sin(u), cos(u)) for u uniform in [0, 2 pi). Its angle d to the axis, 0 to 90 degrees, has
    the distribution function F(d) = 2 / pi atan(tan(d) / tan(half_within)); front and rear, left and right are equally
    likely. This is the angular central Gaussian law (Tyler 1987, Biometrika 74, doi:10.1093/biomet/74.3.579): the
    direction of a normal distribution around the road user, narrower across its axis by tan(half_within).

    ``benchmarks/drive_headings.py`` compares it with labelled drives.

    Examples
    --------
    >>> len(zo.views.drive(8, seed=1))
    8
    """
    narrow = np.tan(np.radians(as_number(half_within, "half_within", "degrees in (0, 90)", lambda x: 0.0 < x < 90.0)))
    rng = generator(seed)
    elevations = _drawn_elevations(_positive(n_views, "n_views"), elevation, rng)
    turn = rng.uniform(0.0, 2.0 * np.pi, n_views)
    from_front = np.arctan2(narrow * np.sin(turn), np.cos(turn))
    return Views(np.remainder(from_front - np.pi / 2.0, 2.0 * np.pi), elevations, np.asarray(as_distance(distance)))


def random_so3(n_views: int, distance: float = PAPER_DISTANCE, seed: Seed = 0) -> Views:
    """Return `n_views` poses distributed uniformly over all rotations: uniform positions, each with a uniform roll.

    References
    ----------
    PCN (Yuan et al. 2018) draws its camera poses in this way, separately for each object.

    Examples
    --------
    >>> zo.views.random_so3(3, seed=1).poses.shape
    (3, 4, 4)
    """
    rng = generator(seed)
    elevation = np.arcsin(rng.uniform(-1, 1, _positive(n_views, "n_views")))
    azimuth, roll = rng.uniform(0, 2 * np.pi, (2, n_views))
    return Views(azimuth, elevation, np.asarray(as_distance(distance)), roll=roll)


def _product(elevations: FloatArray, n_azimuths: int, azimuth: tuple[float, float] | None, distance: float) -> Views:
    azimuths = _spaced(n_azimuths, azimuth)
    _positive(len(elevations) * n_azimuths, "the number of views")
    away = np.asarray(as_distance(distance))
    return Views(np.tile(azimuths, len(elevations)), np.repeat(elevations, n_azimuths), away)


def _spaced(n_azimuths: int, azimuth: tuple[float, float] | None) -> FloatArray:
    """Return equally spaced azimuths, radians: all round, or between two in degrees."""
    low, high = _sector(azimuth)
    if high - low >= 2 * np.pi:
        return np.asarray(low + np.arange(_positive(n_azimuths, "n_azimuths")) * (2 * np.pi / n_azimuths), np.float64)
    spaced = np.linspace(low, high, _positive(n_azimuths, "n_azimuths"), dtype=np.float64)
    return np.asarray(spaced if n_azimuths > 1 else [(low + high) / 2], np.float64)


def _drawn_elevations(n: int, elevation: tuple[float, float], rng: np.random.Generator) -> FloatArray:
    """Return elevations uniform over the sphere between two, degrees."""
    low, high = np.sin(_band(elevation))
    return np.asarray(np.arcsin(np.clip(rng.uniform(low, high, n), -1, 1)))


def _positive(count: int, name: str) -> int:
    check_int(name, count, 1)
    if count > MAX_VIEWS:
        raise OptionError(f"{name} must be at most {MAX_VIEWS:,}; got {count}.")
    return int(count)


_NUMBER = r"([-+]?\d+(?:\.\d*)?)"
_RANGE = rf"(?:@{_NUMBER}\.\.{_NUMBER})?"
_SECTOR = rf"(?:,az={_NUMBER}\.\.{_NUMBER})?"
_COUNT = r"(\d{1,18})"
"""Pattern of a count: more digits would not fit an int64."""

Make = Callable[[Sequence[Any], float, Seed], Views]


@dataclass(frozen=True)
class Specification:
    """One row of the table of view specifications.

    Parameters
    ----------
    form : str
        Text of the form for messages and help.
    pattern : str
        Regular expression of the whole specification.
    make : callable
        Returns the views for the groups of the pattern, a distance in longest sides, and a seed.
    is_random : bool
        True where the views are random; a dataset draws them separately for each object.
    """

    form: str
    pattern: str
    make: Make
    is_random: bool = False


def _ring(found: Sequence[Any], distance: float, seed: Seed) -> Views:
    count, elevation, *sector = found
    return ring(int(count), elevation=float(elevation), azimuth=_numbers(sector, None), distance=distance)


def _random_ring(found: Sequence[Any], distance: float, seed: Seed) -> Views:
    low, high, sector = float(found[1]), float(found[2]), _numbers(found[3:], None)
    return ring(int(found[0]), elevation=(low, high), azimuth=sector, distance=distance, seed=seed)


def _grid(found: Sequence[Any], distance: float, seed: Seed) -> Views:
    counts, band, sector = map(int, found[:2]), _numbers(found[2:4], (-90.0, 90.0)), _numbers(found[4:], None)
    return grid(*counts, elevation=band, azimuth=sector, distance=distance)


def _fibonacci(found: Sequence[Any], distance: float, seed: Seed) -> Views:
    return fibonacci(int(found[0]), distance, elevation=_numbers(found[1:], (-90.0, 90.0)))


def _random(found: Sequence[Any], distance: float, seed: Seed) -> Views:
    band, sector = _numbers(found[1:3], (-90.0, 90.0)), _numbers(found[3:], None)
    return random(int(found[0]), elevation=band, azimuth=sector, distance=distance, seed=seed)


def _drive(found: Sequence[Any], distance: float, seed: Seed) -> Views:
    return drive(int(found[0]), elevation=_numbers(found[1:], (0.0, 0.0)), distance=distance, seed=seed)


SPECIFICATIONS: tuple[Specification, ...] = (
    Specification("paper100", "paper100", lambda found, distance, seed: paper100(distance)),
    Specification("modelnet8", "modelnet8", lambda found, distance, seed: modelnet8(distance)),
    Specification("ring:N@EL[,az=AZ0..AZ1]", rf"ring:{_COUNT}@{_NUMBER}{_SECTOR}", _ring),
    Specification(
        "ring:N@EL0..EL1[,az=AZ0..AZ1]",
        rf"ring:{_COUNT}@{_NUMBER}\.\.{_NUMBER}{_SECTOR}",
        _random_ring,
        is_random=True,
    ),
    Specification("grid:ELxAZ[@EL0..EL1][,az=AZ0..AZ1]", rf"grid:{_COUNT}x{_COUNT}{_RANGE}{_SECTOR}", _grid),
    Specification("fibonacci:N[@EL0..EL1]", rf"fibonacci:{_COUNT}{_RANGE}", _fibonacci),
    Specification("random:N[@EL0..EL1][,az=AZ0..AZ1]", rf"random:{_COUNT}{_RANGE}{_SECTOR}", _random, is_random=True),
    Specification(
        "random-so3:N",
        rf"random-so3:{_COUNT}",
        lambda found, distance, seed: random_so3(int(found[0]), distance, seed),
        is_random=True,
    ),
    Specification("drive:N[@EL0..EL1]", rf"drive:{_COUNT}{_RANGE}", _drive, is_random=True),
    Specification(
        "a CSV of views or cameras",
        r"(.+\.(?i:csv))",
        lambda found, distance, seed: cameras.from_csv(found[0], distance),
    ),
    Specification(
        "cameras as JSON (K, R, t, or transforms.json)",
        r"(.+\.(?i:jsonl?))",
        lambda found, distance, seed: cameras.from_json(Path(found[0])),
    ),
    Specification(
        "COLMAP's images.txt or images.bin",
        r"(.*images\.(?:txt|bin))",
        lambda found, distance, seed: cameras.from_colmap(Path(found[0])),
    ),
)


def forms() -> str:
    """Return the list of all specifications, as part of a sentence.

    Examples
    --------
    >>> zo.views.forms().startswith("paper100, modelnet8, ring:N@EL")
    True
    """
    *most, last = (row.form for row in SPECIFICATIONS)
    return f"{', '.join(most)}, or {last}"


def parse(spec: str, *, distance: float = PAPER_DISTANCE, seed: Seed = 0, farthest: float | None = None) -> Views:
    """Return the views of a specification: angles in degrees, distances in longest sides.

    Parameters
    ----------
    spec : str
        One of `forms`.
    distance : float
        Distance, unless a file has its own.
    seed : int, SeedSequence or Generator
        Seed of random views and distances.
    farthest : float, optional
        Distances are drawn uniformly from `distance` to this one, unless a file has its own.

    Raises
    ------
    OptionError
        An unknown specification; the message lists all.

    Examples
    --------
    >>> zo.views.parse("grid:3x4@0..50")
    Views(12 views about (0, 0, 0))
    """
    row, found = _find(spec)
    generator(seed)  # for its error, also where nothing is drawn
    distance = as_distance(distance)
    views = row.make(found, distance, seed)
    if farthest is None or views.rotations is not None:
        return views
    farthest = as_distance(farthest)
    if not farthest > distance:
        raise OptionError(f"distances must run upwards; got {distance:g}..{farthest:g}.")
    rng = seed
    if not isinstance(rng, np.random.Generator):  # other draws than those of the positions
        root = rng if isinstance(rng, np.random.SeedSequence) else np.random.SeedSequence(rng)
        rng = np.random.default_rng(root.spawn(1)[0])
    lengths = rng.uniform(distance, farthest, len(views))
    own = views.distance == row.make(found, farthest, seed).distance  # distances of a file
    lengths = np.where(own, views.distance, lengths)
    return replace(views, distance=lengths)


def for_mesh(
    mesh: MeshLike,
    spec: str | Views,
    *,
    distance: float = PAPER_DISTANCE,
    seed: Seed = 0,
    farthest: float | None = None,
) -> Views:
    """Return views about the centre of a mesh, in its units.

    Parameters
    ----------
    mesh : Mesh
        Or anything else that is a mesh (`as_mesh`).
    spec : str or Views
        A specification as of `parse`; or views about the origin, distances in longest sides.
    distance, seed, farthest
        As in `parse`; distances in multiples of the mesh's longest side.

    Raises
    ------
    OptionError
        As `parse`.

    Examples
    --------
    >>> mesh = zo.load_mesh("chair.off")
    >>> views = zo.views.for_mesh(mesh, "ring:8@20")
    >>> len(views), bool(mesh.in_box(views.eyes).any())
    (8, False)
    """
    mesh = as_mesh(mesh)
    views = spec if isinstance(spec, Views) else parse(spec, distance=distance, seed=seed, farthest=farthest)
    return views.around(mesh.centre, mesh.longest_side)


def is_random(spec: str) -> bool:
    """Return whether a specification gives random views.

    Examples
    --------
    >>> zo.views.is_random("random:5"), zo.views.is_random("paper100")
    (True, False)
    """
    return _find(spec)[0].is_random


def _find(spec: str) -> tuple[Specification, Sequence[Any]]:
    for row in SPECIFICATIONS if isinstance(spec, str) else ():
        if match := re.fullmatch(row.pattern, spec):
            return row, match.groups()
    raise OptionError(f"views must be {forms()}; got {shown(spec)}.{_wrong_part(spec)}")


def _wrong_part(spec: str) -> str:
    """Return a sentence on the part of a specification that is not understood."""
    if not isinstance(spec, str):
        return ""
    word, _, rest = spec.partition(":")
    if re.search(r"[/.\\]|^$", word):
        return ""
    words = {row.form.partition(":")[0] for row in SPECIFICATIONS if " " not in row.form}
    if word not in words:
        return f" There is no {word!r:.40}.{did_you_mean(word, sorted(words))}"
    endings = [row.form.partition(":")[2] for row in SPECIFICATIONS if row.form.partition(":")[0] == word]
    if not any(endings):
        return f" {word} takes nothing after it."
    return f" After {word}: must come {' or '.join(endings)}; got {rest!r:.40}."


def _numbers(found: Sequence[str | None], missing: Any) -> Any:
    """Return two numbers of a specification, or `missing` where it has none."""
    low, high = found
    return missing if low is None or high is None else (float(low), float(high))


def _band(elevation: tuple[float, float]) -> tuple[float, float]:
    """Return two elevations in degrees as radians."""
    try:
        low, high = (as_number(each, "elevation", "a number") for each in elevation)
    except (TypeError, ValueError):
        raise OptionError(f"elevation must be numbers of degrees; got {shown(elevation)}.") from None
    if not -90.0 <= low <= high <= 90.0:
        raise OptionError(f"elevations must run upwards within -90..90 degrees; got {low:g}..{high:g}.")
    return np.radians(low), np.radians(high)


def _sector(azimuth: tuple[float, float] | None) -> tuple[float, float]:
    """Return two azimuths in degrees as radians; all round for None."""
    if azimuth is None:
        return 0.0, 2.0 * np.pi
    try:
        low, high = (as_number(each, "azimuth", "a number") for each in azimuth)
    except (TypeError, ValueError):
        raise OptionError(f"azimuth must be two numbers of degrees; got {shown(azimuth)}.") from None
    if not -360.0 <= low <= high <= min(360.0, low + 360.0):
        raise OptionError(f"azimuths must run upwards by at most 360 degrees, within -360..360; got {low:g}..{high:g}.")
    return float(np.radians(low)), float(np.radians(high))
