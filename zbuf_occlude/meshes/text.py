"""Texts of lines of numbers: where the lines and their numbers are, and the numbers, read in one compiled pass."""

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.errors import MeshError
from zbuf_occlude.jit.compiler import njit
from zbuf_occlude.meshes.decimals import read_decimal

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_SLASH = ord("/")
_BLANK, _LINE_END, _COMMENT = 1, 2, 3
_ROLES = np.zeros(256, dtype=np.uint8)
_ROLES[list(b" \t\v\f")], _ROLES[list(b"\r\n")] = _BLANK, _LINE_END  # CRLF ends two lines, one of them empty
_AFTER_SLASH = re.compile(rb"(?<=\d)/\S*")
_NUMBER = re.compile(rb"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|inf(?:inity)?|nan(?:\(\w*\))?)", re.IGNORECASE)


class Keywords(NamedTuple):
    """The words, of up to eight letters, that lines of a format begin with; all other lines are passed over.

    Parameters
    ----------
    of_numbers : tuple of bytes
        Numbers follow on the line.
    others : tuple of bytes
        What follows on the line is passed over.
    with_slashes : bytes
        One of the first: what follows a slash in its numbers, ``7/1/3``, is passed over.
    lower_case : bool
        The words are given in lower case, and met in any.
    """

    of_numbers: tuple[bytes, ...]
    others: tuple[bytes, ...] = ()
    with_slashes: bytes = b""
    lower_case: bool = False

    def kind(self, word: bytes) -> int:
        """Return the number that stands for a word in `Lines.kinds`, from 1 on; 0 for none."""
        return (b"", *self.of_numbers, *self.others).index(word)


NO_KEYWORDS = Keywords(())
"""Every line is of numbers."""


def check_text(data: bytes) -> None:
    """Raise MeshError for NUL bytes: that is no text, or none of an 8-bit encoding."""
    if b"\0" in data:
        raise MeshError("it must be a text file; it holds NUL bytes. Is it binary, UTF-16 or damaged?")


def unix_lines(data: bytes) -> bytes:
    """Return a text with one kind of line ends."""
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")


class Lines:
    """The lines of a text that hold numbers, and the numbers.

    Parameters
    ----------
    text : bytes
        With any kind of line ends.
    start : int
        The byte to begin with; a byte order mark there is passed over.
    comment : bytes
        The character that makes the rest of its line a comment; empty where none does.
    keywords : Keywords

    Attributes
    ----------
    counts : (l,) int64
        Numbers of each line. Lines without are left out, but for those of keywords.
    first : (l,) int64
        Which number of the whole text the line begins with.
    kinds : (l,) uint8
        The keyword (`Keywords.kind`); 0 without any.

    Raises
    ------
    MeshError
        The text holds NUL bytes.
    """

    def __init__(self, text: bytes, start: int = 0, *, comment: bytes = b"", keywords: Keywords = NO_KEYWORDS) -> None:
        check_text(text)
        if text.startswith(BYTE_ORDER_MARK, start):
            start += len(BYTE_ORDER_MARK)
        words = [int.from_bytes(word, "big") for word in (*keywords.of_numbers, *keywords.others)]
        self._with_slashes = keywords.kind(keywords.with_slashes) or -1
        roles = _ROLES.copy()
        roles[list(comment)] = _COMMENT
        most = (len(text) - start) // 2 + 2  # pages that are not written to take no memory
        values, first = np.empty(most), np.empty(most, dtype=np.int64)
        found = _Found(
            values, values.view(np.uint64), np.empty((most, 3), dtype=np.int64), np.empty(most, dtype=np.uint8), first
        )
        n_numbers, n_unread, n_lines = _scan(
            np.frombuffer(text, dtype=np.uint8),
            start,
            roles,
            np.array(words, dtype=np.uint64),
            len(keywords.of_numbers),
            self._with_slashes,
            32 if keywords.lower_case else 0,
            found,
        )
        self._text, self._values, self._unread = text, values[:n_numbers], found.unread[:n_unread]
        self.kinds: NDArray[np.uint8] = found.kinds[:n_lines]
        self.first: NDArray[np.int64] = first[:n_lines]
        self.counts: NDArray[np.int64] = np.diff(first[: n_lines + 1])

    def __len__(self) -> int:
        return len(self.counts)

    @property
    def n_numbers(self) -> int:
        """Numbers, and whatever else stands in their places, in the whole text."""
        return len(self._values)

    def numbers(self, n_lines: int | None = None, *, kind: int | None = None) -> FloatArray:
        """Return the numbers of the first `n_lines` lines (of all of them by default) as float64, in one flat array.

        With `kind`, a keyword's, the numbers of other lines are in the array too, but need not be right yet.

        Raises
        ------
        MeshError
            Something is not a number; the message quotes it.
        """
        end = self.n_numbers if n_lines is None or n_lines == len(self) else int(self.first[n_lines])
        for index, begin, stop in self._unread[self._unread[:, 0] < end].tolist():
            owner = self.kinds[np.searchsorted(self.first, index, side="right") - 1]
            if kind is None or owner == kind:
                token = self._text[begin:stop]
                self._values[index] = _number(_AFTER_SLASH.sub(b"", token) if owner == self._with_slashes else token)
        return self._values[:end]


