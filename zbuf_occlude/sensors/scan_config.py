"""Configuration of scans: sensor, motion, range, size, scene, points kept."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from numbers import Real
from typing import Any

import numpy as np

from zbuf_occlude.base.arrays import as_flag
from zbuf_occlude.base.errors import ArgumentError, OptionError, check_choice, check_int, find_row, shown
from zbuf_occlude.sensors.motion import Motion
from zbuf_occlude.sensors.scenes.kinds import KINDS, Kind
from zbuf_occlude.sensors.scenes.sizes import Sizes, sizes_of
from zbuf_occlude.sensors.scenes.table import checked_table
from zbuf_occlude.sensors.sensor import Sensor
from zbuf_occlude.visibility import find_method

SURFACE = "surface"
"""Name of no sensor: points sampled uniformly over the visible surface."""
KEEPS = ("target", "box", "all")
"""Values of `ScanConfig.keep`, without the perturbations of a box."""
PERTURBATIONS = {"shift": 0.0, "rotate": False, "scale": False}
"""Perturbations of a box that is kept, with their defaults. ScanObjectNN's PB_T50_RS: shift=0.5, rotate, scale."""
RANGE_LAWS = ("range", "area")
"""Values of `ScanConfig.range_law`. The text of a range may end in one: ``5..50@area``."""
LEAST_POINTS = 16
"""Default of `ScanConfig.least_points`: a cloud of fewer distinct points shows hardly anything of its object."""


