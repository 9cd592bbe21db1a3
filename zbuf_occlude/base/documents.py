"""Documents of users, YAML, JSON and CSV, read within size limits; parsers of their numbers, words and flags."""

import csv
import io
import json
import os
import reprlib
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice, zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.base.arrays import LARGEST, FloatArray
from zbuf_occlude.base.errors import ArgumentError, OptionError, describe, escape_control, shown

MAX_BYTES = {"JSON": 25_000_000, "YAML": 200_000, "CSV": 48_000_000}
MAX_ROWS, MAX_COLUMNS, MAX_CELLS = 1_000_000, 1_000, 8_000_000
"""Limits of a document. Larger ones would take a gigabyte or, for YAML, seconds."""
MAX_LINE_LENGTH = 1000
"""Maximum characters of a name, a source, a path."""


class Columns(dict[str, list[str]]):
    """Columns of a CSV file by name, and the last line of each row in the file, from 1."""

    lines: list[int]


@dataclass(frozen=True)
class Number:
    """Constraints on a number, or an array of numbers, in a document.

    Parameters
    ----------
    low, high : float
        Inclusive bounds of each number. By default it must be finite.
    unit : str
    shapes : tuple of shapes
        Allowed shapes; () is one number, -1 any length. An array of fixed shape may be written flat.
    whole : bool
    least : float
        Smallest absolute value of a number that is not 0.
    """

    low: float = -LARGEST
    high: float = LARGEST
    unit: str = ""
    shapes: tuple[tuple[int, ...], ...] = ((),)
    whole: bool = False
    least: float = 0.0

    def read(self, name: str, value: Any) -> Any:
        """Return a value as an int or a float, an array as (nested) lists.

        A str that spells a number counts as the number (``1e5`` is a str in YAML, as is every value of CSV). A bool is
        not a number.

        Raises
        ------
        OptionError
            The value is not a number, has another shape, or is out of bounds; `name` starts the message.
        """
        try:
            array = np.asarray(_floats(value, depth=3), dtype=np.float64)
            array = array.reshape(next(shape for shape in self.shapes if _fits(array, shape)))
            right = (array >= self.low) & (array <= self.high) & ((array == 0) | (np.abs(array) >= self.least))
            wrong = ~right | (self.whole & (array != np.rint(array)))
            if wrong.any():
                raise _NoNumberError(array[wrong][0].item())
        except (ValueError, StopIteration) as error:  # not a number, rows of unequal length, another shape
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


def parse_line(name: str, value: Any) -> str:
    """Return a value that is one line of text; raise OptionError if it is not."""
    if not isinstance(value, str) or escape_control(value) != value or len(value) > MAX_LINE_LENGTH:
        raise OptionError(f"{name} must be a line of at most {MAX_LINE_LENGTH} characters; got {reprlib.repr(value)}.")
    return value


def parse_bool(name: str, value: Any) -> bool:
    """Return a bool, or the bool that the word true or false spells; raise OptionError for anything else."""
    found = {"true": True, "false": False}.get(str(value).lower())
    if found is None:
        raise OptionError(f"{name} must be true or false; got {reprlib.repr(value)}.")
    return found


def as_path(value: Any, name: str, remedy: str = "Pass a str or a pathlib.Path.") -> Path:
    """Return a path; raise ArgumentError for anything else."""
    if not isinstance(value, str | os.PathLike) or isinstance(os.fspath(value), bytes):
        raise ArgumentError(f"{name} must be a path; got {shown(value)}. {remedy}")
    return Path(value)


def as_new_path(value: Any, name: str) -> Path:
    """Return a path to write to; raise ArgumentError for anything else, and for a name that no file can have."""
    path = as_path(value, name)
    with suppress(UnicodeEncodeError):  # a lone surrogate
        if b"\0" not in os.fsencode(path):
            return path
    raise ArgumentError(f"{name} must be a name that a file can have; got {shown(value)}.")


