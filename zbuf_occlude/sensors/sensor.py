"""A sensor: the pattern of its rays and the model of its noise, as plain numbers with their sources."""

import inspect
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.documents import Number, parse_bool, parse_line
from zbuf_occlude.base.errors import OptionError, check_choice
from zbuf_occlude.sensors.rays import MAX_RAYS, PATTERNS, Rays, beside_axis, numbers_of
from zbuf_occlude.views.model import Views

RETURNS = ("first", "strongest", "last", "all")
GRAZING_FROM = np.radians(60.0)
"""Incidence from which `sigma_grazing` applies, radians (Nguyen, Izadi, Lovell 2012, section 3)."""
STEEPEST = np.radians(89.9)
"""Incidence at which the noise formulas are clamped, radians: they have a pole at 90 degrees."""

_METRES = Number(0.0, 1e4, "metres", least=1e-9)
NUMBERS: dict[str, Number] = {
    # rays
    **dict.fromkeys(("width", "height", "columns", "rows"), Number(1, MAX_RAYS, whole=True)),
    "fov": Number(1e-3, 179.9, "degrees"),
    **dict.fromkeys(("f", "fy"), Number(1e-3, 1e9, "pixels")),
    **dict.fromkeys(("cx", "cy"), Number(-1e9, 1e9, "pixels")),
    "lasers": Number(-360.0, 360.0, "degrees", ((-1, 2),)),
    "azimuths": Number(-360.0, 360.0, "degrees", ((2,),)),
    "elevations": Number(-90.0, 90.0, "degrees", ((2,),)),
    "offsets": Number(-100.0, 100.0, "metres", ((-1, 2),)),
    "frequencies": Number(-1e6, 1e6, "turns a second", ((2,),)),
    "wedge": Number(1e-3, 90.0, "degrees"),
    "fan": Number(-45.0, 45.0, "degrees", ((-1,),)),
    "index": Number(1.0, 5.0),  # germanium's for infrared light, the highest of a prism, is 4
    "rate": Number(1e-3, 1e9, "shots a second"),
    "turns": Number(1e-3, 1e4, "a second"),
    "readout": Number(0.0, 1e3, "seconds", least=1e-9),
    "seconds": Number(1e-6, 1e6, "seconds"),
    "begin": Number(0.0, 1e6, "seconds"),
    "spacing": Number(1e-9, 1e4, "metres"),
    "slopes": Number(-1e3, 1e3, shapes=((2,),)),
    "directions": Number(shapes=((-1, 3),)),
    "rings": Number(0, 2**31 - 2, shapes=((-1,),), whole=True),
    # noise
    **dict.fromkeys(("range_min", "sigma_from", "detection_range"), Number(0.0, 1e9, "metres")),
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
    "match_window": Number(0, 99, "pixels", whole=True),
}
"""Accepted values of each number of a sensor."""


def _number(name: str, value: Any) -> Any:
    if name == "lasers" and isinstance(value, (list, tuple, np.ndarray)):  # without azimuth offsets they are 0
        value = [each if isinstance(each, (list, tuple, np.ndarray)) else (each, 0.0) for each in value]
    return NUMBERS[name].read(f"{name} of a sensor", value)


