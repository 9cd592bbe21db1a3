"""Text files of numbers: their lines and correctly rounded numbers, read in one compiled pass."""

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import MeshError
from zbuf_occlude.base.jit.compiler import njit

_SLASH = ord("/")
_BLANK, _LINE_END, _COMMENT = 1, 2, 3
_ROLES = np.zeros(256, dtype=np.uint8)
_ROLES[list(b" \t\v\f")], _ROLES[list(b"\r\n")] = _BLANK, _LINE_END  # CRLF ends two lines, one of them empty
_AFTER_SLASH = re.compile(rb"(?<=\d)/\S*")
_NUMBER = re.compile(rb"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|inf(?:inity)?|nan(?:\(\w*\))?)", re.IGNORECASE)


_SMALLEST, _LARGEST = -342, 308
"""Exponents of ten beyond which every number of 19 digits is 0 or infinite."""
_DIGITS = 19
"""Digits that always fit into 64 bits."""


def _powers_of_five() -> NDArray[np.uint64]:
    """Return the 128 leading bits (high, low) of each power of five, rounded down, and of their reciprocals, up."""
    rows = []
    for exponent in range(_SMALLEST, _LARGEST + 1):
        power = 5 ** abs(exponent)
        bits = power.bit_length()
        if exponent >= 0:
            leading = power << 128 - bits if bits <= 128 else power >> bits - 128
        else:
            leading = (1 << bits + 127) // power + 1
        rows.append((leading >> 64, leading & (1 << 64) - 1))
    return np.array(rows, dtype=np.uint64)


_POWERS = _powers_of_five()
_EXACT = np.array([10.0**exponent for exponent in range(23)])
"""Powers of ten that float64 represents exactly."""
_LOW = np.uint64(0xFFFFFFFF)
_FULL = np.uint64(0xFFFFFFFFFFFFFFFF)
_ONE, _ZERO = np.uint64(1), np.uint64(0)


class Keywords(NamedTuple):
    """Words of up to eight letters at the beginning of a format's lines; all other lines are skipped."""

    of_numbers: tuple[bytes, ...]  # words before numbers
    others: tuple[bytes, ...] = ()  # words before text that is skipped
    with_slashes: bytes = b""  # a word before numbers such as 7/1/3, of which only the part before a slash is read
    lower_case: bool = False  # True: the words are given in lower case and match any case

    def kind(self, word: bytes) -> int:
        """Return the number of a word in `Lines.kinds`, from 1 on; 0 for the empty word."""
        return (b"", *self.of_numbers, *self.others).index(word)


NO_KEYWORDS = Keywords(())
"""Keywords of a format whose lines are all numbers."""


def check_text(data: bytes) -> None:
    """Raise MeshError for NUL bytes, which no text in an 8-bit encoding contains."""
    if b"\0" in data:
        raise MeshError("it must be a text file; it has NUL bytes. Is it binary, UTF-16 or damaged?")


def unix_lines(data: bytes) -> bytes:
    """Return a text with the line ends of Unix."""
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")


