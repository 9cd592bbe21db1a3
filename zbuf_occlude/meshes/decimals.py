"""Decimal numbers in bytes of text, to float64, correctly rounded: the compiled kernel that the text readers share."""

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.jit.compiler import njit

_SMALLEST, _LARGEST = -342, 308
"""Powers of ten beyond which every number of 19 digits is 0 or infinite."""
_DIGITS = 19
"""This many digits always fit into 64 bits."""


def _powers_of_five() -> NDArray[np.uint64]:
    """The 128 leading bits of each power of five, (high, low), rounded down, the reciprocals up."""
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
"""The powers of ten that float64 holds exactly."""
_LOW = np.uint64(0xFFFFFFFF)
_FULL = np.uint64(0xFFFFFFFFFFFFFFFF)
_ONE, _ZERO = np.uint64(1), np.uint64(0)


@njit(inline="always")
def _product(a, b):
    """The 128 bits of a product of two uint64: (high, low)."""
    a_low, a_high, b_low, b_high = a & _LOW, a >> np.uint64(32), b & _LOW, b >> np.uint64(32)
    low, cross, other = a_low * b_low, a_high * b_low, a_low * b_high
    middle = (low >> np.uint64(32)) + (cross & _LOW) + other
    high = a_high * b_high + (cross >> np.uint64(32)) + (middle >> np.uint64(32))
    return high, (middle << np.uint64(32)) | (low & _LOW)


@njit()
def nearest_double(digits, exponent):
    """Round ``digits * 10**exponent`` to the nearest float64, ties to even.

    Parameters
    ----------
    digits : uint64
    exponent : int64

    Returns
    -------
    bits : uint64
        Of the float64.
    certain : bool
        False where the product of 128 bits does not decide, for subnormal and for infinite numbers.

    References
    ----------
    D. Lemire, "Number parsing at a gigabyte per second", Software: Practice and Experience 51 (2021), section 5.
    """
    if digits == _ZERO:
        return _ZERO, True
    if exponent < _SMALLEST or exponent > _LARGEST:
        return _ZERO, False
    shift = 0
    for step in (32, 16, 8, 4, 2, 1):  # to a highest bit of 1
        if digits >> np.uint64(64 - step) == _ZERO:
            digits <<= np.uint64(step)
            shift += step
    row = exponent - _SMALLEST
    high, low = _product(digits, _POWERS[row, 0])
    if high & np.uint64(0x1FF) == np.uint64(0x1FF):  # what is below might carry
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
        mantissa &= ~_ONE  # exactly half way: to even
    mantissa = (mantissa + (mantissa & _ONE)) >> _ONE
    if mantissa >> np.uint64(53) != _ZERO:
        mantissa >>= _ONE
        power += 1
    if power >= 2047:
        return _ZERO, False
    return (np.uint64(power) << np.uint64(52)) | (mantissa & np.uint64(0xFFFFFFFFFFFFF)), True


@njit(forceinline=True)
def read_decimal(text, i, bits, values, place):
    """Read a number at a place in a text.

    Parameters
    ----------
    text : (n,) uint8
    i : int64
        Where a token begins.
    bits, values : (m,) uint64 and float64
        The same memory, to put the number in.
    place : int64
        Where in there.

    Returns
    -------
    end : int64
        The byte after the number.
    is_read : bool
        False where this is no decimal number, has more than 19 digits, or cannot be rounded here with certainty.
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
    if n_digits > _DIGITS:  # it may be that they begin with zeros
        while begin < i and (text[begin] == 48 or text[begin] == 46):
            n_digits -= text[begin] == 48
            begin += 1
        if n_digits > _DIGITS:
            return i, False
    elif n_digits == 0:
        return i, False
    if i < n and (text[i] == 101 or text[i] == 69):
        i += 1
        is_small = i < n and text[i] == 45
        if is_small or (i < n and text[i] == 43):
            i += 1
        begin, written = i, 0
        while i < n and np.uint8(text[i] - 48) < 10:
            if written < 100_000:
                written = 10 * written + text[i] - 48
            i += 1
        if i == begin:
            return i, False
        exponent += -written if is_small else written
    if digits >> np.uint64(53) == _ZERO and -22 <= exponent <= 22:  # one operation on exact numbers rounds once
        value = np.float64(digits)
        value = value / _EXACT[-exponent] if exponent < 0 else value * _EXACT[exponent]
        values[place] = -value if negative else value
        return i, True
    magnitude, is_certain = nearest_double(digits, exponent)
    bits[place] = magnitude | (np.uint64(negative) << np.uint64(63))
    return i, is_certain
