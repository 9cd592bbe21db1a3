"""A sensor: where its rays go, and everything that it gets wrong, as plain numbers with their sources.

Rays are in the sensor's own frame: x forward, y to the left, z up. Each kind of sensor lays them out by a function.
"""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.arrays import FloatArray, IntArray, as_indices, as_vectors, readonly_copy, set_readonly
from zbuf_occlude.documents import Number, parse_bool, parse_line
from zbuf_occlude.errors import ArgumentError, OptionError, check_choice

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
    """Rays of a sensor. Immutable.

    Parameters
    ----------
    directions : (n, 3) float
        Sensor frame (x forward, y left, z up), of any length but 0; stored with length 1.
    rings : (n,) int
        Laser, 0 the lowest; of a camera the row of the picture, 0 the uppermost.
    columns : (n,) int
        Firing, counted along the turn; of a camera the column of the picture, 0 the leftmost.
    origins : (n, 3) float, optional
        Where each begins, sensor frame; at the sensor's origin by default.
    times : (n,) float, optional
        When each is cast, seconds from the beginning of the turn or picture; all at once by default.
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
            raise ArgumentError(f"directions must have a length; row {int(lengths.argmin())} is zero. Leave it out.")
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
        """Metres from the sensor's origin to the farthest place where a ray begins."""
        return 0.0 if self.origins is None else float(np.linalg.norm(self.origins, axis=1).max(initial=0.0))

    def select(self, which: ArrayLike) -> "Rays":
        """Return the rays that a boolean mask or an index array picks, in its order."""
        chosen = np.asarray(which)
        origins, times = (None if each is None else each[chosen] for each in (self.origins, self.times))
        return Rays(self.directions[chosen], self.rings[chosen], self.columns[chosen], origins, times)

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
    fy: float | None = None,
    cx: float | None = None,
    cy: float | None = None,
    readout: float = 0.0,
) -> Rays:
    """Return the rays of a camera without distortion, through its pixels' centres, row by row.

    `fov` is horizontal, degrees; or `f` is the focal length, pixels, and `fy` that of the rows, by default the same.
    `cx` and `cy` are where the axis meets the picture, pixels from its upper left corner; its middle by default.
    """
    _not_too_many(width * height)
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
    """Return the rays of a LiDAR that turns about its z axis, firing by firing, `columns` of them per turn.

    Each of `lasers` has an elevation and an azimuth offset, the lowest first; all in degrees. `azimuths` are the first
    and the last firing's; of a whole turn, which ends where it begins, the last is one step before the second of them.
    `turns` is how many there are a second. `offsets` are metres that each laser sits above the sensor's origin, and to
    the left of it as seen along its ray; all are in the origin by default.
    """
    _not_too_many(columns * len(lasers))
    angles, (first, last) = np.radians(lasers), np.radians(azimuths)
    if not (np.abs(angles[:, 0]) <= np.pi / 2).all():
        raise OptionError("lasers must have elevations in [-90, 90] degrees; one has not.")
    is_whole = np.isclose(abs(last - first), 2.0 * np.pi)  # then the end is the beginning
    turn = first + np.arange(columns) * ((last - first) / max(columns if is_whole else columns - 1, 1))
    azimuth = (turn[:, None] + angles[:, 1]).ravel()
    elevation = np.tile(angles[:, 0], columns)
    flat = np.cos(elevation)
    directions = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=1)
    firings, rings = np.divmod(np.arange(columns * len(angles), dtype=np.int32), len(angles))
    if offsets is not None and len(offsets) != len(lasers):
        raise OptionError(f"offsets must be one per laser ({len(lasers)}); got {len(offsets)}. Give both, or neither.")
    origins = None if offsets is None else _beside(azimuth, np.tile(np.asarray(offsets, np.float64), (columns, 1)))
    return Rays(directions, rings, firings, origins, times=firings / (columns * turns))


def _beside(azimuths: FloatArray, offsets: FloatArray) -> FloatArray:
    """Return the places (n, 3) of lasers that look along `azimuths` (radians), by their offsets (n, 2): up and left."""
    up, left = offsets.T
    return np.stack([-left * np.sin(azimuths), left * np.cos(azimuths), up], axis=1)


