"""Views: positions, orientations and fields of view of cameras."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.base.arrays import (
    LARGEST,
    BoolArray,
    FloatArray,
    IntArray,
    ReadOnlyArrays,
    as_array,
    as_indices,
    as_number,
    as_selection,
    as_vector,
    readonly_copy,
)
from zbuf_occlude.base.errors import ArgumentError, escape_control
from zbuf_occlude.geometry.camera import rigid_matrices, view_matrices

MAX_PIXELS = 1 << 26
"""Maximum pixels of an image."""
ROTATION_TOLERANCE = 1e-3
"""Largest error of the products of a rotation matrix's rows: files have few digits."""
PAPER_DISTANCE = 4.0
"""Distance of the camera in units of the object's longest side (paper 4.1)."""
AXES = ("opengl", "opencv")
"""Axes of a camera's frame: x right, y up, looking along -z; or x right, y down, looking along z."""


def with_axes(poses: FloatArray, axes: str) -> FloatArray:
    """Return view matrices (..., 4, 4) with these `AXES` of the camera's frame."""
    return np.diag([1.0, -1.0, -1.0, 1.0]) @ poses if axes == "opencv" else poses


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
        Distance from the target, world units: above 0, or at least 0 with `rotations`.
    target : (3,) float
        The point to which the positions are relative, and at which the cameras look unless there are `rotations`;
        world space.
    roll : (k,) float or float
        Rotation of the camera about its axis, radians; positive turns its top towards its right.
    rotations : (k, 3, 3) float, optional
        World space to eye space (x right, y up, looking along -z), for cameras that do not look at the target. Their
        positions are absolute: `around` does not move them.
    fov_bounds : (k, 4) float, optional
        Fields of view: tangents left, right, bottom, top (eye x or y over eye depth). Default: unlimited.
    sizes : (k, 2) int, optional
        Width and height of the images, pixels, where a file has them; only with `fov_bounds`.

    Raises
    ------
    ArgumentError
        Different lengths; values out of range or not finite.

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
    fov_bounds: FloatArray | None = None
    sizes: IntArray | None = None

    def __post_init__(self) -> None:
        arrays: dict[str, Any] = self._read_positions()
        n_views = len(arrays["azimuth"])
        for name, shape in (("rotations", (3, 3)), ("fov_bounds", (4,))):
            if (values := getattr(self, name)) is not None:
                arrays[name] = as_array(values, name, str((n_views, *shape))).astype(np.float64)
                if arrays[name].shape != (n_views, *shape):
                    raise ArgumentError(f"{name} must be {(n_views, *shape)}; got {arrays[name].shape}.")
        if self.sizes is not None:
            arrays["sizes"] = as_indices(self.sizes, "sizes", columns=2, lowest=1, upper=MAX_PIXELS + 1)
            if self.fov_bounds is None or len(arrays["sizes"]) != n_views:
                raise ArgumentError(f"sizes must go with fov_bounds, one of each per view ({n_views}).")
        self._check_values(arrays)
        for name, values in arrays.items():
            object.__setattr__(self, name, readonly_copy(values))

    def _read_positions(self) -> dict[str, FloatArray]:
        """Return azimuth, elevation, distance and roll, (k,) each, and the target, as float64."""
        given = {"azimuth": self.azimuth, "elevation": self.elevation, "distance": self.distance, "target": self.target}
        try:
            *angles, target, roll = (_as_floats(values) for values in (*given.values(), self.roll))
            angles.append(roll)
        except (TypeError, ValueError, OverflowError, RuntimeError) as error:  # the last of a tensor with a gradient
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
        return {"azimuth": azimuth, "elevation": elevation, "distance": distance, "target": target, "roll": roll}

    def _check_values(self, arrays: dict[str, Any]) -> None:
        """Raise ArgumentError for values that are not finite or out of range."""
        for name, values in arrays.items():
            if not (np.abs(values) <= LARGEST).all():  # False for NaN
                worst = values[~(np.abs(values) <= LARGEST)][0]
                raise ArgumentError(f"{name} must be finite and below {LARGEST:g}; got {worst}.")
        if (rotations := arrays.get("rotations")) is not None and len(rotations):
            off = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
            if (wrong := (off > ROTATION_TOLERANCE) | (np.linalg.det(rotations) < 0.0)).any():
                raise ArgumentError(
                    f"rotations must be rotations, without scale or reflection; {wrong.argmax()} is not."
                )
        elevation, distance = arrays["elevation"], arrays["distance"]
        if (np.abs(elevation) > np.pi / 2 + 1e-9).any():
            worst = np.degrees(elevation[np.abs(elevation).argmax()])
            raise ArgumentError(f"elevation must lie in [-pi/2, pi/2]; got {worst:g} degrees. Give radians.")
        if (distance <= 0 if self.rotations is None else distance < 0).any():
            raise ArgumentError(f"distance must be positive; got {distance.min():g}.")

    def __len__(self) -> int:
        return len(self.azimuth)

    def __repr__(self) -> str:
        about = ", ".join(f"{x:g}" for x in np.asarray(self.target))
        return f"Views({len(self)} view{'s' * (len(self) != 1)} about ({about}))"

    def __getitem__(self, which: ArrayLike | slice) -> "Views":
        """Return the views that an index, a slice, a mask or an index array selects; an index gives Views of one."""
        if isinstance(which, slice | int | np.integer) or getattr(which, "ndim", 1) == 0:
            # the IndexError of an index ends an iteration
            which = np.atleast_1d(np.arange(len(self))[which])  # type: ignore[index]  # whatever NumPy takes
        return self.select(which)

    @property
    def eyes(self) -> FloatArray:
        """Centres of projection, world space, (k, 3). At the poles the position is exactly on the z axis."""
        flat = np.where(np.abs(self.elevation) >= np.pi / 2 - 1e-9, 0.0, np.cos(self.elevation))
        direction = np.stack([flat * np.cos(self.azimuth), flat * np.sin(self.azimuth), np.sin(self.elevation)], axis=1)
        return np.asarray(self.target + self.distance[:, None] * direction)

    @property
    def ups(self) -> FloatArray:
        """Unit up vectors (k, 3): the direction in which the elevation grows, at the poles too, turned by the roll."""
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
        """Return the mask (k, n) of the positions (n, 3) in each camera's field of view; all without `fov_bounds`."""
        if self.fov_bounds is None:
            return np.ones((len(self), len(positions)), dtype=bool)
        inside = np.empty((len(self), len(positions)), dtype=bool)
        for row, pose, (left, right, bottom, top) in zip(inside, self.poses, self.fov_bounds, strict=True):
            x, y, z = (positions @ pose[:3, :3].T + pose[:3, 3]).T
            row[:] = (z < 0) & (x >= left * -z) & (x <= right * -z) & (y >= bottom * -z) & (y <= top * -z)
        return inside

    def intrinsics(self, width: ArrayLike, height: ArrayLike) -> FloatArray:
        """Return K (k, 3, 3) of the cameras, pixels, y down; the upper left corner of the image is (0, 0).

        Parameters
        ----------
        width, height : int or (k,) int
            Pixels of all images, or of each.

        Raises
        ------
        ArgumentError
            The views have no `fov_bounds`.
        """
        if self.fov_bounds is None:
            raise ArgumentError("views must have a field of view; they have none. Give one: views.looking.")
        left, right, bottom, top = self.fov_bounds.T
        found = np.zeros((len(self), 3, 3))
        found[:, 0, 0], found[:, 1, 1], found[:, 2, 2] = width / (right - left), height / (top - bottom), 1.0
        found[:, 0, 2], found[:, 1, 2] = -left * found[:, 0, 0], top * found[:, 1, 1]
        return found

    def select(self, which: ArrayLike) -> "Views":
        """Return the views that a boolean mask or an index array selects, in its order."""
        chosen = as_selection(which, len(self), "views")
        given = {each.name: getattr(self, each.name) for each in fields(self)}
        per_view = {name: given[name] for name in given if name != "target" and given[name] is not None}
        return replace(self, **{name: values[chosen] for name, values in per_view.items()})

    def around(self, centre: ArrayLike, scale: float) -> "Views":
        """Return the views about another target, with all distances multiplied by `scale`.

        ``views.around(mesh.centre, mesh.longest_side)`` converts distances in longest sides to world units. Cameras
        with `rotations` keep their positions; their angles and distances become those about the new target.
        """
        target = np.asarray(centre, dtype=np.float64)
        if self.rotations is not None:
            return Views.from_cameras(self.eyes, self.rotations, self.fov_bounds, target, self.sizes)
        return replace(self, distance=self.distance * scale, target=target)

    def looking(self, at: ArrayLike | None = None, field_of_view: float | None = None) -> "Views":
        """Return the views turned to look at a point (3,), with a square field of view in radians."""
        rotations, fov_bounds, sizes = self.rotations, self.fov_bounds, self.sizes
        if at is not None:
            rotations = view_matrices(self.eyes, as_vector(at, "at"), self.ups)[:, :3, :3]
        if field_of_view is not None:
            side, sizes = np.tan(field_of_view / 2), None
            fov_bounds = np.tile([-side, side, -side, side], (len(self), 1))
        return replace(self, rotations=rotations, fov_bounds=fov_bounds, sizes=sizes)

    @classmethod
    def from_cameras(
        cls,
        eyes: FloatArray,
        rotations: FloatArray,
        fov_bounds: FloatArray | None = None,
        target: ArrayLike = (0, 0, 0),
        sizes: IntArray | None = None,
    ) -> "Views":
        """Return the views of cameras at `eyes` (k, 3), world space, with `rotations` (k, 3, 3) to eye space."""
        target = np.asarray(target, dtype=np.float64)
        offsets = eyes - target
        distance = np.linalg.norm(offsets, axis=1)
        azimuth = np.arctan2(offsets[:, 1], offsets[:, 0])
        elevation = np.arctan2(offsets[:, 2], np.hypot(offsets[:, 0], offsets[:, 1]))
        return cls(azimuth, elevation, distance, target, 0.0, rotations, fov_bounds, sizes)

    def to_rows(self) -> FloatArray:
        """Return views about the origin as rows: azimuth, elevation, distance[, roll[, rotation[, ...]]]."""
        columns = [self.azimuth[:, None], self.elevation[:, None], self.distance[:, None]]
        if np.any(self.roll) or self.rotations is not None:
            columns.append(np.asarray(self.roll)[:, None])
        if self.rotations is not None:
            columns.append(self.rotations.reshape(-1, 9))
            if self.fov_bounds is not None:
                columns.append(self.fov_bounds)
            if self.sizes is not None:
                columns.append(self.sizes.astype(np.float64))
        return np.concatenate(columns, axis=1)

    @classmethod
    def from_rows(cls, rows: ArrayLike) -> "Views":
        """Return the views that `to_rows` described."""
        rows = np.asarray(rows, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] not in (3, 4, 13, 17, 19):
            raise ArgumentError(f"rows of views must have 3, 4, 13, 17 or 19 columns; got {rows.shape}.")
        azimuth, elevation, distance = rows[:, :3].T
        roll = rows[:, 3] if rows.shape[1] > 3 else 0.0
        rotations = rows[:, 4:13].reshape(-1, 3, 3) if rows.shape[1] > 4 else None
        fov_bounds = rows[:, 13:17] if rows.shape[1] > 13 else None
        sizes = rows[:, 17:].astype(np.int32) if rows.shape[1] > 17 else None
        return cls(azimuth, elevation, distance, roll=roll, rotations=rotations, fov_bounds=fov_bounds, sizes=sizes)


def check_views(name: str, value: Any) -> None:
    """Raise ArgumentError unless a value is Views."""
    if not isinstance(value, Views):
        raise ArgumentError(
            f"{name} must be Views; got {type(value).__name__}. Make some: views.for_mesh(mesh, 'ring:8@30')."
        )


def as_distance(value: float) -> float:
    """Return a distance of an eye from its target, longest sides; raise ArgumentError unless it is above 0."""
    return as_number(value, "distance", "a positive number", lambda number: number > 0.0)


def _as_floats(values: ArrayLike) -> FloatArray:
    """Return numbers as float64; raise TypeError for bools, texts and complex numbers."""
    array = np.asarray(values)
    if array.size and array.dtype.kind not in "fiu":
        raise TypeError(f"got {array.dtype}")
    return array.astype(np.float64)