def _number(token: bytes) -> float:
    """Read what the kernel left: very long, very small and very large numbers, infinity, NaN."""
    if not _NUMBER.fullmatch(token):
        raise MeshError(f"it must hold numbers here; it holds {token[:40].decode('latin-1')!r}. Is it damaged?")
    return float(token.partition(b"(")[0])


class _Found(NamedTuple):
    """What `_scan` finds: m numbers, u tokens that it did not read, l lines.

    Parameters
    ----------
    values, bits : (>= m,) float64, and uint64 of the same memory
    unread : (>= u, 3) int64
        Which number, first byte, byte after the last.
    kinds : (>= l,) uint8
    first : (>= l + 1,) int64
        The number each line begins with; the last is m.
    """

    values: FloatArray
    bits: NDArray[np.uint64]
    unread: NDArray[np.int64]
    kinds: NDArray[np.uint8]
    first: NDArray[np.int64]


@njit(cache=True, nogil=True)
def _scan(text, start, roles, words, n_of_numbers, with_slashes, fold, found):
    """Find the lines and read their numbers; return how many numbers, unread tokens and lines there are."""
    values, bits, unread, kinds, first = found
    n = len(text)
    n_numbers, n_unread, n_lines = np.int64(0), 0, 0  # with a literal 0, read_decimal would be compiled for it too
    i = start
    while i < n:
        kind = 0
        if len(words) != 0:
            while i < n and (text[i] == 32 or text[i] == 9):
                i += 1
            word = np.uint64(0)
            begin = i
            while i < n and i < begin + 8 and text[i] > 32:
                word = (word << np.uint64(8)) | np.uint64(text[i] | fold)
                i += 1
            for number in range(len(words)):
                if word == words[number]:
                    kind = number + 1
            if i < n and text[i] != 32 and text[i] != 9 and not (kind > n_of_numbers and roles[text[i]] == _LINE_END):
                kind = 0
            if kind == 0 or kind > n_of_numbers:
                while i < n and roles[text[i]] != _LINE_END:
                    i += 1
        begin = n_numbers
        while i < n:
            role = roles[text[i]]
            if role == _BLANK:
                i += 1
                continue
            if role == _COMMENT:
                while i < n and roles[text[i]] != _LINE_END:
                    i += 1
                break
            if role == _LINE_END:
                break
            token = i
            i, is_read = read_decimal(text, i, bits, values, n_numbers)
            if i < n and roles[text[i]] == 0:
                if text[i] != _SLASH or kind != with_slashes or np.uint8(text[i - 1] - 48) >= 10:
                    is_read = False
                while i < n and roles[text[i]] == 0:
                    i += 1
            if not is_read:
                unread[n_unread, 0], unread[n_unread, 1], unread[n_unread, 2] = n_numbers, token, i
                n_unread += 1
            n_numbers += 1
        i += 1
        if kind != 0 or n_numbers > begin:
            kinds[n_lines], first[n_lines] = kind, begin
            n_lines += 1
    first[n_lines] = n_numbers
    return n_numbers, n_unread, n_lines


def as_doubles(values: NDArray[np.generic]) -> FloatArray:
    """Convert to float64, without NumPy's warning about signalling NaN: what is not finite is judged later."""
    with np.errstate(invalid="ignore"):
        return np.asarray(values, dtype=np.float64)


def runs(starts: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the indices of runs laid end to end: ``starts[i], starts[i] + 1, ...``, ``counts[i]`` of each."""
    before = np.cumsum(counts) - counts
    return np.arange(int(counts.sum())) + np.repeat(starts - before, counts)