def risley(*, frequencies: Sequence[float], wedge: float, index: float, rate: float, seconds: float) -> Rays:
    """Return the rays of a LiDAR whose one beam passes two turning wedge prisms, shot by shot; all of ring 0.

    The prisms turn `frequencies` times per second (opposite signs: opposite ways), have an angle of `wedge` degrees
    and an index of refraction, and their inclined faces face each other. `rate` is shots per second.
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
    return Rays(directions, np.zeros_like(shots), shots, times=shots / rate)


def linear(*, columns: int, spacing: float, rows: int, slopes: Sequence[float]) -> Rays:
    """Return the rays of a line scanner that moves along its y axis, column by column, from the left to the right.

    `spacing` is metres between two of its `columns`, the middle one at the sensor's origin. In each, `rows` rays fan
    out in the plane across, at `slopes` (z per x) that grow evenly from the first to the last. Ring 0 is the lowest.
    """
    _not_too_many(rows * columns)
    places = spacing * ((columns - 1) / 2.0 - np.arange(columns))
    up = np.linspace(slopes[0], slopes[1], rows)
    directions = np.stack([np.ones(rows), np.zeros(rows), up], axis=1)
    origins = np.zeros((columns, rows, 3))
    origins[..., 1] = places[:, None]
    firings, rings = np.divmod(np.arange(columns * rows, dtype=np.int32), rows)
    return Rays(np.tile(directions, (columns, 1)), rings, firings, origins.reshape(-1, 3))


def listed(*, directions: ArrayLike, rings: ArrayLike | None = None) -> Rays:
    """Return the rays of a list: directions (n, 3) in the sensor's frame, and rings (n,), 0 by default."""
    given = as_vectors(directions, "directions")
    numbers = np.arange(len(given), dtype=np.int32)
    return Rays(given, np.zeros_like(numbers) if rings is None else np.asarray(rings), numbers)


KINDS: dict[str, Callable[..., Rays]] = {
    "pinhole": pinhole,
    "spinning": spinning,
    "risley": risley,
    "linear": linear,
    "list": listed,
}
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


RETURNS = ("first", "strongest", "last", "all")
GRAZING_FROM = np.radians(60.0)
"""From this incidence on, `sigma_grazing` counts (Nguyen, Izadi, Lovell 2012, section 3)."""
STEEPEST = np.radians(89.9)
"""Noise is as at this incidence beyond it, where the formula has no bound."""

_METRES = Number(0.0, 1e4, "metres", least=1e-9)
NUMBERS: dict[str, Number] = {
    # of rays
    **dict.fromkeys(("width", "height", "columns", "rows"), Number(1, MOST_RAYS, whole=True)),
    "fov": Number(1e-3, 179.9, "degrees"),
    **dict.fromkeys(("f", "fy"), Number(1e-3, 1e9, "pixels")),
    **dict.fromkeys(("cx", "cy"), Number(-1e9, 1e9, "pixels")),
    "lasers": Number(-360.0, 360.0, "degrees", ((-1, 2),)),
    "azimuths": Number(-360.0, 360.0, "degrees", ((2,),)),
    "offsets": Number(-100.0, 100.0, "metres", ((-1, 2),)),
    "frequencies": Number(-1e6, 1e6, "turns a second", ((2,),)),
    "wedge": Number(1e-3, 90.0, "degrees"),
    "index": Number(1.0, 5.0),  # no glass bends light more: germanium, of infrared prisms, has 4
    "rate": Number(1e-3, 1e9, "shots a second"),
    "turns": Number(1e-3, 1e4, "a second"),
    "readout": Number(0.0, 1e3, "seconds", least=1e-9),
    "seconds": Number(1e-6, 1e6, "seconds"),
    "spacing": Number(1e-9, 1e4, "metres"),
    "slopes": Number(-1e3, 1e3, shapes=((2,),)),
    "directions": Number(shapes=((-1, 3),)),
    "rings": Number(0, 2**31 - 2, shapes=((-1,),), whole=True),
    # of imperfections
    **dict.fromkeys(("range_min", "sigma_from", "reach"), Number(0.0, 1e9, "metres")),
    "range_max": Number(0.0, np.inf, "metres"),
    "sigma": Number(0.0, 1e4, "metres", ((), (-1, 2))),
    **dict.fromkeys(("sigma_growth", "sigma_grazing", "step", "echo_separation"), _METRES),
    "disparity_step": Number(0.0, 1e4, "a metre", least=1e-9),
    "lateral": Number(0.0, 1e4, "pixels", ((), (2,))),
    "divergence": Number(0.0, 1.0, "radians"),
    **dict.fromkeys(("drop", "drop_zero", "edge_loss"), Number(0.0, 1.0)),
    **dict.fromkeys(("attenuation", "drop_limit", "noise"), Number(0.0, 1e3, least=1e-9)),
    **dict.fromkeys(("incidence_max", "baseline_incidence_max"), Number(0.0, 90.0, "degrees")),
    "baseline": Number(-1e9, 1e9, "metres", ((), (3,), (-1, 3))),
    "window": Number(0, 99, "pixels", whole=True),
}
"""What each number of a sensor may be; beyond it, it is a mistyped one."""