def read_limited(path: str | os.PathLike[str]) -> bytes:
    """Return the content of a document; raise OptionError if it cannot be read or is too large."""
    path = as_path(path, "path")
    most = max(MAX_BYTES.values())
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):  # reading a pipe may never end
            raise ValueError("it must be a file, and is a device or a pipe; copy it into a file")
        with path.open("rb") as file:
            data = file.read(most + 1)
    except (OSError, ValueError) as error:
        raise OptionError(f"a file must be readable; {escape_control(str(path))}: {describe(error)}.") from None
    if len(data) > most:
        raise OptionError(f"{escape_control(str(path))} must have at most {most:,} bytes; it has more. Split it.")
    return data


def parse_document(form: str, data: bytes, name: str | Path) -> Any:
    """Return the parsed content of a document.

    Parameters
    ----------
    form : {"JSON", "YAML", "CSV"}
        All scalars of YAML are str. CSV gives its columns, lists of str, by the names in its first row, in lower case.
    data : bytes
    name : str or Path
        Name of the document in messages.

    Raises
    ------
    OptionError
        The document is not of this form, or too large.
    """
    parsers: dict[str, Callable[[bytes], Any]] = {"JSON": _json, "YAML": _yaml, "CSV": _csv}
    said = f"{escape_control(str(name))} must be {form}"
    if len(data) > MAX_BYTES[form]:
        raise OptionError(f"{said} of at most {MAX_BYTES[form]:,} bytes; it has more. Split it.")
    try:
        return parsers[form](data)
    except Exception as error:  # parsers may raise any exception on damaged text
        reason = " ".join(str(error).split()) or type(error).__name__
        raise OptionError(f"{said}; it cannot be read: {reason:.200}.") from None


def _yaml(data: bytes) -> Any:
    import yaml  # late: few runs read YAML

    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(data, loader)):
        raise ValueError("aliases (*name) are not supported, because they can expand to any size; write them out")

    def construct_mapping(self: Any, node: Any, deep: bool = False) -> Any:
        _check_distinct([key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)])
        return loader.construct_mapping(self, node, deep)

    return yaml.load(data, type("Loader", (loader,), {"construct_mapping": construct_mapping}))


def _json(data: bytes) -> Any:
    def distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            _check_distinct([name for name, _ in pairs])
        return found

    return json.loads(data, object_pairs_hook=distinct)


def _csv(data: bytes) -> Columns:
    text = io.StringIO(data.decode("utf-8-sig"), newline=None)
    if next(filter(str.strip, text), "").count(",") >= MAX_COLUMNS:  # before parsing
        raise ValueError(f"it must have at most {MAX_COLUMNS:,} columns")
    text.seek(0)
    reader = csv.reader(text, skipinitialspace=True)
    names = [escape_control(name.strip().lower()) for name in next(filter(None, reader), [])]
    _check_distinct(list(filter(None, names)))
    most = min(MAX_ROWS, MAX_CELLS // max(len(names), 1))
    rows, lines = list[list[str]](), list[int]()
    for row in islice(filter(None, reader), most + 1):
        rows.append(row[: len(names)])
        lines.append(reader.line_num)
    if not 0 < len(rows) <= most:
        raise ValueError(f"it must have a row of names and 1 to {most:,} below it")
    found = Columns({name: words for name, *words in zip_longest(names, *rows, fillvalue="")})
    found.lines = lines
    return found


def _check_distinct(names: Sequence[str]) -> None:
    """Raise ValueError if a name occurs twice: one of its values would be lost."""
    for name, times in Counter(names).items():
        if times > 1:
            raise ValueError(f"{escape_control(name):.80} occurs {times} times; keep one")


class _NoNumberError(ValueError):
    """Error of a value that is not a number; the value is its argument."""


def _floats(value: Any, depth: int) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
        return value
    if isinstance(value, (list, tuple, np.ndarray)) and depth:
        return [_floats(each, depth - 1) for each in value]
    if isinstance(value, bool) or not isinstance(value, (str, int, float, np.integer, np.floating)):
        raise _NoNumberError(value)
    try:
        return float(value)
    except (ValueError, OverflowError):
        raise _NoNumberError(value) from None


def _fits(array: FloatArray, shape: tuple[int, ...]) -> bool:
    if -1 in shape or not shape:
        return array.ndim == len(shape) and array.shape[1:] == shape[1:]
    return array.squeeze().shape in (shape, (np.prod(shape),))