@dataclass(frozen=True)
class NoiseModel:
    """Limits, losses and noise of a sensor. By default there are none. Lengths are metres.

    Parameters
    ----------
    range_min, range_max : float
        Smallest and largest range that is measured; for an `axial` sensor, depth.
    axial : bool
        True where limits, noise and quantisation apply to the depth along the x axis, as in depth cameras.
    sigma : float or sequence of (range, sigma)
        Standard deviation of the range, or its values at some ranges, interpolated linearly.
    sigma_growth, sigma_from : float
        Adds ``sigma_growth (range - sigma_from)^2``.
    sigma_grazing : float
        Adds ``sigma_grazing / sqrt(range) incidence^2 / (pi/2 - incidence)^2`` from 60 degrees of incidence on.
    step : float
        Quantisation step of the range.
    disparity_step : float
        Quantisation step of the inverse depth, 1 / metre.
    lateral : float or (float, float)
        Standard deviation across the ray, pixels. Two numbers (a, b) mean ``a + b incidence / (pi/2 - incidence)``.
    divergence : float
        Full angle of a beam, radians. Above 0, five rays sample each beam.
    echo_separation : float
        Smallest distance of two surfaces in one beam that give separate returns. Nearer surfaces give one, at a mean
        range.
    returns : str
        The return kept: "first", "strongest" (greatest share of the beam over range squared), "last", or "all".
    drop : float
        Share of the returns that is lost at random.
    attenuation, drop_limit, drop_zero : float
        Loss of weak signals ``albedo cos(incidence) exp(-attenuation range)``, as in CARLA. The probability falls
        linearly from `drop_zero` at signal 0 to 0 at `drop_limit`. The sensors of the table use `detection_range`.
    detection_range : float
        Range at which a pulse that meets a white surface at right angles is detected with probability 1 / e. Dark,
        steep and far surfaces have a smaller one (`noise.detection_probability`). 0: every pulse returns.
    edge_loss : float
        Share of the pixels lost that have a neighbour more than 5 % nearer or farther.
    incidence_max : float
        Largest incidence that gives a return, degrees.
    baseline : (3,) or (m, 3) float
        Vector from a ray's start to the second camera, projector or laser of a triangulating sensor, sensor frame. Both
        must see the point, from the same side of its face; in a pinhole both images must contain it. With several
        vectors, one from which the point is seen is enough. 0: none.
    baseline_incidence_max : float
        Largest incidence at the second camera that gives a return, degrees.
    match_window : int
        Side of the square that stereo matching compares, pixels; only for a pinhole with a `baseline`. Pixels
        up to half of it, rounded down, beside a nearer surface or one that a single camera sees are lost.
    noise : float
        Factor on the standard deviations. 0 switches everything off except the range limits and the second camera.
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
    detection_range: float = 0.0
    edge_loss: float = 0.0
    incidence_max: float = 90.0
    baseline: float | Sequence[float] | Sequence[Sequence[float]] = 0.0
    baseline_incidence_max: float = 90.0
    match_window: int = 0
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
    def baselines(self) -> FloatArray:
        """The baselines, (m, 3); m is 0 without a second camera."""
        rows = np.asarray(self.baseline if np.ndim(self.baseline) else [], dtype=np.float64).reshape(-1, 3)
        return rows[rows.any(axis=1)]

    def range_sigma(self, ranges: ArrayLike, incidence: ArrayLike = 0.0) -> FloatArray:
        """Return the standard deviation at ranges (depths of an axial sensor) and incidences (radians)."""
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
    """A sensor: the pattern of its rays and the model of its noise.

    Parameters
    ----------
    name, summary : str
    kind : str
        A key of `PATTERNS`.
    pattern : mapping
        The numbers of that kind.
    noise_model : NoiseModel
    sources : mapping of str to str
        Source of each number, by the number's name.

    Raises
    ------
    OptionError
        An unknown kind; a number that the kind does not take; a number missing.
    """

    name: str
    kind: str
    pattern: Mapping[str, Any]
    noise_model: NoiseModel = field(default_factory=NoiseModel)
    summary: str = ""
    sources: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        parse_line("a sensor's name", self.name)
        check_choice("kind", self.kind, PATTERNS)
        known = numbers_of(self.kind)
        pattern = {name: value for name, value in self.pattern.items() if value is not None}
        for name in pattern:
            check_choice(f"a number of the kind {self.kind}", name, known)
        object.__setattr__(self, "pattern", {name: _number(name, value) for name, value in pattern.items()})
        needed = [name for name, default in known.items() if default is inspect.Parameter.empty]
        if missing := [name for name in needed if name not in self.pattern]:
            raise OptionError(f"sensor {self.name!r} of kind {self.kind} must have {', '.join(missing)}; it does not.")

    def __repr__(self) -> str:
        return f"Sensor({self.name!r}, {self.kind}{': ' if self.summary else ''}{self.summary})"

    def rays(self) -> Rays:
        """Return the rays of one revolution or image, sensor frame; the same object each time."""
        return self._rays

    @property
    def is_camera(self) -> bool:
        """True for a sensor that is aimed at its target; False for a LiDAR, which is mounted on something."""
        return self.kind in ("pinhole", "linear")

    @property
    def duration(self) -> float:
        """Seconds of a revolution, scan or image; 0 for sensors that cast all rays at once."""
        if self.kind == "spinning":
            return 1.0 / float(self.pattern.get("turns", 10.0))
        return float(self.pattern.get("seconds", self.pattern.get("readout", 0.0)))

    @property
    def no_motion_reason(self) -> str:
        """The reason why motion changes nothing: all rays are cast at once. Empty where the rays have times."""
        if self.rays().times is not None:
            return ""
        cure = "give --set-sensor readout=SECONDS" if self.kind == "pinhole" else "take another sensor"
        return f"{self.name} casts all rays at once; {cure}."

    @cached_property
    def _rays(self) -> Rays:
        return PATTERNS[self.kind](**self.pattern)

    @cached_property
    def intrinsics(self) -> FloatArray:
        """K (3, 3) of a pinhole, pixels; the upper left corner of the image is (0, 0)."""
        given, (width, height) = self.pattern, (self.pattern["width"], self.pattern["height"])
        f = given.get("f") or width / 2.0 / np.tan(np.radians(given["fov"]) / 2.0)
        centre = given.get("cx", width / 2.0), given.get("cy", height / 2.0)
        return np.array([[f, 0.0, centre[0]], [0.0, given.get("fy", f), centre[1]], [0.0, 0.0, 1.0]])

    def of_view(self, views: Views, view: int) -> "Sensor":
        """Return the sensor of a view; a pinhole takes the intrinsics and the image size of a file's camera."""
        if views.fov_bounds is None or self.kind != "pinhole":
            return self
        width, height = self.pattern["width"], self.pattern["height"]
        if views.sizes is not None:
            width, height = views.sizes[view].tolist()
        (fx, _, cx), (_, fy, cy), _ = views[view].intrinsics(width, height)[0]
        return self.with_numbers(width=width, height=height, f=fx, fy=fy, cx=cx, cy=cy)

    @property
    def pixels(self) -> float:
        """Focal length of a pinhole, pixels; 0 for other kinds."""
        return float(self.intrinsics[0, 0]) if self.kind == "pinhole" else 0.0

    def ray_starts(self, points: FloatArray) -> FloatArray:
        """Return the start of the ray to each of some points (n, 3); all are in the sensor's frame.

        In a linear sensor it is the position of the scanner beside the point. With laser offsets it is the position of
        the laser whose rays pass nearest to the point.
        """
        if "offsets" not in self.pattern:
            return np.asarray(points * [0.0, 1.0, 0.0] if self.kind == "linear" else np.zeros_like(points))
        nearest, least = np.zeros(len(points), dtype=np.intp), np.full(len(points), np.inf)
        for number, above in enumerate(self.angles_above_lasers(points)):
            nearest[np.abs(above) < least] = number
            least = np.minimum(np.abs(above), least)
        offsets = np.asarray(self.pattern["offsets"])[nearest]
        return beside_axis(np.arctan2(points[:, 1], points[:, 0]), offsets)

    def angles_above_lasers(self, points: FloatArray) -> Iterator[FloatArray]:
        """Yield for each laser the elevation (n,) of points (n, 3), sensor frame, above its rays, degrees."""
        lasers, level = self.pattern["lasers"], np.hypot(points[:, 0], points[:, 1])
        offsets = self.pattern.get("offsets", [(0.0, 0.0)] * len(lasers))
        for (elevation, _), (up, _) in zip(lasers, offsets, strict=True):
            yield np.degrees(np.arctan2(points[:, 2] - up, level)) - elevation

    def covers(self, points: FloatArray) -> NDArray[np.bool_]:
        """Return whether points (n, 3), sensor frame, lie in the field of view, (n,); always True for a list."""
        given, ahead = self.pattern, points[:, 0] > 0.0
        depth = np.where(ahead, np.maximum(points[:, 0], 1e-9 * np.abs(points).max(axis=1, initial=0.0)), 1.0)
        if self.kind == "pinhole":
            (fx, _, cx), (_, fy, cy) = self.intrinsics[:2]
            column, row = cx - fx * points[:, 1] / depth, cy - fy * points[:, 2] / depth
            within = (column >= 0) & (column < given["width"]) & (row >= 0) & (row < given["height"])
            return np.asarray(ahead & within)
        if self.kind == "linear":
            slope, (low, high) = points[:, 2] / depth, sorted(given["slopes"])
            beside = np.abs(points[:, 1]) <= given["columns"] * given["spacing"] / 2.0
            return np.asarray(ahead & beside & (slope >= low) & (slope <= high))
        if self.kind == "spinning":
            least, most = np.full((2, len(points)), [[np.inf], [-np.inf]])
            for above in self.angles_above_lasers(points):
                least, most = np.minimum(least, above), np.maximum(most, above)
            return np.asarray((least <= 0.0) & (most >= 0.0) & self._turns_to(points))
        if self.kind == "non_repetitive":
            (low, high), above = (
                sorted(given["elevations"]),
                np.degrees(np.arctan2(points[:, 2], np.hypot(*points.T[:2]))),
            )
            return np.asarray((above >= low) & (above <= high) & self._turns_to(points))
        if self.kind == "risley":  # a rosette about the x axis
            away = np.linalg.norm(points, axis=1)
            return np.asarray(points[:, 0] >= away * self.rays().directions[:, 0].min())
        return np.ones(len(points), dtype=bool)

    def _turns_to(self, points: FloatArray) -> NDArray[np.bool_]:
        """Return whether points (n, 3), sensor frame, lie within the azimuths of a spinning sensor's revolution."""
        low, high = sorted(self.pattern.get("azimuths", (-180.0, 180.0)))
        turned = (np.degrees(np.arctan2(points[:, 1], points[:, 0])) - low) % 360.0
        return np.asarray(turned <= high - low)

    def ray_density(self, points: FloatArray) -> FloatArray:
        """Return the rays per square metre across the beam at points (n, 3), sensor frame, (n,).

        On a surface there are fewer, by the cosine of the incidence. Between unevenly spaced lasers, the spacing of the
        two beside the point counts.

        Raises
        ------
        OptionError
            A kind whose rays have no spacing, or a single line of rays.
        """
        given, kind = self.pattern, self.kind
        level, depths = np.hypot(points[:, 0], points[:, 1]), np.maximum(points[:, 0], np.finfo(np.float64).tiny)
        ranges = np.linalg.norm(points, axis=1)
        if kind == "pinhole":
            return np.asarray(self.intrinsics[0, 0] * self.intrinsics[1, 1] * ranges / depths**3)
        if kind == "linear" and given["rows"] > 1 and np.ptp(given["slopes"]):
            slope = np.ptp(given["slopes"]) / (given["rows"] - 1)
            return np.asarray(np.hypot(depths, points[:, 2]) / (given["spacing"] * slope * depths**2))
        elevations = np.unique(np.radians([each for each, _ in given.get("lasers", ())]))
        if kind == "spinning" and len(elevations) > 1:
            first, last = np.radians(given.get("azimuths", (-180.0, 180.0)))
            turn = abs(last - first) / given["columns"]
            above = np.searchsorted(elevations, np.arctan2(points[:, 2], level))
            gap = np.diff(elevations)[np.clip(above - 1, 0, len(elevations) - 2)]
            return np.asarray(1.0 / (turn * np.maximum(level, np.finfo(np.float64).tiny) * gap * ranges))
        if kind == "non_repetitive":
            width, (low, high) = np.ptp(np.radians(given["azimuths"])), np.sin(np.radians(given["elevations"]))
            return np.asarray(len(self.rays()) / (width * abs(high - low) * ranges**2))
        raise OptionError(f"the sensor of a ray density must have evenly spaced rays; {self.name} has none. Give 0.")

    def with_numbers(self, /, **numbers: Any) -> "Sensor":
        """Return a copy of the sensor with some numbers changed, of its rays or its noise.

        Raises
        ------
        OptionError
            A number that the sensor does not have, or a value out of range.
        """
        pattern, noise, sources = dict(self.pattern), dict(vars(self.noise_model)), dict(self.sources)
        known = {**dict.fromkeys(numbers_of(self.kind)), **dict.fromkeys(noise)}
        for name, value in numbers.items():
            check_choice(f"a number of the sensor {self.name}", name, known)
            (noise if name in noise else pattern)[name] = value
            sources[name] = "given by the user"
        if numbers.get("fov") is not None and numbers.get("f") is not None:
            raise OptionError("a pinhole must be given fov or f, not both.")
        for one, other in (("fov", "f"), ("f", "fov")):
            if numbers.get(one) is not None:
                pattern.pop(other, None)
        return Sensor(self.name, self.kind, pattern, NoiseModel(**noise), self.summary, sources)

    def numbers(self) -> dict[str, Any]:
        """Return the numbers by name: all of the rays, and those of the noise that are set."""
        known = vars(self.noise_model).items()
        noise = {k: v for k, v in known if v != getattr(NoiseModel, k) or k in self.sources}
        return {**self.pattern, **noise}

    def to_dict(self) -> dict[str, Any]:
        """Return name, kind and all numbers that differ from their defaults, as plain data."""
        noise = {k: v for k, v in vars(self.noise_model).items() if v != getattr(NoiseModel, k)}
        return {"name": self.name, "kind": self.kind, "pattern": dict(self.pattern), "noise_model": noise}

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "Sensor":
        """Return the sensor that `to_dict` described."""
        noise = NoiseModel(**document["noise_model"])
        return cls(document["name"], document["kind"], document["pattern"], noise)
