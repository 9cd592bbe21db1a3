"""Sensors: where their rays go, what they get wrong, and scans of scenes by them.

sensors.SENSORS                          the table, every number with its source
sensors.make("vlp-32c", columns=1800)    one of them, some numbers changed
sensors.make("mine.yaml")                a user's own
sensor.rays()                            directions in the sensor's frame: x forward, y left, z up
"""

from zbuf_occlude.sensors.bop import write_bop
from zbuf_occlude.sensors.catalog import SENSORS, make
from zbuf_occlude.sensors.frames import Frame, frames, write_frames
from zbuf_occlude.sensors.motion import Motion, read_trajectory
from zbuf_occlude.sensors.scanning import Scan, look_at, scan
from zbuf_occlude.sensors.sensor import NoiseModel, Rays, Sensor

__all__ = [
    "SENSORS",
    "Frame",
    "Motion",
    "NoiseModel",
    "Rays",
    "Scan",
    "Sensor",
    "frames",
    "look_at",
    "make",
    "read_trajectory",
    "scan",
    "write_bop",
    "write_frames",
]


def __dir__() -> list[str]:
    return list(__all__)