@dataclass(frozen=True)
class ScanConfig:
    """The configuration of scans. Ranges and sizes may be texts, as on the command line.

    Parameters
    ----------
    sensor : Sensor
    range : (float, float), float, str, or None
        Metres from the sensor to the centre of the target (along the ground where there is one), drawn between two
        bounds. None: the distance of the view, in multiples of the target's size. Text: ``A..B``, ``A..B@area``.
    range_law : {"range", "area"}
        Law of the ranges drawn: uniform in range, or in area, as objects on a plane are: the density of a range r is
        proportional to r, and the share of ranges below r is (r^2 - A^2) / (B^2 - A^2).
    size : mapping of class to metres, metres, or "file"
        Longest sides (`zbuf_occlude.sensors.scenes.sizes.sizes_of`).
    scene : str
        A name of `zbuf_occlude.sensors.scenes.KINDS`, or "file" for `objects`.
    objects : sequence of mapping
        Objects of a scene from a file (`zbuf_occlude.sensors.scenes.contents.read_scene`).
    table : mapping or None
        Table under the target, in scenes from a file and of the kind "table": size, height, albedo.
    ground : bool
        True where a scene from a file has a ground.
    hidden : (float, float), float, or None
        Share of the target that others hide, drawn uniformly from two bounds. None: the scene's default.
    keep : str
        "target", "all", or "box" with its perturbations, ``box:shift=.5,rotate,scale``.
    keep_clean : bool
        Keep the ranges without noise too.
    sensor_height : float or None
        Height of a LiDAR above the ground, metres. None: the scene's default. Cameras have the poses of the views.
    method : str
        Ray caster.
    transparent : mapping of str to float or None
        Share of light that materials let pass, by name, which may contain ``*``. None: the file's own share.
    motion : Motion or None
        Motion of the sensor during a scan. None: the sensor stands still.
    least_points : int
        Scans of fewer distinct points give no cloud. 0: all that have two points or more.

    Raises
    ------
    OptionError
        A value out of range, or an unknown name.
    ArgumentError
        A value of a wrong type.
    """

    sensor: Sensor
    range: Sequence[float] | None = None
    range_law: str = RANGE_LAWS[0]
    size: Sizes = field(default_factory=dict)
    scene: str = "none"
    objects: Sequence[Mapping[str, Any]] = ()
    table: Mapping[str, Any] | None = None
    ground: bool = True
    hidden: Sequence[float] | None = None
    keep: str = "target"
    keep_clean: bool = False
    sensor_height: float | None = None
    method: str = "exact"
    transparent: Mapping[str, float | None] = field(default_factory=dict)
    motion: Motion | None = None
    least_points: int = LEAST_POINTS

    def __post_init__(self) -> None:
        if isinstance(self.range, str) and "@" in self.range:
            span, _, law = self.range.partition("@")
            object.__setattr__(self, "range", span)
            object.__setattr__(self, "range_law", law)
        check_choice("range law", self.range_law, RANGE_LAWS)
        object.__setattr__(self, "size", sizes_of(self.size) if self.size is not None else {})
        for name, span in (("range", self.range), ("hidden", self.hidden)):
            if span is not None:
                object.__setattr__(self, name, span_of(f"--{name}", span))
        for name, word in (("scene", self.scene), ("keep", self.keep), ("method", self.method)):
            if not isinstance(word, str):
                raise OptionError(f"{name} must be a word; got {shown(word)}.")
        as_flag(self.keep_clean, "keep_clean")
        as_flag(self.ground, "ground")
        if self.scene == "table" or self.table is not None:
            object.__setattr__(self, "table", checked_table(self.table or {}))
        check_int("least_points", self.least_points, 0)
        find_method(self.method)
        self._check_spans()
        self._check_sensor_height()
        self._check_transparent()
        self._check_motion()
        _ = self.kind, self.box  # wrong values of `scene` and `keep` raise here

    def _check_spans(self) -> None:
        if self.range is not None and not 0.0 < self.range[0] <= self.range[1] < np.inf:
            raise OptionError(f"--range must be metres above 0, A or A..B with A <= B; got {_shown(self.range)}.")
        if self.hidden is not None:
            if not 0.0 <= self.hidden[0] <= self.hidden[1] <= 0.9:
                raise OptionError(f"--hidden must be a share or A..B within 0..0.9; got {_shown(self.hidden)}.")
            if self.hidden[1] > 0.0 and self.kind.share is None:
                names = ", ".join(kind.name for kind in KINDS if kind.share is not None)
                raise OptionError(f"--hidden needs a scene that can hide: {names}; got --scene {self.scene}.")

    def _check_sensor_height(self) -> None:
        if self.sensor_height is None:
            return
        has_ground = self.kind.sensor_height is not None
        if not (has_ground and _is_number(self.sensor_height) and 0.0 < self.sensor_height < np.inf):
            raise OptionError(
                f"--sensor-height must be metres above 0, over a ground, which --scene {self.scene} "
                f"{'has' if has_ground else 'lacks'}; got {shown(self.sensor_height)}."
            )
        if self.sensor.is_camera:
            raise OptionError(
                f"--sensor-height is for a LiDAR above the ground; {self.sensor.name} is a camera, placed by "
                "--views (or --elevation) and --range. Leave it out."
            )

    def _check_transparent(self) -> None:
        if not isinstance(self.transparent, Mapping):
            raise ArgumentError(
                f"transparent must be a mapping of names to shares; got {type(self.transparent).__name__}."
            )
        for name, share in self.transparent.items():
            if not isinstance(name, str) or not (share is None or (_is_number(share) and 0.0 <= share <= 1.0)):
                raise OptionError(
                    f"--transparent must be NAME or NAME=SHARE, a share in 0..1; got {shown(name)}={shown(share)}."
                )

    def _check_motion(self) -> None:
        if self.motion is None:
            return
        if not isinstance(self.motion, Motion):
            raise ArgumentError(f"motion must be a sensors.Motion; got {type(self.motion).__name__}. Make one.")
        if len(self.sensor.noise_model.baselines):
            raise OptionError(
                f"a sensor that moves must have no second camera; {self.sensor.name} has one. Or give "
                "--set-sensor baseline=0."
            )
        if self.sensor.no_motion_reason:
            raise OptionError(self.sensor.no_motion_reason)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain data."""
        motion = None if self.motion is None else self.motion.to_dict()
        plain = {each.name: getattr(self, each.name) for each in fields(self)}
        return plain | {"sensor": self.sensor.to_dict(), "motion": motion}

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "ScanConfig":
        """Return the configuration that `to_dict` described."""
        motion = None if document["motion"] is None else Motion(**document["motion"])
        return cls(**{**document, "sensor": Sensor.from_dict(document["sensor"]), "motion": motion})

    @cached_property
    def kind(self) -> Kind:
        """The row of the scene's kind; a scene from a file is of kind "ground", or "none" where it has no ground."""
        of_file = "ground" if self.ground else "none"
        return find_row("scene", of_file if self.scene == "file" else self.scene, KINDS)

    @property
    def may_hide(self) -> bool:
        """True where objects may hide some of the target."""
        return self.share is not None or bool(self.objects) or self.scene == "table"

    @property
    def takes_time(self) -> bool:
        """True where the time of a ray matters: the sensor moves, or an object does."""
        return self.motion is not None or any({"velocity", "turn"} & set(each) for each in self.objects)

    @cached_property
    def box(self) -> dict[str, Any] | None:
        """Perturbations of the box that is kept; None where no box is kept."""
        word, _, rest = self.keep.partition(":")
        check_choice("keep", word, KEEPS)
        given: dict[str, Any] = dict(PERTURBATIONS)
        for part in filter(None, rest.split(",")):
            match = re.fullmatch(r"(rotate|scale)|shift=(\d*\.?\d+)", part.strip())
            if match is None or word != "box":
                raise OptionError(f"--keep must be target, all or box[:shift=S,rotate,scale]; got {self.keep!r}.")
            given |= {match[1]: True} if match[1] else {"shift": float(match[2])}
        return given if word == "box" else None

    @property
    def share(self) -> Sequence[float] | None:
        """Bounds of the target's hidden share: those given, else the scene's; None where nothing hides the target."""
        return self.kind.share if self.hidden is None or self.kind.share is None else self.hidden

    @property
    def is_level(self) -> bool:
        """True for a LiDAR above a ground that is mounted level: all but the rosettes of two prisms."""
        return self.height is not None and self.sensor.kind in ("spinning", "non_repetitive")

    @property
    def most_objects(self) -> int:
        """Maximum number of objects in a scene."""
        return self.kind.most + len(self.objects) + (self.table is not None)

    @property
    def height(self) -> float | None:
        """Height of a LiDAR above the ground, metres; None for cameras, and where there is no ground."""
        if self.sensor.is_camera:
            return None
        return self.sensor_height if self.sensor_height is not None else self.kind.sensor_height


def span_of(name: str, value: Any) -> tuple[float, float]:
    """Return two numbers from the text ``A`` or ``A..B``, from one number, or from two.

    Raises
    ------
    OptionError
        `value` is none of these; the message contains `name`.
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