def _number(name: str, value: Any) -> Any:
    if name == "lasers" and isinstance(value, (list, tuple, np.ndarray)):  # elevations alone have no offset
        value = [each if isinstance(each, (list, tuple, np.ndarray)) else (each, 0.0) for each in value]
    return NUMBERS[name].read(f"{name} of a sensor", value)


@dataclass(frozen=True)
class NoiseModel:
    """What a sensor gets wrong. The defaults are those of a sensor without fault; lengths in metres.

    Parameters
    ----------
    range_min, range_max : float
        Nearer and farther it measures nothing; of an `axial` sensor the depth.
    axial : bool
        Range, noise and quantisation are of the depth along the x axis, as depth cameras have it.
    sigma : float or sequence of (range, sigma)
        Standard deviation of the range, or its values at some ranges, between which it is interpolated.
    sigma_growth, sigma_from : float
        Adds ``sigma_growth (range - sigma_from)^2``.
    sigma_grazing : float
        Adds ``sigma_grazing / sqrt(range) incidence^2 / (pi/2 - incidence)^2`` from 60 degrees of incidence on.
    step : float
        Ranges are multiples of it.
    disparity_step : float
        Inverse depths are multiples of it, 1 / metre.
    lateral : float or (float, float)
        Standard deviation across the ray, pixels; of two numbers (a, b) it is ``a + b incidence / (pi/2 - incidence)``.
    divergence : float
        Full angle of a beam, radians. A beam is then five rays.
    echo_separation : float
        Surfaces within one beam nearer to each other than this give one return, at a range between them.
    returns : str
        Which return is kept: "first", "strongest" (the greatest share of the beam over range squared), "last", or
        "all".
    drop : float
        Share of the returns that is lost anyway.
    attenuation, drop_limit, drop_zero : float
        Of the rest a signal ``albedo cos(incidence) exp(-attenuation range)`` of 0 is lost with probability
        `drop_zero`, one of `drop_limit` and more never, between linearly. So CARLA has it; the table's sensors have a
        `reach` instead.
    reach : float
        Where a white surface met at right angles returns one pulse in e, metres; dark, steep and far ones fewer
        (`scanning.detection`). 0: no return fades.
    edge_loss : float
        Share of the pixels lost that have a neighbour more than 5 % nearer or farther (a picture's edges).
    incidence_max : float
        Steeper ones return nothing, degrees.
    baseline : (3,) or (m, 3) float
        From where a ray begins to the sensor's second eye (the projector, laser or other camera of triangulation), in
        its frame. A return needs both eyes to see the point, from the same side of its face, and of a pinhole to have
        it in their pictures. Of several second eyes one is enough. 0: there is none.
    baseline_incidence_max : float
        Steeper ones at the second eye return nothing, degrees.
    window : int
        Of a pinhole with a second eye: pixels across of the square that is matched. What lies behind an edge returns
        nothing where half a window, rounded down, reaches what is nearer, or is seen by one eye alone.
    noise : float
        Factor on the standard deviations. 0 switches everything off but the limits of range and the second eye.
    """

    range_min: float = 0.0
    range_max: float = np.inf
    axial: bool = False
    sigma: float | Sequence[Sequence[float]] = 0.0
    sigma_growth: float = 0.0
    sigma_from: float = 0.0
    sigma_grazing: float = 0.0
    step: float = 0.0
    disparity_step: float = 0.0
    lateral: float | Sequence[float] = 0.0
    divergence: float = 0.0
    echo_separation: float = 1.0
    returns: str = "strongest"
    drop: float = 0.0
    attenuation: float = 0.0
    drop_limit: float = 0.0
    drop_zero: float = 0.0
    reach: float = 0.0
    edge_loss: float = 0.0
    incidence_max: float = 90.0
    baseline: float | Sequence[float] | Sequence[Sequence[float]] = 0.0
    baseline_incidence_max: float = 90.0
    window: int = 0
    noise: float = 1.0

    def __post_init__(self) -> None:
        check_choice("returns", self.returns, RETURNS)
        object.__setattr__(self, "axial", parse_bool("axial of a sensor", self.axial))
        for name in filter(NUMBERS.get, vars(self)):
            object.__setattr__(self, name, _number(name, getattr(self, name)))
        if not self.range_min < self.range_max:
            raise OptionError(f"range_min must be less than range_max; got {self.range_min} and {self.range_max}.")
        if np.ndim(self.baseline) == 0 and self.baseline != 0.0:
            raise OptionError(f"baseline of a sensor must be a vector of metres, or 0; got {self.baseline}.")
        ranges = np.array(self.sigma)[..., 0] if np.ndim(self.sigma) else ()
        if not (np.diff(ranges) > 0.0).all():
            raise OptionError(f"sigma of a sensor must have growing ranges; got {', '.join(map(str, ranges)):.200}.")

    @property
    def second_eyes(self) -> FloatArray:
        """The baselines, (m, 3); none where there is no second eye."""
        rows = np.asarray(self.baseline if np.ndim(self.baseline) else [], dtype=np.float64).reshape(-1, 3)
        return rows[rows.any(axis=1)]

    def range_sigma(self, ranges: ArrayLike, incidence: ArrayLike = 0.0) -> FloatArray:
        """Return the standard deviation at some ranges (of an axial sensor: depths) and incidences (radians)."""
        ranges = np.asarray(ranges, dtype=np.float64)
        table = np.asarray(self.sigma, dtype=np.float64)
        sigma = table if table.ndim == 0 else np.interp(ranges, table[:, 0], table[:, 1])
        sigma = sigma + self.sigma_growth * (ranges - self.sigma_from) ** 2
        if self.sigma_grazing:
            angle = np.minimum(incidence, STEEPEST)
            grazing = self.sigma_grazing / np.sqrt(np.maximum(ranges, 1e-9)) * (angle / (np.pi / 2 - angle)) ** 2
            sigma = sigma + np.where(angle >= GRAZING_FROM, grazing, 0.0)
        return np.asarray(self.noise * sigma)