class Lines:
    """The lines of a text that contain numbers or a keyword, and the numbers.

    Attributes
    ----------
    counts : (l,) int64
        Count of numbers in each line.
    first : (l,) int64
        Index of the line's first number among those of the text.
    kinds : (l,) uint8
        Keyword of the line (`Keywords.kind`); 0 without one.
    """

    def __init__(self, text: bytes, start: int = 0, *, comment: bytes = b"", keywords: Keywords = NO_KEYWORDS) -> None:
        check_text(text)
        words = [int.from_bytes(word, "big") for word in (*keywords.of_numbers, *keywords.others)]
        self._with_slashes = keywords.kind(keywords.with_slashes) or -1
        roles = _ROLES.copy()
        roles[list(comment)] = _COMMENT
        most = (len(text) - start) // 2 + 2  # unused pages take no memory
        values, first = np.empty(most), np.empty(most, dtype=np.int64)
        found = _ScanBuffers(
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
        """Count of tokens in the text, numbers or not."""
        return len(self._values)

    def numbers(self, n_lines: int | None = None, *, kind: int | None = None) -> FloatArray:
        """Return the numbers of the first `n_lines` lines (default: all) as float64, in one flat array.

        With `kind`, only the numbers of lines with that keyword are valid; the array contains those of all lines.

        Raises
        ------
        MeshError
            A token is no number; the message quotes it.
        """
        end = self.n_numbers if n_lines is None or n_lines == len(self) else int(self.first[n_lines])
        for index, begin, stop in self._unread[self._unread[:, 0] < end].tolist():
            owner = self.kinds[np.searchsorted(self.first, index, side="right") - 1]
            if kind is None or owner == kind:
                token = self._text[begin:stop]
                self._values[index] = _number(_AFTER_SLASH.sub(b"", token) if owner == self._with_slashes else token)
        return self._values[:end]


def _number(token: bytes) -> float:
    """Return a number that the kernel left: very long, very small or very large, infinite, or NaN."""
    if not _NUMBER.fullmatch(token):
        raise MeshError(f"it must have numbers here; it has {token[:40].decode('latin-1')!r}. Is it damaged?")
    return float(token.partition(b"(")[0])


class _ScanBuffers(NamedTuple):
    """The output of `_scan`: m numbers, u tokens that it did not read, l lines."""

    values: FloatArray  # (>= m,)
    bits: NDArray[np.uint64]  # the memory of `values`
    unread: NDArray[np.int64]  # (>= u, 3): index among the numbers, first byte, end
    kinds: NDArray[np.uint8]  # (>= l,)
    first: NDArray[np.int64]  # (>= l + 1,): index of each line's first number; the last is m


@njit(inline="always")
def _product(a, b):
    """Return the 128 bits (high, low) of the product of two uint64."""
    a_low, a_high, b_low, b_high = a & _LOW, a >> np.uint64(32), b & _LOW, b >> np.uint64(32)
    low, cross, other = a_low * b_low, a_high * b_low, a_low * b_high
    middle = (low >> np.uint64(32)) + (cross & _LOW) + other
    high = a_high * b_high + (cross >> np.uint64(32)) + (middle >> np.uint64(32))
    return high, (middle << np.uint64(32)) | (low & _LOW)


@njit()
def _nearest_double(digits, exponent):
    """Return the bits of ``digits * 10**exponent`` as the nearest float64, ties to even, and whether they are certain.

    They are uncertain where 128 bits of the product do not decide, and for subnormal and infinite numbers.

    References
    ----------
    D. Lemire, "Number parsing at a gigabyte per second", Software: Practice and Experience 51 (2021), section 5.
    """
    if digits == _ZERO:
        return _ZERO, True
    if exponent < _SMALLEST or exponent > _LARGEST:
        return _ZERO, False
    shift = 0
    for step in (32, 16, 8, 4, 2, 1):  # until the highest bit is 1
        if digits >> np.uint64(64 - step) == _ZERO:
            digits <<= np.uint64(step)
            shift += step
    row = exponent - _SMALLEST
    high, low = _product(digits, _POWERS[row, 0])
    if high & np.uint64(0x1FF) == np.uint64(0x1FF):  # the lower bits may carry
        more, _ = _product(digits, _POWERS[row, 1])
        low += more
        if low < more:
            high += _ONE
    if low == _FULL and (exponent < -27 or exponent > 55):
        return _ZERO, False
    upper = high >> np.uint64(63)
    right = upper + np.uint64(9)
    mantissa = high >> right
    power = ((217706 * exponent) >> 16) + 63 + np.int64(upper) - shift + 1023  # 217706 / 2**16: log2(10)
    if power <= 0:
        return _ZERO, False
    if low <= _ONE and -4 <= exponent <= 23 and mantissa & np.uint64(3) == _ONE and mantissa << right == high:
        mantissa &= ~_ONE  # a tie: round to even
    mantissa = (mantissa + (mantissa & _ONE)) >> _ONE
    if mantissa >> np.uint64(53) != _ZERO:
        mantissa >>= _ONE
        power += 1
    if power >= 2047:
        return _ZERO, False
    return (np.uint64(power) << np.uint64(52)) | (mantissa & np.uint64(0xFFFFFFFFFFFFF)), True


@njit(forceinline=True)
def _read_exponent(text, i):
    """Read the exponent after the "e" at byte i; return its end, its value, and whether it has digits."""
    n = len(text)
    i += 1
    is_small = i < n and text[i] == 45
    if is_small or (i < n and text[i] == 43):
        i += 1
    begin, written = i, 0
    while i < n and np.uint8(text[i] - 48) < 10:
        if written < 100_000:
            written = 10 * written + text[i] - 48
        i += 1
    return i, -written if is_small else written, i > begin


@njit(forceinline=True)
def _read_decimal(text, i, bits, values, index):
    """Read the number at byte i into `values[index]` (or `bits`, the same memory); return its end, and if it was read.

    It is not read where the token is no decimal number, has more than 19 digits, or cannot be rounded with certainty.
    """
    n = len(text)
    negative = text[i] == 45
    if negative or text[i] == 43:
        i += 1
    digits, n_digits, exponent = _ZERO, 0, 0
    begin = i
    while i < n and np.uint8(text[i] - 48) < 10:
        digits = digits * np.uint64(10) + np.uint64(text[i] - 48)
        i += 1
    n_digits = i - begin
    if i < n and text[i] == 46:
        i += 1
        point = i
        while i < n and np.uint8(text[i] - 48) < 10:
            digits = digits * np.uint64(10) + np.uint64(text[i] - 48)
            i += 1
        exponent = point - i
        n_digits += i - point
    if n_digits > _DIGITS:  # leading zeros do not count
        while begin < i and (text[begin] == 48 or text[begin] == 46):
            n_digits -= text[begin] == 48
            begin += 1
        if n_digits > _DIGITS:
            return i, False
    elif n_digits == 0:
        return i, False
    if i < n and (text[i] == 101 or text[i] == 69):
        i, written, has_digits = _read_exponent(text, i)
        if not has_digits:
            return i, False
        exponent += written
    if digits >> np.uint64(53) == _ZERO and -22 <= exponent <= 22:  # one operation on exact numbers rounds once
        value = np.float64(digits)
        value = value / _EXACT[-exponent] if exponent < 0 else value * _EXACT[exponent]
        values[index] = -value if negative else value
        return i, True
    magnitude, is_certain = _nearest_double(digits, exponent)
    bits[index] = magnitude | (np.uint64(negative) << np.uint64(63))
    return i, is_certain


@njit(forceinline=True)
def _read_keyword(text, i, roles, words, n_of_numbers, fold):
    """Read the first word of a line at byte i; return the end of what is skipped, and its kind, 0 for no keyword.

    The whole line is skipped unless numbers follow the keyword.
    """
    n, kind, word = len(text), 0, np.uint64(0)
    while i < n and (text[i] == 32 or text[i] == 9):
        i += 1
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
    return i, kind


@njit(cache=True, nogil=True)
def _scan(text, start, roles, words, n_of_numbers, with_slashes, fold, found):
    """Find the lines and read their numbers; return the counts of numbers, unread tokens and lines."""
    values, bits, unread, kinds, first = found
    n = len(text)
    n_numbers, n_unread, n_lines = np.int64(0), 0, 0  # with a literal 0, _read_decimal would be compiled for it too
    i = start
    while i < n:
        kind = 0
        if len(words) != 0:
            i, kind = _read_keyword(text, i, roles, words, n_of_numbers, fold)
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
            i, is_read = _read_decimal(text, i, bits, values, n_numbers)
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
    """Return values as float64, without NumPy's warning about signalling NaN; readers check finiteness later."""
    with np.errstate(invalid="ignore"):
        return np.asarray(values, dtype=np.float64)


def runs(starts: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the indices of runs, one after the other: ``starts[i], starts[i] + 1, ...``, ``counts[i]`` of each."""
    before = np.cumsum(counts) - counts
    return np.arange(int(counts.sum())) + np.repeat(starts - before, counts)
