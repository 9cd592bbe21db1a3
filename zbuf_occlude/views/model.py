"""Views: where cameras stand, how they are turned, and what their pictures show."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.arrays import (
    LARGEST,
    BoolArray,
    FloatArray,
    IntArray,
    ReadOnlyArrays,
    as_array,
    as_indices,
    readonly_copy,
)
from zbuf_occlude.errors import ArgumentError, escape_control
from zbuf_occlude.geometry.camera import rigid_matrices, view_matrices

MOST_PIXELS = 1 << 26
"""Of a picture."""
NOT_A_ROTATION = 1e-3
"""A matrix whose products of rows are off by more is none; files have few digits."""
PAPER_DISTANCE = 4.0
"""Distance of the camera in units of the object's longest side (paper 4.1)."""


@dataclass(frozen=True, eq=False)
class Views(ReadOnlyArrays):
    """Camera positions about a target. Immutable.

    Parameters
    ----------
    azimuth : (k,) float
        Radians, from +x towards +y.
    elevation : (k,) float
        Radians, from the xy plane, in [-pi/2, pi/2]; +pi/2 is +z.
    distance : (k,) float or float
        Distance from the target, in world units, positive; with `rotations` 0 too.
    target : (3,) float
        What the cameras stand about, and look at unless `rotations` say otherwise; world space.
    roll : (k,) float or float
        Radians, the camera turned about its axis; positive turns its top towards its right.
    rotations : (k, 3, 3) float, optional
        World space to eye space (x right, y up, looking along -z), for cameras that do not look at the target. Such
        cameras stand where they are: `around` does not move them.
    windows : (k, 4) float, optional
        What the cameras' pictures show: tangents left, right, bottom, top (eye x or y over eye depth). By default all.
    sizes : (k, 2) int, optional
        Pixels of the pictures, width and height, of cameras of a file that says so; with `windows`.

    Raises
    ------
    ArgumentError
        Different lengths, values out of range or not finite.

    Examples
    --------
    >>> views = zo.views.paper100(distance=2.0)
    >>> views[0]
    Views(1 view about (0, 0, 0))
    >>> views.eyes.shape
    (100, 3)
    """

    azimuth: FloatArray
    elevation: FloatArray
    distance: FloatArray
    target: FloatArray | Sequence[float] = (0.0, 0.0, 0.0)
    roll: FloatArray | float = 0.0
    rotations: FloatArray | None = None
    windows: FloatArray | None = None
    sizes: IntArray | None = None

    def __post_init__(self) -> None:
        given = {"azimuth": self.azimuth, "elevation": self.elevation, "distance": self.distance, "target": self.target}
        try:
            *angles, target, roll = (_as_floats(values) for values in (*given.values(), self.roll))
            angles.append(roll)
        except (TypeError, ValueError, OverflowError) as error:
            raise ArgumentError(f"{', '.join(given)} must be numbers; {escape_control(str(error))[:80]}.") from None
        try:
            azimuth, elevation, distance, roll = np.broadcast_arrays(*map(np.atleast_1d, angles))
        except ValueError:
            raise ArgumentError(
                "azimuth, elevation and distance must have one length; got "
                f"{np.size(self.azimuth)}, {np.size(self.elevation)} and {np.size(self.distance)}."
            ) from None
        if azimuth.ndim != 1 or target.shape != (3,):
            raise ArgumentError(f"angles must be (k,) and target (3,); got {azimuth.shape} and {target.shape}.")
        fields = {"azimuth": azimuth, "elevation": elevation, "distance": distance, "target": target, "roll": roll}
        for name, shape in (("rotations", (3, 3)), ("windows", (4,))):
            if (values := getattr(self, name)) is not None:
                fields[name] = as_array(values, name, str((len(azimuth), *shape))).astype(np.float64)
                if fields[name].shape != (len(azimuth), *shape):
                    raise ArgumentError(f"{name} must be {(len(azimuth), *shape)}; got {fields[name].shape}.")
        if self.sizes is not None:
            fields["sizes"] = as_indices(self.sizes, "sizes", columns=2, lowest=1, upper=MOST_PIXELS + 1)
            if self.windows is None or len(fields["sizes"]) != len(azimuth):
                raise ArgumentError(f"sizes must go with windows, one of each per view ({len(azimuth)}).")
        for name, values in fields.items():
            if not (np.abs(values) <= LARGEST).all():  # NaN is not
                worst = values[~(np.abs(values) <= LARGEST)][0]
                raise ArgumentError(f"{name} must be finite and below {LARGEST:g}; got {worst}.")
        if (turns := fields.get("rotations")) is not None and len(turns):
            off = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
            if (wrong := (off > NOT_A_ROTATION) | (np.linalg.det(turns) < 0.0)).any():
                raise ArgumentError(
                    f"rotations must be rotations, without scale or reflection; {wrong.argmax()} is not."
                )
        if (np.abs(elevation) > np.pi / 2 + 1e-9).any():
            worst = np.degrees(elevation[np.abs(elevation).argmax()])
            raise ArgumentError(f"elevation must lie in [-pi/2, pi/2]; got {worst:g} degrees. Give radians.")
        if (distance <= 0 if self.rotations is None else distance < 0).any():
            raise ArgumentError(f"distance must be positive; got {distance.min():g}.")
        for name, values in fields.items():
            object.__setattr__(self, name, readonly_copy(values))

    def __len__(self) -> int:
        return len(self.azimuth)

    def __repr__(self) -> str:
        about = ", ".join(f"{x:g}" for x in np.asarray(self.target))
        return f"Views({len(self)} view{'s' * (len(self) != 1)} about ({about}))"

    def __getitem__(self, which: ArrayLike | slice) -> "Views":
        """Return the views of an index, a slice, a mask or an index array; of an index Views of one."""
        chosen = np.arange(len(self))[which]  # type: ignore[index]  # ArrayLike: whatever NumPy takes
        return self.select(np.atleast_1d(chosen))

    @property
    def eyes(self) -> FloatArray:
        """Centres of projection, world space, (k, 3). At the poles the position is exactly on the z axis."""
        flat = np.where(np.abs(self.elevation) >= np.pi / 2 - 1e-9, 0.0, np.cos(self.elevation))
        direction = np.stack([flat * np.cos(self.azimuth), flat * np.sin(self.azimuth), np.sin(self.elevation)], axis=1)
        return np.asarray(self.target + self.distance[:, None] * direction)

    @property
    def ups(self) -> FloatArray:
        """Up vectors (k, 3), unit: the direction in which elevation grows, so that the poles have one too; rolled."""
        if self.rotations is not None:
            return self.rotations[:, 1]
        sin, cos = np.sin(self.elevation), np.cos(self.elevation)
        ups = np.stack([-sin * np.cos(self.azimuth), -sin * np.sin(self.azimuth), cos], axis=1)
        if not np.any(self.roll):
            return ups
        rights = np.stack([-np.sin(self.azimuth), np.cos(self.azimuth), np.zeros(len(self))], axis=1)
        roll = np.asarray(self.roll)[:, None]
        return np.asarray(np.cos(roll) * ups + np.sin(roll) * rights)

    @property
    def poses(self) -> FloatArray:
        """View matrices (k, 4, 4): world space to eye space."""
        if self.rotations is None:
            return view_matrices(self.eyes, self.target, self.ups)
        return rigid_matrices(self.rotations, self.eyes)

    def in_frustum(self, positions: FloatArray) -> BoolArray:
        """Return which positions (n, 3) lie within each camera's picture, (k, n); all where there are no windows."""
        if self.windows is None:
            return np.ones((len(self), len(positions)), dtype=bool)
        inside = np.empty((len(self), len(positions)), dtype=bool)
        for row, pose, (left, right, bottom, top) in zip(inside, self.poses, self.windows, strict=True):
            x, y, z = (positions @ pose[:3, :3].T + pose[:3, 3]).T
            row[:] = (z < 0) & (x >= left * -z) & (x <= right * -z) & (y >= bottom * -z) & (y <= top * -z)
        return inside

    def intrinsics(self, width: ArrayLike, height: ArrayLike) -> FloatArray:
        """Return K (k, 3, 3) of pictures of `windows`, pixels, y down, the upper left pixel's corner at (0, 0).

        `width` and `height` are of all pictures, or (k,) of each.

        Raises ArgumentError where there are no windows.
        """
        if self.windows is None:
            raise ArgumentError("views must have pictures; these have none. Give a field of view: views.looking.")
        left, right, bottom, top = self.windows.T
        found = np.zeros((len(self), 3, 3))
        found[:, 0, 0], found[:, 1, 1], found[:, 2, 2] = width / (right - left), height / (top - bottom), 1.0
        found[:, 0, 2], found[:, 1, 2] = -left * found[:, 0, 0], top * found[:, 1, 1]
        return found

    def select(self, which: ArrayLike) -> "Views":
        """Return the views that a boolean mask or an index array picks, in its order."""
        chosen, given = np.asarray(which), {each.name: getattr(self, each.name) for each in fields(self)}
        per_view = {name: given[name] for name in given if name != "target" and given[name] is not None}
        return replace(self, **{name: values[chosen] for name, values in per_view.items()})

    def around(self, centre: ArrayLike, scale: float) -> "Views":
        """Return the views about another target, all distances multiplied by `scale`.

        ``views.around(mesh.centre, mesh.longest_side)`` turns distances in longest sides into world units. Cameras with
        `rotations` stay where they are; their angles and distances become those about the new target.
        """
        target = np.asarray(centre, dtype=np.float64)
        if self.rotations is not None:
            return Views.of_cameras(self.eyes, self.rotations, self.windows, target, self.sizes)
        return replace(self, distance=self.distance * scale, target=target)

    def looking(self, at: ArrayLike | None = None, field_of_view: float | None = None) -> "Views":
        """Return the views turned to look at a point (3,), with square pictures of an angle in radians."""
        rotations, windows, sizes = self.rotations, self.windows, self.sizes
        if at is not None:
            rotations = view_matrices(self.eyes, np.asarray(at, dtype=np.float64), self.ups)[:, :3, :3]
        if field_of_view is not None:
            side, sizes = np.tan(field_of_view / 2), None
            windows = np.tile([-side, side, -side, side], (len(self), 1))
        return replace(self, rotations=rotations, windows=windows, sizes=sizes)

    @classmethod
    def of_cameras(
        cls,
        eyes: FloatArray,
        rotations: FloatArray,
        windows: FloatArray | None = None,
        target: ArrayLike = (0, 0, 0),
        sizes: IntArray | None = None,
    ) -> "Views":
        """Return cameras that stand at `eyes` (k, 3), world space, and are turned by `rotations` (k, 3, 3)."""
        target = np.asarray(target, dtype=np.float64)
        offsets = eyes - target
        distance = np.linalg.norm(offsets, axis=1)
        azimuth = np.arctan2(offsets[:, 1], offsets[:, 0])
        elevation = np.arctan2(offsets[:, 2], np.hypot(offsets[:, 0], offsets[:, 1]))
        return cls(azimuth, elevation, distance, target, 0.0, rotations, windows, sizes)

    @property
    def table(self) -> FloatArray:
        """All that is known of views about the origin, a row each: azimuth, elevation, distance[, roll[, ...]]."""
        columns = [self.azimuth[:, None], self.elevation[:, None], self.distance[:, None]]
        if np.any(self.roll) or self.rotations is not None:
            columns.append(np.asarray(self.roll)[:, None])
        if self.rotations is not None:
            columns.append(self.rotations.reshape(-1, 9))
            if self.windows is not None:
                columns.append(self.windows)
            if self.sizes is not None:
                columns.append(self.sizes.astype(np.float64))
        return np.concatenate(columns, axis=1)

    @classmethod
    def from_table(cls, table: ArrayLike) -> "Views":
        """Return views from their `table`."""
        rows = np.asarray(table, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] not in (3, 4, 13, 17, 19):
            raise ArgumentError(f"a table of views must be of 3, 4, 13, 17 or 19 columns; got {rows.shape}.")
        azimuth, elevation, distance = rows[:, :3].T
        roll = rows[:, 3] if rows.shape[1] > 3 else 0.0
        rotations = rows[:, 4:13].reshape(-1, 3, 3) if rows.shape[1] > 4 else None
        windows = rows[:, 13:17] if rows.shape[1] > 13 else None
        sizes = rows[:, 17:].astype(np.int32) if rows.shape[1] > 17 else None
        return cls(azimuth, elevation, distance, roll=roll, rotations=rotations, windows=windows, sizes=sizes)


def check_views(name: str, value: Any) -> None:
    """Raise ArgumentError unless a value is Views."""
    if not isinstance(value, Views):
        raise ArgumentError(
            f"{name} must be Views; got {type(value).__name__}. Make some: views.for_mesh(mesh, 'ring:8@30')."
        )


def _as_floats(values: ArrayLike) -> FloatArray:
    """Return numbers as float64; raise TypeError for others, such as bools, texts and complex ones."""
    array = np.asarray(values)
    if array.size and array.dtype.kind not in "fiu":
        raise TypeError(f"got {array.dtype}")
    return array.astype(np.float64)