@dataclass(frozen=True, eq=False)
class Sensor:
    """A sensor: a name, a kind, the numbers of its rays, what it gets wrong, and where each number is from.

    Parameters
    ----------
    name, summary : str
    kind : str
        One of `KINDS`.
    pattern : mapping
        The numbers of that kind.
    imperfections : NoiseModel
    sources : mapping of a number's name to words

    Raises
    ------
    OptionError
        An unknown kind, or numbers that the kind does not take or lacks.
    """

    name: str
    kind: str
    pattern: Mapping[str, Any]
    imperfections: NoiseModel = field(default_factory=NoiseModel)
    summary: str = ""
    sources: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        parse_line("a sensor's name", self.name)
        check_choice("kind", self.kind, KINDS)
        known = numbers_of(self.kind)
        pattern = {name: value for name, value in self.pattern.items() if value is not None}
        for name in pattern:
            check_choice(f"a number of the kind {self.kind}", name, known)
        object.__setattr__(self, "pattern", {name: _number(name, value) for name, value in pattern.items()})
        needed = [name for name, default in known.items() if default is inspect.Parameter.empty]
        if missing := [name for name in needed if name not in self.pattern]:
            raise OptionError(f"sensor {self.name!r} of kind {self.kind} must have {', '.join(missing)}; it has not.")

    def __repr__(self) -> str:
        return f"Sensor({self.name!r}, {self.kind}{': ' if self.summary else ''}{self.summary})"

    def rays(self) -> Rays:
        """Return its rays, of one turn or picture, in its own frame; the same object each time."""
        return self._rays

    @property
    def is_camera(self) -> bool:
        """Whether it is held before its target, as a picture is taken; a LiDAR is mounted on something."""
        return self.kind in ("pinhole", "linear")

    @property
    def untimed(self) -> str:
        """What to say where all rays are cast at once, so that motion changes nothing; else empty."""
        if self.rays().times is not None:
            return ""
        cure = "give --set-sensor readout=SECONDS" if self.kind == "pinhole" else "take another sensor"
        return f"{self.name} casts all rays at once; {cure}."

    @cached_property
    def _rays(self) -> Rays:
        return KINDS[self.kind](**self.pattern)

    @cached_property
    def intrinsics(self) -> FloatArray:
        """K (3, 3) of a pinhole, pixels, the corner of the upper left pixel at (0, 0)."""
        given, (width, height) = self.pattern, (self.pattern["width"], self.pattern["height"])
        f = given.get("f") or width / 2.0 / np.tan(np.radians(given["fov"]) / 2.0)
        centre = given.get("cx", width / 2.0), given.get("cy", height / 2.0)
        return np.array([[f, 0.0, centre[0]], [0.0, given.get("fy", f), centre[1]], [0.0, 0.0, 1.0]])

    @property
    def pixels(self) -> float:
        """Pixels per unit of the picture at depth 1, of a pinhole; 0 of others."""
        return float(self.intrinsics[0, 0]) if self.kind == "pinhole" else 0.0

    def starts_towards(self, places: FloatArray) -> FloatArray:
        """Return where the rays to some places (n, 3) begin, all in its frame.

        Of a linear sensor it is beside each place; of lasers with offsets it is the one whose rays pass nearest to it.
        """
        if "offsets" not in self.pattern:
            return np.asarray(places * [0.0, 1.0, 0.0] if self.kind == "linear" else np.zeros_like(places))
        nearest, least = np.zeros(len(places), dtype=np.intp), np.full(len(places), np.inf)
        for number, above in enumerate(self.above_lasers(places)):
            nearest[np.abs(above) < least] = number
            least = np.minimum(np.abs(above), least)
        offsets = np.asarray(self.pattern["offsets"])[nearest]
        return _beside(np.arctan2(places[:, 1], places[:, 0]), offsets)

    def above_lasers(self, places: FloatArray) -> Iterator[FloatArray]:
        """Yield for each laser the degrees (n,) that places (n, 3) in its frame lie above its rays, as it sees them."""
        lasers, level = self.pattern["lasers"], np.hypot(places[:, 0], places[:, 1])
        offsets = self.pattern.get("offsets", [(0.0, 0.0)] * len(lasers))
        for (elevation, _), (up, _) in zip(lasers, offsets, strict=True):
            yield np.degrees(np.arctan2(places[:, 2] - up, level)) - elevation

    def covers(self, places: FloatArray) -> NDArray[np.bool_]:
        """Whether places (n, 3) in its frame are in its field of view, (n,); of a list of directions all are."""
        given, ahead = self.pattern, places[:, 0] > 0.0
        depth = np.where(ahead, np.maximum(places[:, 0], 1e-9 * np.abs(places).max(axis=1, initial=0.0)), 1.0)
        if self.kind == "pinhole":
            (fx, _, cx), (_, fy, cy) = self.intrinsics[:2]
            column, row = cx - fx * places[:, 1] / depth, cy - fy * places[:, 2] / depth
            within = (column >= 0) & (column < given["width"]) & (row >= 0) & (row < given["height"])
            return np.asarray(ahead & within)
        if self.kind == "linear":
            slope, (low, high) = places[:, 2] / depth, sorted(given["slopes"])
            beside = np.abs(places[:, 1]) <= given["columns"] * given["spacing"] / 2.0
            return np.asarray(ahead & beside & (slope >= low) & (slope <= high))
        if self.kind == "spinning":
            least, most = np.full((2, len(places)), [[np.inf], [-np.inf]])
            for above in self.above_lasers(places):
                least, most = np.minimum(least, above), np.maximum(most, above)
            return np.asarray((least <= 0.0) & (most >= 0.0))
        return np.ones(len(places), dtype=bool)

    def with_numbers(self, /, **numbers: Any) -> "Sensor":
        """Return the sensor with some numbers changed, of the rays or the imperfections.

        Raises
        ------
        OptionError
            A number that it does not have, or a value out of range.
        """
        pattern = dict(self.pattern)
        faults = dict(vars(self.imperfections))
        sources = dict(self.sources)
        known = {**dict.fromkeys(numbers_of(self.kind)), **dict.fromkeys(faults)}
        for name, value in numbers.items():
            check_choice(f"a number of the sensor {self.name}", name, known)
            (faults if name in faults else pattern)[name] = value
            sources[name] = "given by the user"
        if numbers.get("fov") is not None and numbers.get("f") is not None:
            raise OptionError("a pinhole must be given fov or f, and not both.")
        for one, other in (("fov", "f"), ("f", "fov")):
            if numbers.get(one) is not None:
                pattern.pop(other, None)
        return Sensor(self.name, self.kind, pattern, NoiseModel(**faults), self.summary, sources)

    def numbers(self) -> dict[str, Any]:
        """Return all its numbers by name: of its rays, and of the imperfections those that it has."""
        known = vars(self.imperfections).items()
        faults = {k: v for k, v in known if v != getattr(NoiseModel, k) or k in self.sources}
        return {**self.pattern, **faults}

    def to_dict(self) -> dict[str, Any]:
        """Plain data, for a plan: name, kind and all numbers that are not usual."""
        faults = {k: v for k, v in vars(self.imperfections).items() if v != getattr(NoiseModel, k)}
        return {"name": self.name, "kind": self.kind, "pattern": dict(self.pattern), "imperfections": faults}

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "Sensor":
        """Return the sensor whose `document` this is."""
        faults = NoiseModel(**document["imperfections"])
        return cls(document["name"], document["kind"], document["pattern"], faults)
