"""Exceptions of zbuf_occlude, all under OccludeError and each also a standard exception; checks of options.

Messages about arguments name the requirement, the given value and the remedy. Other messages state the problem.
"""

import re
import reprlib
from collections.abc import Collection, Iterable
from difflib import get_close_matches
from numbers import Integral, Real
from typing import Any, Protocol, TypeVar

_NOT_PRINTABLE = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")


def escape_control(text: str) -> str:
    """Return a text with control characters and line breaks escaped as in Python, ``\\n``, ``\\x1b``.

    Bytes of file names that are not UTF-8, which Python holds as lone surrogates, are escaped too: ``\\xff``.
    """
    return _NOT_PRINTABLE.sub(_escaped, text)


def _escaped(match: re.Match[str]) -> str:
    character = match[0]
    if "\udc80" <= character <= "\udcff":
        return f"\\x{ord(character) - 0xDC00:02x}"
    return character.encode("unicode_escape").decode()


class OccludeError(Exception):
    """Base of all exceptions of this package; control characters in its message are escaped, but not line breaks."""

    def __init__(self, *arguments: object) -> None:
        said = ("\n".join(map(escape_control, a.split("\n"))) if isinstance(a, str) else a for a in arguments)
        super().__init__(*said)


class ArgumentError(OccludeError, ValueError):
    """An array or a value passed in has the wrong shape, type or range."""


class MeshError(OccludeError, ValueError):
    """A mesh (file) cannot be used; the message names it."""


class OptionError(OccludeError, ValueError):
    """A method, an option or a specification is unknown or out of range."""


class UnavailableError(OccludeError, RuntimeError):
    """A method or feature cannot run here: a package, a library or a driver is missing."""


class GlError(OccludeError, RuntimeError):
    """No OpenGL context could be opened, or OpenGL reported an error."""


class DatasetError(OccludeError, RuntimeError):
    """A dataset folder or file is missing, damaged or of another kind."""


def shown(value: Any) -> str:
    """Return a value for a message: one line of at most sixty characters."""
    try:
        return escape_control(" ".join(reprlib.repr(value).split()))[:60]
    except Exception:  # repr of any object may fail, for example of an int of too many digits
        return f"a {type(value).__name__}"


def describe(error: Exception) -> str:
    """Return an exception's message, for an OSError without its number and file name."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


class _Row(Protocol):
    """Row of a table that is looked up by name."""

    @property
    def name(self) -> str:
        """Name of the row."""


AnyRow = TypeVar("AnyRow", bound=_Row)


def check_choice(name: str, value: Any, known: Collection[str]) -> None:
    """Raise OptionError unless a value is one of the known words."""
    if not isinstance(value, str) or value not in known:
        raise OptionError(f"{name} must be one of {', '.join(known)}; got {shown(value)}.{did_you_mean(value, known)}")


def did_you_mean(value: Any, known: Iterable[str]) -> str:
    """Return a sentence with the known word nearest to a mistyped one; "" if none is near."""
    if not isinstance(value, str):
        return ""
    by_plain = {_plain(word): word for word in known}
    found = get_close_matches(_plain(value), by_plain, n=1)
    return f" Did you mean {by_plain[found[0]]!r}?" if found else ""


def _plain(word: str) -> str:
    """Return a word's letters and digits in lower case, so that case and punctuation do not count."""
    return "".join(filter(str.isalnum, word.lower())) or word


def find_row(name: str, value: str, rows: Iterable[AnyRow]) -> AnyRow:
    """Return the row of a table whose name is `value`; raise OptionError when there is none."""
    table = {row.name: row for row in rows}
    check_choice(name, value, table)
    return table[value]


def check_int(name: str, value: Any, least: int) -> None:
    """Raise OptionError unless a value is an int from `least`, 0 or 1, and below 2^63; a bool is not an int."""
    if not isinstance(value, Integral) or isinstance(value, bool) or not least <= int(value) < 2**63:
        raise OptionError(f"{name} must be {'a positive int' if least else 'an int from 0'}; got {shown(value)}.")


def check_fraction(name: str, value: float) -> None:
    """Raise OptionError unless a value is a fraction of the mesh's diagonal, below 1."""
    if not isinstance(value, Real) or isinstance(value, bool) or not 0.0 <= value < 1.0:
        raise OptionError(f"{name} must lie in [0, 1), a fraction of the mesh's diagonal; got {shown(value)}.")
