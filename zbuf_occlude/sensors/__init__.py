"""Sensors: where their rays go, what they get wrong, and scans of scenes by them.

sensors.SENSORS                          the table, every number with its source
sensors.make("vlp-32c", columns=1800)    one of them, some numbers changed
sensors.make("mine.yaml")                a user's own
sensor.rays()                            directions in the sensor's frame: x forward, y left, z up
"""

from pathlib import Path
from typing import Any

from zbuf_occlude.errors import OptionError, check_word
from zbuf_occlude.sensors.catalog import ROWS, SUFFIXES, read_sensor
from zbuf_occlude.sensors.scanning import Scan, look_at, scan
from zbuf_occlude.sensors.sensor import Imperfections, Rays, Sensor

__all__ = ["SENSORS", "Imperfections", "Rays", "Scan", "Sensor", "look_at", "make", "scan"]

SENSORS: dict[str, Sensor] = {row.name: row.sensor() for row in ROWS}
"""Every sensor of the table by name."""


def make(name: str | Path, **numbers: Any) -> Sensor:
    """Return a sensor.

    Parameters
    ----------
    name : str or Path
        A name of the table, a YAML or CSV file, or a name with numbers as they are typed at a command line:
        ``pinhole:width=320,height=240,fov=60``.
    **numbers
        To be changed, such as ``columns=900`` or ``noise=0`` (which switches all imperfections off).

    Raises
    ------
    OptionError
        No such sensor, no such number, or a value out of range.
    """
    if not isinstance(name, (str, Path)):
        raise OptionError(f"sensor must be a name or a path; got {type(name).__name__}.")
    name = str(name)
    if Path(name).suffix.lower() in SUFFIXES:
        sensor = read_sensor(Path(name)).sensor()
    else:
        name, _, typed = name.partition(":")
        check_word("sensor", name, [*SENSORS, "a .yaml or .csv file"])
        sensor = SENSORS[name]
        for setting in filter(None, typed.split(",")):
            key, equals, value = setting.partition("=")
            if not equals:
                raise OptionError(f"a sensor's numbers must be given name=value; got {setting!r}.")
            numbers = {key.strip(): value.strip(), **numbers}
    return sensor.with_numbers(**numbers) if numbers else sensor
