"""Checks of options at the public border: words, numbers, rows of tables; each error says what there is."""

from collections.abc import Collection, Iterable
from difflib import get_close_matches
from numbers import Integral
from typing import Any, Protocol, TypeVar

from zbuf_occlude.errors import OptionError


class Row(Protocol):
    """A row of a table that is looked up by name."""

    @property
    def name(self) -> str:
        """What it is looked up by."""


AnyRow = TypeVar("AnyRow", bound=Row)


def check_word(name: str, value: Any, known: Collection[str]) -> None:
    """Raise OptionError unless a value is one of the words that there are."""
    if value not in known:
        raise OptionError(f"{name} must be one of {', '.join(known)}; got {value!r}.{did_you_mean(value, known)}")


def did_you_mean(value: Any, known: Iterable[str]) -> str:
    """Return a sentence that names the word that a mistyped one is nearest to; "" where none is near."""
    by_plain = {_plain(word): word for word in known}
    found = get_close_matches(_plain(str(value)), by_plain, n=1)
    return f" Did you mean {by_plain[found[0]]!r}?" if found else ""


def _plain(word: str) -> str:
    """Return a word's letters and digits: what is mistyped is mostly the rest."""
    return "".join(filter(str.isalnum, word.lower())) or word


def find_row(name: str, value: str, rows: Iterable[AnyRow]) -> AnyRow:
    """Return the row of a table whose name is `value`; raise OptionError when there is none."""
    table = {row.name: row for row in rows}
    check_word(name, value, table)
    return table[value]


def check_int(name: str, value: Any, least: int) -> None:
    """Raise OptionError unless a value is an int of at least 1 or 0."""
    if not isinstance(value, Integral) or value < least:
        raise OptionError(f"{name} must be {'a positive int' if least else 'an int from 0'}; got {value!r}.")


def check_fraction(name: str, value: float) -> None:
    """Raise OptionError unless a value is a fraction of the mesh's diagonal, below 1."""
    if not 0.0 <= value < 1.0:
        raise OptionError(f"{name} must lie in [0, 1), a fraction of the mesh's diagonal; got {value}.")
