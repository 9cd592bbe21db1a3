"""Numbers out of text files, fast: tidy the text, find its lines and tokens, read the numbers in one go."""

import re
import warnings
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.errors import MeshError

_IS_SPACE = np.zeros(256, dtype=bool)
_IS_SPACE[list(b" \t\n\v\f\r")] = True
_NEWLINE = ord("\n")


def tidy(data: bytes, comment: bytes | None = b"#") -> bytes:
    """Return text with one kind of line end, without byte order mark and without comments.

    Raises
    ------
    MeshError
        NUL bytes: this is no text, or none of an 8-bit encoding.
    """
    if b"\0" in data:
        raise MeshError("it must be a text file; it holds NUL bytes. Is it binary, UTF-16 or damaged?")
    data = data.removeprefix(b"\xef\xbb\xbf")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if comment is not None and comment in data:
        data = re.sub(re.escape(comment) + rb"[^\n]*", b"", data)
    return data


def read_numbers(text: bytes) -> FloatArray:
    """Read all tokens of a text as float64, correctly rounded; ``nan`` and ``inf`` are numbers too.

    Raises
    ------
    MeshError
        A token is not a number; the message quotes it.
    """
    if not text.strip():
        return np.empty(0)  # np.fromstring would answer [-1.]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # what older NumPy says instead of ValueError
            return np.fromstring(text, sep=" ")
    except (ValueError, DeprecationWarning):
        raise MeshError(f"it must hold numbers here; it holds {_first_bad(text)!r}. Is it damaged?") from None


def _first_bad(text: bytes) -> str:
    for token in text.split():
        try:
            float(token)
        except ValueError:
            return token[:40].decode("latin-1")
    return "something else"


class Lines:
    """The lines of a text that hold anything, and where their tokens stand.

    Parameters
    ----------
    text : bytes
        As `tidy` returns it.

    Attributes
    ----------
    counts : (l,) int64
        Tokens of each line that is not blank.
    first : (l,) int64
        Which token of the whole text the line begins with.
    """

    def __init__(self, text: bytes) -> None:
        raw = np.frombuffer(text, dtype=np.uint8)
        token = ~_IS_SPACE[raw]
        token[1:] &= _IS_SPACE[raw[:-1]]
        ends = np.append(np.flatnonzero(raw == _NEWLINE), len(raw))
        tokens_before = np.searchsorted(np.flatnonzero(token), ends)
        counts = np.diff(tokens_before, prepend=0)
        filled = counts > 0
        self._text = text
        self._ends = ends[filled]
        self.counts: NDArray[np.int64] = counts[filled].astype(np.int64)
        self.first: NDArray[np.int64] = (np.cumsum(self.counts) - self.counts).astype(np.int64)

    def __len__(self) -> int:
        return len(self.counts)

    @cached_property
    def n_tokens(self) -> int:
        """Tokens in the whole text."""
        return int(self.counts.sum())

    def numbers(self, n_lines: int | None = None) -> FloatArray:
        """Return the tokens of the first `n_lines` lines (of all of them by default) as float64, in one flat array.

        Raises
        ------
        MeshError
            A token is not a number.
        """
        if n_lines is None:
            n_lines = len(self)
        if n_lines == 0:
            return np.empty(0)
        values = read_numbers(self._text[: self._ends[n_lines - 1]])
        if len(values) != self.counts[:n_lines].sum():  # only from oddities such as "nan(1 2)"
            raise MeshError("it must hold numbers separated by blanks; its text is damaged.")
        return values


def as_doubles(values: NDArray[np.generic]) -> FloatArray:
    """Convert to float64, without NumPy's warning about signalling NaN: what is not finite is judged later."""
    with np.errstate(invalid="ignore"):
        return np.asarray(values, dtype=np.float64)


def runs(starts: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the indices of runs laid end to end: ``starts[i], starts[i] + 1, ...``, ``counts[i]`` of each."""
    before = np.cumsum(counts) - counts
    return np.arange(int(counts.sum())) + np.repeat(starts - before, counts)
