"""Sensors by name, and from a user's files: a YAML of numbers, or a CSV of directions."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.checks import check_word
from zbuf_occlude.documents import Number, line, parse, read_bytes
from zbuf_occlude.errors import OccludeError, OptionError, printable
from zbuf_occlude.sensors.model import Imperfections, Sensor
from zbuf_occlude.sensors.rays import KINDS, numbers_of
from zbuf_occlude.sensors.table import ROWS, Row

SUFFIXES = (".yaml", ".yml", ".csv")
ANGLES, VECTORS = ("azimuth", "elevation"), ("x", "y", "z")
_ANGLE, _LENGTH = Number(-3600.0, 3600.0, "degrees", ((-1,),)), Number(shapes=((-1,),))


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

    Examples
    --------
    >>> zo.sensors.make("hdl-64e", columns=900).name
    'hdl-64e'
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


def read_sensor(path: Path) -> Row:
    """Read a sensor's row from a file.

    Parameters
    ----------
    path : Path
        A YAML with ``kind`` and the numbers of a row, and, if you like, ``name``, ``summary`` and ``source`` (one for
        all); or a CSV with the columns azimuth, elevation (degrees) or x, y, z, and, if you like, ring.

    Raises
    ------
    OptionError
        Not readable, or not what it should be; the message says what.
    """
    row = (_of_csv if path.suffix.lower() == ".csv" else _of_yaml)(path, read_bytes(path))
    try:
        row.sensor().rays()
    except OccludeError as error:
        raise OptionError(f"{printable(str(path))}: {error}") from None
    return row


def _of_yaml(path: Path, data: bytes) -> Row:
    given, where = parse("YAML", data, path), printable(str(path))
    if not isinstance(given, dict) or "kind" not in given:
        raise OptionError(f"{where} must have a line `kind:` and a sensor's numbers; see docs/sensors.md.")
    told = {"kind": "", "name": path.stem, "summary": f"from {path.name}", "source": path.name}
    told = {name: line(f"{name} in {where}", given.pop(name, default)) for name, default in told.items()}
    check_word(f"kind in {where}", told["kind"], KINDS)
    known = [*numbers_of(told["kind"]), *(each.name for each in fields(Imperfections))]
    for name in given:
        check_word(f"a number in {where}", name, known)
    numbers = {name: (value, told["source"]) for name, value in given.items()}
    return Row(told["name"], told["kind"], told["summary"], numbers)


def _of_csv(path: Path, data: bytes) -> Row:
    columns, where = parse("CSV", data, path), printable(str(path))
    wanted = next((names for names in (ANGLES, VECTORS) if set(names) <= set(columns)), None)
    if wanted is None:
        found = ", ".join(columns)
        raise OptionError(f"{where} must have the columns azimuth,elevation or x,y,z[,ring]; found: {found:.200}.")
    kind = _ANGLE if wanted is ANGLES else _LENGTH
    table = np.array([kind.read(f"{name} in {where}", columns[name]) for name in wanted])
    if wanted is ANGLES:
        azimuth, elevation = np.radians(table)
        flat = np.cos(elevation)
        table = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    rings = [word or 0 for word in columns.get("ring", [0] * table.shape[1])]
    return Row(
        path.stem, "list", f"from {path.name}", {"directions": (table.T, path.name), "rings": (rings, path.name)}
    )
