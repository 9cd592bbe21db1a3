"""Motion of a sensor during a scan: its pose at the time of each ray."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.base.arrays import (
    FloatArray,
    as_flag,
    as_number,
    as_vector,
    set_readonly,
    shape_and_dtype,
)
from zbuf_occlude.base.documents import as_path, read_limited
from zbuf_occlude.base.errors import ArgumentError, DatasetError, describe, escape_control
from zbuf_occlude.geometry.camera import as_rigid, rotations_of, unit_quaternions
from zbuf_occlude.sensors.rays import Rays

DURATION_RATIO = 1.5
"""Ratio of the durations of trajectory and sweep above which a warning is given."""
STRAIGHT = 1e-9
"""Yaw rate below which an arc is computed as a line, radians per second."""


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of a sensor from its pose at time 0 on.

    Parameters
    ----------
    velocity : (3,) float
        Metres per second forward, to the left and up, in the sensor's own frame, which turns with the sensor.
    turn : float
        Yaw rate, degrees per second about the sensor's z axis; positive to the left.
    trajectory : (m, 8) float, optional
        Instead of both: rows of time, x, y, z, qx, qy, qz, qw, the sensor's poses in any one frame, times ascending.
        Only the motion relative to the first row counts. Between rows, positions are interpolated linearly and
        rotations along the shortest arc. Before the first row and after the last the sensor is at rest.
    deskew : bool
        True: points are where the rays met the scene. False: points are as the sensor reports them, as if at rest.
    begin : float
        Seconds into the motion at which time 0 is.
    mount : (4, 4) float, optional
        Pose of the sensor on the vehicle, to which the velocity or the trajectory then belongs.

    Raises
    ------
    ArgumentError
        A wrong shape; numbers that are not finite; times that do not ascend; a quaternion of length 0; a trajectory
        together with velocity or turn; `deskew` that is no bool; a mount that is no rigid transform.
    """

    velocity: ArrayLike = (0.0, 0.0, 0.0)
    turn: float = 0.0
    trajectory: ArrayLike | None = None
    deskew: bool = False
    begin: float = 0.0
    mount: ArrayLike | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "velocity", set_readonly(as_vector(self.velocity, "velocity")))
        as_number(self.turn, "turn", "a number, degrees a second")
        as_number(self.begin, "begin", "seconds of 0 or more", lambda seconds: seconds >= 0.0)
        if self.mount is not None:
            object.__setattr__(self, "mount", set_readonly(as_rigid(self.mount, "mount")))
        object.__setattr__(self, "deskew", as_flag(self.deskew, "deskew"))
        if self.trajectory is None:
            return
        if np.any(self.velocity) or self.turn:
            raise ArgumentError("give a trajectory, or velocity and turn, not both.")
        try:
            rows = np.asarray(self.trajectory, dtype=np.float64)
        except (TypeError, ValueError):
            rows = np.empty(0)
        if rows.ndim != 2 or rows.shape[1:] != (8,) or len(rows) < 1:
            found = shape_and_dtype(self.trajectory)
            raise ArgumentError(f"trajectory must be (m, 8) numbers: t x y z qx qy qz qw; got {found}.")
        if fault := _fault(rows):
            raise ArgumentError(f"trajectory {fault}.")
        object.__setattr__(self, "trajectory", set_readonly(rows.copy()))

    def to_dict(self) -> dict[str, Any]:
        """Return the arguments as plain data."""
        trajectory = None if self.trajectory is None else np.asarray(self.trajectory).tolist()
        velocity = np.asarray(self.velocity).tolist()
        found = {"velocity": velocity, "turn": self.turn, "trajectory": trajectory, "deskew": self.deskew}
        if self.begin:
            found["begin"] = self.begin
        if self.mount is not None:
            found["mount"] = np.asarray(self.mount).tolist()
        return found

    def duration_mismatch(self, rays: Rays) -> str:
        """Return a message where a trajectory is much longer or shorter than the sweep of these rays, else ""."""
        if self.trajectory is None or rays.times is None:
            return ""
        times, sweep = np.asarray(self.trajectory)[:, 0], float(rays.times.max(initial=0.0))
        duration = float(times[-1] - times[0])
        message = f"the trajectory lasts {duration:.3g} s, a sweep {sweep:.2g} s"
        if duration > DURATION_RATIO * sweep:
            return (
                f"{message}: one sweep is made, from its beginning. `zbuf-occlude drive` makes all "
                f"{int(duration / sweep)}"
            )
        return f"{message}: the sensor stands still at its end" if DURATION_RATIO * duration < sweep else ""

    def poses(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations (n, 3, 3) and positions (n, 3) at times (n,), in the sensor's frame at time 0."""
        if not self.begin and self.mount is None:
            return self._from_first(times)
        mount = np.eye(4) if self.mount is None else np.asarray(self.mount)
        rotations, positions = self._from_first(np.append(self.begin, self.begin + times))
        positions = rotations @ mount[:3, 3] + positions
        rotations = rotations @ mount[:3, :3]
        return rotations[0].T @ rotations[1:], (positions[1:] - positions[0]) @ rotations[0]

    def _from_first(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotations and positions of the vehicle, in its frame at the beginning of the motion."""
        if self.trajectory is not None:
            return self._along(times)
        rate, (forward, left, up) = np.radians(self.turn), np.asarray(self.velocity)
        angle = rate * times
        cosine, sine, none = np.cos(angle), np.sin(angle), np.zeros_like(times)
        rotations = np.stack([cosine, -sine, none, sine, cosine, none, none, none, none + 1.0], axis=1)
        along, across = times, 0.5 * rate * times**2
        if abs(rate) > STRAIGHT:
            along, across = sine / rate, (1.0 - cosine) / rate
        positions = np.stack([forward * along - left * across, forward * across + left * along, up * times], axis=1)
        return rotations.reshape(-1, 3, 3), positions

    def _along(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        rows = np.asarray(self.trajectory)
        at, points, turned = rows[:, 0] - rows[0, 0], rows[:, 1:4], unit_quaternions(rows[:, 4:])
        where = np.clip(np.searchsorted(at, times, side="right") - 1, 0, max(len(at) - 2, 0))
        after = np.minimum(where + 1, len(at) - 1)
        share = np.clip((times - at[where]) / np.maximum(at[after] - at[where], 1e-300), 0.0, 1.0)[:, None]
        positions = points[where] * (1.0 - share) + points[after] * share
        first, last = turned[where], turned[after]
        cosine = np.einsum("ij,ij->i", first, last)[:, None]
        last, cosine = np.where(cosine < 0.0, -last, last), np.minimum(np.abs(cosine), 1.0)
        angle = np.arccos(cosine)
        sine = np.where(angle < 1e-9, 1.0, np.sin(angle))
        weights = (
            np.where(angle < 1e-9, 1.0 - share, np.sin((1.0 - share) * angle) / sine),
            np.where(angle < 1e-9, share, np.sin(share * angle) / sine),
        )
        quaternions = np.concatenate([turned[:1], weights[0] * first + weights[1] * last])
        rotations = rotations_of(unit_quaternions(quaternions))
        return np.asarray(rotations[0].T @ rotations[1:]), np.asarray((positions - points[0]) @ rotations[0])

    def applied(self, rays: Rays) -> Rays:
        """Return the rays of the moving sensor, in its frame at time 0."""
        rotations, positions = self.poses(np.zeros(len(rays)) if rays.times is None else rays.times)
        directions = np.einsum("nij,nj->ni", rotations, rays.directions)
        if rays.origins is not None:
            positions = positions + np.einsum("nij,nj->ni", rotations, rays.origins)
        return Rays(directions, rays.rings, rays.columns, positions, rays.times)

    def start(self) -> FloatArray:
        """Return the pose (4, 4) of the vehicle at the beginning: the trajectory's first row, else the identity."""
        pose = np.eye(4)
        if self.trajectory is not None:
            first = np.asarray(self.trajectory)[0]
            pose[:3, :3], pose[:3, 3] = rotations_of(unit_quaternions(first[4:])), first[1:4]
        return pose


def _fault(rows: FloatArray) -> str:
    """Return what is wrong with the first bad row of a trajectory (m, 8), or ""."""
    for bad, must in (
        (~np.isfinite(rows).all(axis=1), "be finite numbers"),
        (np.append(False, np.diff(rows[:, 0]) <= 0.0), "have a later time than the row before"),
        (np.abs(rows[:, 4:]).max(axis=1) <= 1e-9, "have a quaternion qx qy qz qw of length 1"),
    ):
        if bad.any():
            row = int(bad.argmax())
            return f"row {row + 1} must {must}; got {' '.join(f'{number:g}' for number in rows[row])}"
    return ""


def _row(line: str) -> list[float]:
    """Return the numbers of a line; raise ValueError where they are not eight."""
    with suppress(ValueError):
        if len(numbers := [float(word) for word in line.split()]) == 8:
            return numbers
    raise ValueError(f"each line must be t x y z qx qy qz qw, eight numbers with spaces between; one is {line[:80]!r}")


def read_trajectory(path: str | Path) -> FloatArray:
    """Read a trajectory (m, 8) in the format of the TUM benchmark: lines of t x y z qx qy qz qw; # begins a comment.

    Raises
    ------
    DatasetError
        The file cannot be read, or is not what `Motion` takes.

    Examples
    --------
    >>> np.savetxt("drive.txt", [[0, 0, 0, 0, 0, 0, 0, 1], [1, 15, 0, 0, 0, 0, 0, 1]])  # 15 m forward in a second
    >>> zo.sensors.read_trajectory("drive.txt").shape
    (2, 8)
    """
    path = as_path(path, "path")
    name = escape_control(str(path))
    try:
        lines = read_limited(path).decode("utf-8", "replace").splitlines()
        rows = [_row(line) for line in lines if line.strip() and line.strip()[0] != "#"]
        if not rows:
            raise ValueError("it must have lines of t x y z qx qy qz qw; it has none")
        found = np.array(rows)
        if fault := _fault(found):
            raise ValueError(fault)
        return found
    except (OSError, ValueError) as error:
        raise DatasetError(f"{name}: cannot read a trajectory: {escape_control(describe(error))}") from None
