"""The exceptions of zbuf_occlude, one tree under OccludeError, each also a standard exception; checks of options.

Every message has the same form: what must be; what it is; what to do.
"""

import re
import reprlib
from collections.abc import Collection, Iterable
from difflib import get_close_matches
from numbers import Integral, Real
from typing import Any, Protocol, TypeVar

_NOT_PRINTABLE = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")


def escape_control(text: str) -> str:
    """Return a text with what would break a line or command a terminal written as in Python, ``\\n``, ``\\x1b``.

    So are bytes of file names that are not UTF-8, which Python holds as lone surrogates: ``\\xff``.
    """
    return _NOT_PRINTABLE.sub(_escaped, text)


def _escaped(match: re.Match[str]) -> str:
    character = match[0]
    if "\udc80" <= character <= "\udcff":
        return f"\\x{ord(character) - 0xDC00:02x}"
    return character.encode("unicode_escape").decode()


class OccludeError(Exception):
    """Base of everything this package raises on purpose; names in its message are made printable, lines kept."""

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
    """Something named correctly cannot run here: a package, a library or a driver is missing."""


class GlError(OccludeError, RuntimeError):
    """No OpenGL context could be made, or OpenGL reported an error."""


class DatasetError(OccludeError, RuntimeError):
    """A dataset folder or file is not what it should be."""


def shown(value: Any) -> str:
    """Return a value as a message shows it: in one line, of some sixty characters at most."""
    try:
        return escape_control(" ".join(reprlib.repr(value).split()))[:60]
    except Exception:  # of whatever is passed in, a number of too many digits say
        return f"a {type(value).__name__}"


def describe(error: Exception) -> str:
    """Return what an exception says, without the number and the file's name that are in an OSError's text."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


class _Row(Protocol):
    """A row of a table that is looked up by name."""

    @property
    def name(self) -> str:
        """What it is looked up by."""


AnyRow = TypeVar("AnyRow", bound=_Row)


def check_choice(name: str, value: Any, known: Collection[str]) -> None:
    """Raise OptionError unless a value is one of the words that there are."""
    if not isinstance(value, str) or value not in known:
        raise OptionError(f"{name} must be one of {', '.join(known)}; got {shown(value)}.{did_you_mean(value, known)}")


def did_you_mean(value: Any, known: Iterable[str]) -> str:
    """Return a sentence that names the word that a mistyped one is nearest to; "" where none is near."""
    if not isinstance(value, str):
        return ""
    by_plain = {_plain(word): word for word in known}
    found = get_close_matches(_plain(value), by_plain, n=1)
    return f" Did you mean {by_plain[found[0]]!r}?" if found else ""


def _plain(word: str) -> str:
    """Return a word's letters and digits: what is mistyped is mostly the rest."""
    return "".join(filter(str.isalnum, word.lower())) or word


def find_row(name: str, value: str, rows: Iterable[AnyRow]) -> AnyRow:
    """Return the row of a table whose name is `value`; raise OptionError when there is none."""
    table = {row.name: row for row in rows}
    check_choice(name, value, table)
    return table[value]


def check_int(name: str, value: Any, least: int) -> None:
    """Raise OptionError unless a value is an int of at least 1 or 0, and below 2^63; a bool is none."""
    if not isinstance(value, Integral) or isinstance(value, bool) or not least <= int(value) < 2**63:
        raise OptionError(f"{name} must be {'a positive int' if least else 'an int from 0'}; got {shown(value)}.")


def check_fraction(name: str, value: float) -> None:
    """Raise OptionError unless a value is a fraction of the mesh's diagonal, below 1."""
    if not isinstance(value, Real) or isinstance(value, bool) or not 0.0 <= value < 1.0:
        raise OptionError(f"{name} must lie in [0, 1), a fraction of the mesh's diagonal; got {shown(value)}.")
