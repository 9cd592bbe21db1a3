"""Sensors from a user's files: a YAML of numbers, or a CSV of directions."""

import csv
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.checks import check_word
from zbuf_occlude.errors import ArgumentError, OptionError, in_words
from zbuf_occlude.sensors.model import Imperfections
from zbuf_occlude.sensors.rays import KINDS, numbers_of
from zbuf_occlude.sensors.table import Row

SUFFIXES = (".yaml", ".yml", ".csv")
ANGLES, VECTORS = ("azimuth", "elevation"), ("x", "y", "z")


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
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise OptionError(f"a sensor's file must be readable; {path}: {in_words(error)}.") from None
    return _of_csv(path, text) if path.suffix.lower() == ".csv" else _of_yaml(path, text)


def _of_yaml(path: Path, text: str) -> Row:
    import yaml  # late: few bring a file

    try:
        document = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # ValueError: of a date that is none
        raise OptionError(f"{path} must be YAML; {' '.join(str(error).split())}.") from None
    if not isinstance(document, dict) or "kind" not in document:
        raise OptionError(f"{path} must have a line `kind:` and a sensor's numbers; see docs/sensors.md.")
    given: dict[str, Any] = {str(name): value for name, value in document.items()}
    kind, source = str(given.pop("kind")), str(given.pop("source", path.name))
    name, summary = str(given.pop("name", path.stem)), str(given.pop("summary", f"from {path.name}"))
    check_word(f"kind in {path}", kind, KINDS)
    for number in given:
        check_word(f"a number in {path}", number, [*numbers_of(kind), *(each.name for each in fields(Imperfections))])
    row = Row(name, kind, summary, {number: (value, source) for number, value in given.items()})
    try:
        row.sensor().rays()
    except TypeError as error:  # a number is none
        raise OptionError(f"{path} must hold the numbers of a {kind} sensor; {error}. See docs/sensors.md.") from None
    except (ArgumentError, OptionError) as error:
        raise OptionError(f"{path}: {error}") from None
    return row


def _of_csv(path: Path, text: str) -> Row:
    rows = list(csv.DictReader(text.splitlines(), skipinitialspace=True))
    columns = set(rows[0]) if rows else set()
    wanted = next((names for names in (ANGLES, VECTORS) if set(names) <= columns), None)
    if wanted is None:
        found = ", ".join(map(str, rows[0])) if rows else "no rows"
        raise OptionError(f"{path} must have the columns azimuth,elevation or x,y,z[,ring] and a row; found: {found}.")
    try:
        table = np.array([[float(row[name]) for name in wanted] for row in rows])
        rings = np.array([int(row.get("ring") or 0) for row in rows])
    except (TypeError, ValueError) as error:
        raise OptionError(f"{path} must hold numbers, angles in degrees; {error}.") from None
    if wanted is ANGLES:
        azimuth, elevation = np.radians(table.T)
        flat = np.cos(elevation)
        table = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=1)
    row = Row(path.stem, "list", f"from {path.name}", {"directions": (table, path.name), "rings": (rings, path.name)})
    try:
        row.sensor().rays()
    except (ArgumentError, OptionError) as error:
        raise OptionError(f"{path}: {error}") from None
    return row
