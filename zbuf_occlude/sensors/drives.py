"""Drives: the sweeps of a rig that moves through a scene, with their poses and times."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import ArgumentError, OptionError, check_int
from zbuf_occlude.base.provenance import seed_of
from zbuf_occlude.sensors.casting import placed_at, prepare_scene
from zbuf_occlude.sensors.motion import Motion
from zbuf_occlude.sensors.noise import apply_noise
from zbuf_occlude.sensors.rays import numbers_of
from zbuf_occlude.sensors.returns import Scan
from zbuf_occlude.sensors.rigs import Mounted, Rig
from zbuf_occlude.sensors.scanning import noiseless_scan
from zbuf_occlude.sensors.scenes.scene import Scene
from zbuf_occlude.sensors.sensor import Sensor

ROUNDING = 1e-4
"""Part of a sweep that a trajectory may lack: times of files are rounded, and Unix times as float64 to 0.2 us."""


class DriveSweep(NamedTuple):
    """One sweep of each sensor of a rig."""

    number: int
    time: float
    """Seconds from the beginning of the drive."""
    pose: FloatArray
    """Pose (4, 4) of the rig at that time, in the world."""
    scene: Scene
    """The scene at that time."""
    scans: dict[str, Scan]
    """The scan of each sensor, by its name; world space, times from the beginning of the sweep."""


def sweeps_held(rig: Rig, motion: Motion) -> int | None:
    """Return how many whole sweeps of a rig fit into a trajectory; None for a constant velocity, which never ends."""
    if motion.trajectory is None:
        return None
    times = np.asarray(motion.trajectory)[:, 0]
    return int((times[-1] - times[0]) / rig.period + ROUNDING)


def scan_drive(
    scene: Scene, rig: Rig, motion: Motion, n_sweeps: int, *, seed: int = 0, method: str = "exact"
) -> Iterator[DriveSweep]:
    """Scan a scene sweep by sweep from a rig that moves through it.

    Parameters
    ----------
    scene : Scene
        World space, metres. Its moving objects move on from sweep to sweep.
    rig : Rig
        All sensors begin their sweeps together, each `Rig.period` seconds.
    motion : Motion
        Motion of the rig: a trajectory of its poses in the world, or a constant velocity from the origin on. With
        `Motion.deskew`, points are where the rays met the scene. Otherwise they are as the sensors report them, as if
        the rig had stood still at `DriveSweep.pose`.
    n_sweeps : int
    seed : int
    method : str
        Ray caster.

    Yields
    ------
    DriveSweep

    Raises
    ------
    ArgumentError, OptionError
        A motion that has a mount or a beginning; more sweeps than a trajectory holds.

    Examples
    --------
    >>> top = zo.sensors.Mounted("top", zo.sensors.make("vlp-16"), zo.sensors.mount_pose((0, 0, 1.7)))
    >>> rig, motion = zo.sensors.Rig([top]), zo.sensors.Motion(velocity=(10.0, 0.0, 0.0), deskew=True)
    >>> [sweep.time for sweep in zo.sensors.scan_drive(zo.Scene.from_mesh("chair.off"), rig, motion, 2)]
    [0.0, 0.1]
    """
    if motion.begin or motion.mount is not None:
        raise ArgumentError("motion of a rig must have no begin and no mount; the rig has the mounts. Leave them out.")
    check_int("n_sweeps", n_sweeps, 1)
    held = sweeps_held(rig, motion)
    if held == 0:
        raise OptionError(f"the trajectory must last a sweep of {rig.period:g} s; it is shorter. Give a longer one.")
    if held is not None and n_sweeps > held:
        raise OptionError(
            f"the trajectory holds {held} whole sweeps of {rig.period:g} s; {n_sweeps} were asked for. Give fewer "
            "sweeps, or a longer trajectory."
        )
    return _sweeps(scene, rig, motion, n_sweeps, seed, method)


def _sweeps(scene: Scene, rig: Rig, motion: Motion, n_sweeps: int, seed: int, method: str) -> Iterator[DriveSweep]:
    occluder = prepare_scene(scene, method)
    try:
        for number in range(n_sweeps):
            time, now = number * rig.period, scene
            if scene.moving and number:
                occluder.close()
                now = replace(Scene.joined([placed_at(each, time) for each in scene.placed]), albedos=scene.albedos)
                occluder = prepare_scene(now, method)
            rotations, positions = motion.poses(np.array([time]))
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = rotations[0], positions[0]
            pose = motion.start() @ pose
            scans = {}
            for each in rig:
                sensor, mine = _at(each, time), pose @ each.pose
                moving = replace(motion, begin=time, mount=each.pose) if not sensor.no_motion_reason else None
                returns = noiseless_scan(
                    now, sensor, mine[:3, :3], mine[:3, 3], motion=moving, method=method, occluder=occluder
                )
                scans[each.name] = apply_noise(
                    returns, sensor, np.random.default_rng(seed_of(seed, f"drive/{each.name}", number))
                )
            yield DriveSweep(number, time, pose, now, scans)
    finally:
        occluder.close()


def _at(mounted: Mounted, time: float) -> Sensor:
    """Return a sensor whose pattern has gone on for so many seconds, where patterns do not repeat."""
    sensor = mounted.sensor
    if "begin" not in numbers_of(sensor.kind):
        return sensor
    return sensor.with_numbers(begin=sensor.pattern.get("begin", 0.0) + time)
