"""Sensors: LiDARs and depth cameras, their rays and noise, and scans and frames of scenes.

sensors.SENSORS                          the table, every number with its source
sensors.make("vlp-32c", columns=1800)    one of them, with some numbers changed
sensors.make("mine.yaml")                a sensor from a file
sensors.read_intrinsics("camera.json")   width, height, f, fy, cx, cy of a camera's file
sensor.rays()                            rays in the sensor's frame: x forward, y left, z up
"""

from zbuf_occlude.sensors.bop import write_bop
from zbuf_occlude.sensors.camera_files import read_intrinsics
from zbuf_occlude.sensors.catalog import SENSORS, make
from zbuf_occlude.sensors.drives import DriveSweep, scan_drive
from zbuf_occlude.sensors.frames import Frame, frames, write_frames
from zbuf_occlude.sensors.motion import Motion, read_trajectory
from zbuf_occlude.sensors.poses import look_at
from zbuf_occlude.sensors.rays import Rays
from zbuf_occlude.sensors.returns import Scan
from zbuf_occlude.sensors.rigs import Mounted, Rig, mount_pose, read_rig
from zbuf_occlude.sensors.scanning import scan
from zbuf_occlude.sensors.sensor import NoiseModel, Sensor

__all__ = [
    "SENSORS",
    "DriveSweep",
    "Frame",
    "Motion",
    "Mounted",
    "NoiseModel",
    "Rays",
    "Rig",
    "Scan",
    "Sensor",
    "frames",
    "look_at",
    "make",
    "mount_pose",
    "read_intrinsics",
    "read_rig",
    "read_trajectory",
    "scan",
    "scan_drive",
    "write_bop",
    "write_frames",
]


def __dir__() -> list[str]:
    return list(__all__)
