"""How scans are to be made: sensor, range, size, scene, what is kept; checked once, and plain data for plans."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from numbers import Real
from typing import Any

import numpy as np

from zbuf_occlude.arrays import as_flag
from zbuf_occlude.errors import ArgumentError, OptionError, check_choice, find_row, shown
from zbuf_occlude.scenes.kinds import KINDS, Kind
from zbuf_occlude.scenes.sizes import Sizes, sizes_of
from zbuf_occlude.sensors.motion import Motion
from zbuf_occlude.sensors.sensor import Sensor
from zbuf_occlude.views import Views
from zbuf_occlude.visibility import find_method

SURFACE = "surface"
"""The word for no sensor: points sampled uniformly over the visible surface."""
KEEPS = ("target", "box", "all")
ADDED = ("transparent", "motion")
"""Fields of a setup that plans did not always have."""
DISTURBANCES = {"shift": 0.0, "rotate": False, "scale": False}
"""How a box that is kept may be disturbed, as ScanObjectNN's PB_T50_RS: shift=0.5, rotate, scale."""


@dataclass(frozen=True)
class ScanConfig:
    """How scans are made. Everything in it is plain data, so that a plan can keep it.

    Parameters
    ----------
    sensor : mapping
        As `Sensor.to_dict()`.
    range : (float, float), float, or None
        Metres from the sensor to the middle of the target, drawn from between; on the ground where there is one. None:
        as far as the views say, in multiples of the target's size.
    size : mapping of class to metres, metres, or "file"
        Longest sides (`zbuf_occlude.scenes.sizes.sizes_of`).
    scene : str
        A name of `zbuf_occlude.scenes.KINDS`, or "file" for `objects`.
    objects : sequence of mapping
        Of a scene from a file (`zbuf_occlude.scenes.contents.read_scene`); it has a ground.
    hidden : (float, float), float, or None
        Share of the target that others hide, drawn from between; None: the scene's own.
    keep : str
        "target", "all", or "box" with how it is disturbed, ``box:shift=.5,rotate,scale``.
    keep_clean : bool
        Keep the ranges without noise too.
    sensor_height : float or None
        Metres of a LiDAR above the ground; None: the scene's own. Cameras stand where the views say.
    method : str
        Who casts the rays.
    transparent : mapping of str to float or None
        Materials that let light pass, by name, which may have ``*``, and its share; None: the file's own share.
    motion : mapping or None
        How the sensor moves while it scans: what `Motion` takes.

    Raises
    ------
    OptionError
        A value out of range, or not one of those there are.
    """

    sensor: Mapping[str, Any]
    range: Sequence[float] | None = None
    size: Sizes = field(default_factory=dict)
    scene: str = "none"
    objects: Sequence[Mapping[str, Any]] = ()
    hidden: Sequence[float] | None = None
    keep: str = "target"
    keep_clean: bool = False
    sensor_height: float | None = None
    method: str = "exact"
    transparent: Mapping[str, float | None] = field(default_factory=dict)
    motion: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", sizes_of(self.size) if self.size is not None else {})
        for name, span in (("range", self.range), ("hidden", self.hidden)):
            if not (span is None or (isinstance(span, list | tuple) and _is_span(span))):  # of a plan as they are
                object.__setattr__(self, name, span_of(f"--{name}", span))
        for name, word in (("scene", self.scene), ("keep", self.keep), ("method", self.method)):
            if not isinstance(word, str):
                raise OptionError(f"{name} must be a word; got {shown(word)}.")
        as_flag(self.keep_clean, "keep_clean")
        find_method(self.method)
        if self.range is not None and not 0.0 < self.range[0] <= self.range[1] < np.inf:
            raise OptionError(f"--range must be metres above 0, A or A..B with A <= B; got {_shown(self.range)}.")
        if self.hidden is not None:
            if not 0.0 <= self.hidden[0] <= self.hidden[1] <= 0.9:
                raise OptionError(f"--hidden must be a share or A..B within 0..0.9; got {_shown(self.hidden)}.")
            if self.hidden[1] > 0.0 and self.kind.share is None:
                names = ", ".join(kind.name for kind in KINDS if kind.share is not None)
                raise OptionError(f"--hidden needs a scene that can hide: {names}; got --scene {self.scene}.")
        if self.sensor_height is not None and not (
            self.kind.sensor_height is not None and _is_number(self.sensor_height) and 0.0 < self.sensor_height < np.inf
        ):
            raise OptionError(
                f"--sensor-height must be metres above 0, over a ground, which --scene {self.scene} "
                f"{'has' if self.kind.sensor_height is not None else 'lacks'}; got {shown(self.sensor_height)}."
            )
        if self.sensor_height is not None and self.sensor_model.is_camera:
            raise OptionError(
                f"--sensor-height must be of a LiDAR above the ground; {self.sensor_model.name} is a camera, which is "
                "where --views (or --elevation) and --range say. Leave it out."
            )
        if not isinstance(self.transparent, Mapping):
            raise ArgumentError(
                f"transparent must be a mapping of names to shares; got {type(self.transparent).__name__}."
            )
        for name, share in self.transparent.items():
            if not isinstance(name, str) or not (share is None or (_is_number(share) and 0.0 <= share <= 1.0)):
                raise OptionError(
                    f"--transparent must be NAME or NAME=SHARE, a share in 0..1; got {shown(name)}={shown(share)}."
                )
        if self.motion_model is not None and len(self.sensor_model.imperfections.second_eyes):
            raise OptionError(
                f"a sensor that moves must have one eye; {self.sensor_model.name} has more. Or --set-sensor baseline=0."
            )
        if self.motion_model is not None and self.sensor_model.untimed:
            raise OptionError(self.sensor_model.untimed)
        _ = self.kind, self.box  # read for their errors

    def to_dict(self) -> dict[str, Any]:
        """The fields as plain data; what there was not always only where it is given, so that older plans are equal."""
        return {name: value for name, value in asdict(self).items() if name not in ADDED or value}

    @cached_property
    def kind(self) -> Kind:
        """The scene's row; a file's stands on a ground."""
        return find_row("scene", "ground" if self.scene == "file" else self.scene, KINDS)

    @cached_property
    def sensor_model(self) -> Sensor:
        """The sensor."""
        return Sensor.from_dict(self.sensor)

    @cached_property
    def motion_model(self) -> Motion | None:
        """How the sensor moves; None where it stands still."""
        if not isinstance(self.motion, Mapping | None):
            raise ArgumentError(f"motion must be a mapping of what Motion takes; got {type(self.motion).__name__}.")
        for name in self.motion or ():
            check_choice("a key of motion", name, [each.name for each in fields(Motion)])
        return None if self.motion is None else Motion(**self.motion)

    @property
    def takes_time(self) -> bool:
        """Whether it matters when a ray is cast: the sensor moves, or an object does."""
        return self.motion is not None or any({"velocity", "turn"} & set(each) for each in self.objects)

    def sensor_of(self, views: Views, view: int) -> Sensor:
        """Return the sensor of a view: a pinhole has the picture that cameras of a file have, and its pixels."""
        sensor = self.sensor_model
        if views.windows is None or sensor.kind != "pinhole":
            return sensor
        width, height = sensor.pattern["width"], sensor.pattern["height"]
        if views.sizes is not None:
            width, height = views.sizes[view].tolist()
        (fx, _, cx), (_, fy, cy), _ = views[view].intrinsics(width, height)[0]
        return sensor.with_numbers(width=width, height=height, f=fx, fy=fy, cx=cx, cy=cy)

    @cached_property
    def box(self) -> dict[str, Any] | None:
        """How the box that is kept is disturbed; None where none is."""
        word, _, rest = self.keep.partition(":")
        check_choice("keep", word, KEEPS)
        given: dict[str, Any] = dict(DISTURBANCES)
        for part in filter(None, rest.split(",")):
            match = re.fullmatch(r"(rotate|scale)|shift=(\d*\.?\d+)", part.strip())
            if match is None or word != "box":
                raise OptionError(f"--keep must be target, all or box[:shift=S,rotate,scale]; got {self.keep!r}.")
            given |= {match[1]: True} if match[1] else {"shift": float(match[2])}
        return given if word == "box" else None

    @property
    def share(self) -> Sequence[float] | None:
        """Of the target to be hidden: the range asked for, or the scene's own; None where nothing is put before it."""
        return self.kind.share if self.hidden is None or self.kind.share is None else self.hidden

    @property
    def is_level(self) -> bool:
        """Whether the sensor stands level: a LiDAR that spins, over a ground."""
        return self.height is not None and self.sensor_model.kind == "spinning"

    @property
    def most_objects(self) -> int:
        """Objects of a scene, at most."""
        return self.kind.most + len(self.objects)

    @property
    def height(self) -> float | None:
        """Of a LiDAR above the ground, metres; None of cameras, and where there is no ground."""
        if self.sensor_model.is_camera:
            return None
        return self.sensor_height if self.sensor_height is not None else self.kind.sensor_height


def span_of(name: str, value: Any) -> tuple[float, float]:
    """Read ``A`` or ``A..B`` as a person types it, or a number or two as Python has them.

    Raises
    ------
    OptionError
        None of these; the message has `name`.
    """
    try:
        if isinstance(value, str):
            first, dots, last = value.partition("..")
            return float(first), float(last if dots else first)
        if _is_number(value) or _is_span(value):
            first, last = (value, value) if _is_number(value) else value
            return float(first), float(last)
    except (ValueError, OverflowError):
        pass
    raise OptionError(f"{name} must be a number, or two as A..B; got {shown(value)}.")


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _is_span(span: Any) -> bool:
    if isinstance(span, np.ndarray):
        span = span.tolist()
    return isinstance(span, Sequence) and len(span) == 2 and all(map(_is_number, span))


def _shown(span: Sequence[float]) -> str:
    return f"{span[0]:g}" if span[0] == span[1] else f"{span[0]:g}..{span[1]:g}"
