"""Documents that users write: YAML, JSON and CSV, read within bounds, and the numbers, words and flags in them."""

import csv
import io
import json
import reprlib
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice, zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.arrays import LARGEST, FloatArray
from zbuf_occlude.errors import OptionError, in_words, printable

MOST_BYTES, MOST_ROWS = {"JSON": 25_000_000, "YAML": 200_000, "CSV": 48_000_000}, 1_000_000
"""Of a document. More would take a gigabyte or, of YAML, seconds."""
LONGEST_LINE = 1000
"""Characters of a name, a source, a path."""


@dataclass(frozen=True)
class Number:
    """What a number of a document, or an array of numbers, may be.

    Parameters
    ----------
    low, high : float
        Bounds of each number, themselves allowed. Without them it must be finite.
    unit : str
    shapes : tuple of shapes
        Those allowed; () is one number, -1 any length. Rows may be written one after the other where a shape is fixed.
    whole : bool
    least : float
        How far from 0 a number must be that is not 0.
    """

    low: float = -LARGEST
    high: float = LARGEST
    unit: str = ""
    shapes: tuple[tuple[int, ...], ...] = ((),)
    whole: bool = False
    least: float = 0.0

    def read(self, name: str, value: Any) -> Any:
        """Return a value as an int or a float, several as (nested) lists.

        A word that is a number is one (``1e5`` is a word in YAML, as is all in CSV); a bool is none.

        Raises
        ------
        OptionError
            It is none, of another shape, or out of bounds; `name` opens the message.
        """
        try:
            array = np.asarray(_floats(value, depth=3), dtype=np.float64)
            array = array.reshape(next(shape for shape in self.shapes if _fits(array, shape)))
            right = (array >= self.low) & (array <= self.high) & ((array == 0) | (np.abs(array) >= self.least))
            wrong = ~right | (self.whole & (array != np.rint(array)))
            if wrong.any():
                raise _NoNumberError(array[wrong][0].item())
        except (ValueError, StopIteration) as error:  # no number, rows of unequal length, no such shape
            culprit = error.args[0] if isinstance(error, _NoNumberError) else value
            raise OptionError(f"{name} must be {self}; got {reprlib.repr(culprit)}.") from None
        return (array.astype(np.int64) if self.whole else array).tolist()

    def __str__(self) -> str:
        noun = "whole number" if self.whole else "number"
        several = (f"{' x '.join(map(str, shape))} {noun}s" for shape in self.shapes if shape)
        forms = [f"a {noun}"] * (() in self.shapes)
        forms += [each.replace("-1 x", "rows of").removeprefix("-1 ") for each in several]
        bounds = f"from {self.low:g} to {self.high:g}" if (self.low, self.high) != (-LARGEST, LARGEST) else "finite"
        return f"{' or '.join(forms)}, {bounds} {self.unit}".rstrip()


def line(name: str, value: Any) -> str:
    """Return a value that is one line of text; raise OptionError where it is none."""
    if not isinstance(value, str) or printable(value) != value or len(value) > LONGEST_LINE:
        raise OptionError(f"{name} must be one line of at most {LONGEST_LINE} characters; got {reprlib.repr(value)}.")
    return value


def flag(name: str, value: Any) -> bool:
    """Return a bool, or one of the words true and false as one; raise OptionError for anything else."""
    found = {"true": True, "false": False}.get(str(value).lower())
    if found is None:
        raise OptionError(f"{name} must be true or false; got {reprlib.repr(value)}.")
    return found


def read_limited(path: Path) -> bytes:
    """Return the content of a document; raise OptionError where there is none, or too much."""
    most = max(MOST_BYTES.values())
    try:
        with path.open("rb") as file:
            data = file.read(most + 1)
    except (OSError, ValueError) as error:
        raise OptionError(f"a file must be readable; {printable(str(path))}: {in_words(error)}.") from None
    if len(data) > most:
        raise OptionError(f"{printable(str(path))} must have at most {most:,} bytes; it has more. Split it.")
    return data


def parse_document(form: str, data: bytes, name: str | Path) -> Any:
    """Return what a document says.

    Parameters
    ----------
    form : {"JSON", "YAML", "CSV"}
        Of YAML all scalars are words; of CSV the columns, lists of words, by the names in its first row, in lower case.
    data : bytes
    name : str or Path
        Of the document, for messages.

    Raises
    ------
    OptionError
        It is not of this form, or too large.
    """
    parsers: dict[str, Callable[[bytes], Any]] = {"JSON": json.loads, "YAML": _yaml, "CSV": _csv}
    said = f"{printable(str(name))} must be {form}"
    if len(data) > MOST_BYTES[form]:
        raise OptionError(f"{said} of at most {MOST_BYTES[form]:,} bytes; it has more. Split it.")
    try:
        return parsers[form](data)
    except Exception as error:  # what parsers raise on damaged text is not ours to list
        raise OptionError(f"{said}; it cannot be read: {' '.join(str(error).split()):.200}.") from None


def _yaml(data: bytes) -> Any:
    import yaml  # late: few bring a file

    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(data, loader)):
        raise ValueError("aliases (*name) are not read, for they multiply; write out what they stand for")
    return yaml.load(data, loader)


def _csv(data: bytes) -> dict[str, list[str]]:
    text = io.StringIO(data.decode("utf-8-sig"), newline=None)
    rows = list(islice(filter(None, csv.reader(text, skipinitialspace=True)), MOST_ROWS + 2))
    if not 1 < len(rows) < MOST_ROWS + 2:
        raise ValueError(f"it must have a row of names and 1 to {MOST_ROWS:,} below it")
    columns = islice(zip_longest(*rows, fillvalue=""), len(rows[0]))
    return {printable(name.strip().lower()): words for name, *words in columns}


class _NoNumberError(ValueError):
    """Its argument is no number."""


def _floats(value: Any, depth: int) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
        return value
    if isinstance(value, (list, tuple, np.ndarray)) and depth:
        return [_floats(each, depth - 1) for each in value]
    if isinstance(value, bool) or not isinstance(value, (str, int, float, np.number)):
        raise _NoNumberError(value)
    try:
        return float(value)
    except (ValueError, OverflowError):
        raise _NoNumberError(value) from None


def _fits(array: FloatArray, shape: tuple[int, ...]) -> bool:
    if -1 in shape or not shape:
        return array.ndim == len(shape) and array.shape[1:] == shape[1:]
    return array.squeeze().shape in (shape, (np.prod(shape),))
