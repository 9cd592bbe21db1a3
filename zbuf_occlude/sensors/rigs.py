"""Rigs: sensors with their poses on a vehicle, from a YAML file."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.documents import Number, as_path, parse_document, parse_line, read_limited
from zbuf_occlude.base.errors import OptionError, check_choice, escape_control
from zbuf_occlude.sensors.catalog import SUFFIXES, make
from zbuf_occlude.sensors.sensor import Sensor

FORM = "sensors: [{name: top, sensor: hdl-64e, position: [0, 0, 1.73]}, ...]"
HEIGHT = 1.73
"""Default height of a sensor above the rig's origin, metres: the HDL-64E on KITTI's car."""
PERIOD = 0.1
"""Seconds of a sweep of a rig whose sensors all cast their rays at once; assumed."""
_ANGLES = dict.fromkeys(("yaw", "pitch", "roll"), Number(-360.0, 360.0, "degrees"))
_POSITION = Number(-1e3, 1e3, "metres", ((3,),))


class Mounted(NamedTuple):
    """A sensor on a rig, and its pose (4, 4) in the rig's frame: x forward, y left, z up, metres."""

    name: str
    sensor: Sensor
    pose: FloatArray


class Rig(tuple[Mounted, ...]):
    """Sensors that move together; the first one is the reference of sequences."""

    @property
    def period(self) -> float:
        """Seconds from one sweep to the next: the longest duration among the sensors."""
        return max(each.sensor.duration for each in self) or PERIOD


def single_rig(sensor: Sensor, height: float = HEIGHT) -> Rig:
    """Return a rig of one sensor, level, `height` metres above its origin."""
    return Rig([Mounted("lidar", sensor, mount_pose((0.0, 0.0, height)))])


def mount_pose(position: Any, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> FloatArray:
    """Return the pose (4, 4) of a sensor that is rolled, then pitched, then turned about the rig's axes, degrees.

    A positive yaw turns it to the left, a positive pitch downwards, a positive roll to the right.

    Examples
    --------
    >>> zo.sensors.mount_pose((0.5, 0.0, 1.7), yaw=90)[:3, 0].round(3).tolist()  # where it looks: to the left
    [0.0, 1.0, 0.0]
    """
    (a, b, c), pose = np.radians([yaw, pitch, roll]), np.eye(4)
    turn = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
    tilt = np.array([[np.cos(b), 0.0, np.sin(b)], [0.0, 1.0, 0.0], [-np.sin(b), 0.0, np.cos(b)]])
    lean = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(c), -np.sin(c)], [0.0, np.sin(c), np.cos(c)]])
    pose[:3, :3], pose[:3, 3] = turn @ tilt @ lean, position
    return pose


def read_rig(path: str | Path) -> Rig:
    """Read a rig from a YAML file.

    Parameters
    ----------
    path : str or Path
        ``sensors``, a list of mappings: ``sensor``, a name of the table or a file beside this one; optionally ``name``
        (by default the sensor's), ``position``, metres forward, left and up from the rig's origin (by default
        `HEIGHT` above it), ``yaw``, ``pitch`` and ``roll``, degrees, as of `mount_pose`.

    Raises
    ------
    OptionError
        The file cannot be read, or is no rig; the message says what is wrong.

    Examples
    --------
    >>> from pathlib import Path
    >>> written = Path("rig.yaml").write_text("sensors: [{name: top, sensor: vlp-16}]")
    >>> zo.sensors.read_rig("rig.yaml")[0].name
    'top'
    """
    path = as_path(path, "path")
    where, document = escape_control(str(path)), parse_document("YAML", read_limited(path), path)
    given = document.get("sensors") if isinstance(document, dict) and set(document) == {"sensors"} else None
    if not isinstance(given, list) or not given:
        raise OptionError(f"{where} must be {FORM}; it has no list of sensors alone. See docs/drives.md.")
    rig = Rig(_mounted(each, path.parent, f"sensor {number} of {where}") for number, each in enumerate(given, 1))
    names = [each.name for each in rig]
    if twice := [name for name in names if names.count(name) > 1]:
        raise OptionError(f"{where} must have each name once; {twice[0]!r} is there twice. Give `name:`.")
    return rig


def _mounted(given: Any, folder: Path, where: str) -> Mounted:
    if not isinstance(given, dict) or "sensor" not in given:
        raise OptionError(f"{where} must have `sensor:`, a name or a file; the form is {FORM}.")
    for key in given:
        check_choice(f"a key of {where}", key, ("name", "sensor", "position", *_ANGLES))
    kind = parse_line(f"sensor of {where}", given["sensor"])
    sensor = make(folder / kind if Path(kind).suffix.lower() in SUFFIXES else kind)
    name = parse_line(f"name of {where}", given.get("name", sensor.name))
    angles = {key: number.read(f"{key} of {where}", given.get(key, 0.0)) for key, number in _ANGLES.items()}
    position = _POSITION.read(f"position of {where}", given.get("position", (0.0, 0.0, HEIGHT)))
    return Mounted(name, sensor, mount_pose(position, **angles))
