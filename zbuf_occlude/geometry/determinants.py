"""Determinants of differences of float64 numbers, with their exact sign: a filter, two-term sums, integers.

A row of a determinant is a difference of two positions, or a direction. A difference is a pair of float64 (high, low)
whose sum equals it exactly. There are three stages; each is used only if the one before is not certain. Below u is
2^-53 and P the permanent, the sum of the absolute values of the six products.

1. `filtered_determinant` rounds differences and products. Each of the six products has three factors and two
   multiplications that were rounded once, and takes part in three additions: the error is below (7 + 56 u) u P
   (Shewchuk 1997, section 4.3). `FILTER` has a margin for the rounding of P.
2. `_two_term` adds the rounding errors, to first order. In m = y z' - z y' the errors of both products and of their
   difference, and the low parts of y and z, amount to 4 u (|y z'| + |z y'|); they are computed to 37 u^2 of it, with 8
   roundings and without products of low parts. With the error of x m and the low part of x, the correction of a term is
   at most 6 u P, computed to 59 u^2 P. Three terms and their corrections are added to 40 u^2 P. `SECOND`, 256 u^2, is
   more than twice the sum.
3. `_add_products` adds all 48 products as integers with separate exponents. Nothing rounds, overflows or underflows.

Underflow changes the first two stages by less than `TINY` while no factor exceeds 1e150. After overflow the bound is
infinite or the value is not a number; then the next stage answers.

References
----------
Shewchuk: Adaptive precision floating-point arithmetic and fast robust geometric predicates. Discrete & Computational
Geometry 18 (1997), doi:10.1007/PL00009321. Departure: integers instead of expansions, which underflow.
"""

import math

import numpy as np

from zbuf_occlude.base.jit.compiler import always_inline, device_function, external, njit
from zbuf_occlude.base.jit.simd import fma

FILTER = 9.0 * 2.0**-53
SECOND = 2.0**-98
TINY = 1e-150
SIGN, CLEAR = 1.0, 2.0**30
"""Ratios of a value to its error bound above which its sign is certain, or it is accurate enough as a divisor."""

BITS = 32
"""Bits of a digit."""
DIGIT = (1 << BITS) - 1


@always_inline
def filtered_determinant(x, y, z):
    """Return the determinant x . (y x z) of rounded rows in float64, and a bound on its error."""
    p, q, r = y[1] * z[2], y[2] * z[0], y[0] * z[1]
    s, t, v = y[2] * z[1], y[0] * z[2], y[1] * z[0]
    permanent = abs(x[0]) * (abs(p) + abs(s)) + abs(x[1]) * (abs(q) + abs(t)) + abs(x[2]) * (abs(r) + abs(v))
    return x[0] * (p - s) + x[1] * (q - t) + x[2] * (r - v), FILTER * permanent + TINY


@njit(inline="always")
def low_part(a, b, difference):
    """Return the rounding error of a - b in each component: exactly a - b - difference."""
    return _lost(a[0], b[0], difference[0]), _lost(a[1], b[1], difference[1]), _lost(a[2], b[2], difference[2])


@always_inline
def _lost(a, b, difference):
    """Return the rounding error of the float64 a - b: exactly a - b - difference (Knuth's two-sum)."""
    b_ = a - difference
    return (a - (difference + b_)) + (b_ - b)


@njit()
def determinant(least, x, x_low, y, y_low, z, z_low):
    """Return the determinant x . (y x z) of three rows, each the exact sum of a high and a low part.

    Parameters
    ----------
    least : float
        Least ratio of a value and its error bound: `SIGN` for the exact sign, `CLEAR` for a relative error below 1e-9.
    x, x_low, y, y_low, z, z_low : tuples of 3 float64
        Each low part is zero or a rounding error of its high part (`low_part`).

    Returns
    -------
    float
        Value with the sign and accuracy that `least` asks for. Beyond float64's range it is infinite, or the smallest
        number.
    """
    return _determinant(
        least, x[0], x[1], x[2], x_low[0], x_low[1], x_low[2], y[0], y[1], y[2], y_low[0], y_low[1], y_low[2],
        z[0], z[1], z[2], z_low[0], z_low[1], z_low[2],
    )  # fmt: skip


@external("float64(" + "float64," * 18 + "float64)")
def _determinant(least, x0, x1, x2, x3, x4, x5, y0, y1, y2, y3, y4, y5, z0, z1, z2, z3, z4, z5):
    x, x_low, y, y_low, z, z_low = (x0, x1, x2), (x3, x4, x5), (y0, y1, y2), (y3, y4, y5), (z0, z1, z2), (z3, z4, z5)
    value, error = _two_term(x, x_low, y, y_low, z, z_low)
    if abs(value) > least * error or _loses_nothing(x, x_low, y, y_low, z, z_low):
        return value
    return _as_float(x, x_low, y, y_low, z, z_low)


@always_inline
def _two_term(x, x_low, y, y_low, z, z_low):
    """Return the determinant to about twice float64's precision, and a bound on its error."""
    first, first_low, first_size = _term(x[0], x_low[0], y[1], y_low[1], y[2], y_low[2], z[1], z_low[1], z[2], z_low[2])
    second, second_low, second_size = _term(
        x[1], x_low[1], y[2], y_low[2], y[0], y_low[0], z[2], z_low[2], z[0], z_low[0]
    )
    third, third_low, third_size = _term(x[2], x_low[2], y[0], y_low[0], y[1], y_low[1], z[0], z_low[0], z[1], z_low[1])
    half = first + second
    total = half + third
    low = (first_low + second_low + third_low) + (_lost(first, -second, half) + _lost(half, -third, total))
    return total + low, SECOND * (first_size + second_size + third_size) + TINY


@always_inline
def _term(x, x_low, y, y_low, y2, y2_low, z, z_low, z2, z2_low):
    """Return x (y z2 - y2 z) rounded, its rounding error, and the sum of both products' sizes."""
    p, q = y * z2, y2 * z
    m = p - q
    m_low = (fma(y, z2, -p) - fma(y2, z, -q) + _lost(p, q, m)) + ((y * z2_low + y_low * z2) - (y2 * z_low + y2_low * z))
    term = x * m
    return term, fma(x, m, -term) + x * m_low + x_low * m, abs(x) * (abs(p) + abs(q))


@device_function
def _loses_nothing(x, x_low, y, y_low, z, z_low):
    """Return whether `_two_term` is exact because nothing was rounded, as for axis-parallel rays and regular grids."""
    total = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        if x[i] == 0.0 and x_low[i] == 0.0:
            continue
        m = 0.0
        for a, a_low, b, b_low in (
            (y[j], y_low[j], z[k], z_low[k]),
            (-y[k], y_low[k], z[j], z_low[j]),
        ):
            if (a == 0.0 and a_low == 0.0) or (b == 0.0 and b_low == 0.0):
                continue
            product = a * b
            if a_low != 0.0 or b_low != 0.0 or fma(a, b, -product) != 0.0 or abs(product) < TINY:
                return False
            m, before = m + product, m
            if _lost(before, -product, m) != 0.0:
                return False
        if m == 0.0:  # nothing was rounded, so the low part of x has no effect either
            continue
        term = x[i] * m
        if x_low[i] != 0.0 or fma(x[i], m, -term) != 0.0 or 0.0 < abs(term) < TINY:
            return False
        total, before = total + term, total
        if _lost(before, -term, total) != 0.0:
            return False
    return True


# Integers: digits of `BITS` bits, lowest first; the unit of the lowest digit is a power of two


@device_function
def _exponents(row, low):
    """Return the exponents of the last bit of any part of a row, and above its first bit; 0, 0 for zeros."""
    least, most = 4096, -4096
    for i in range(3):
        for number in (row[i], low[i]):
            if number != 0.0:
                exponent = math.frexp(number)[1]
                least, most = min(least, exponent - 53), max(most, exponent)
    return (least, most) if least < 4096 else (0, 0)


@device_function
def _scale(x, x_low, y, y_low, z, z_low):
    """Return the exponent of the lowest digit's unit, and the number of digits of a determinant."""
    (a, b), (c, d), (e, f) = _exponents(x, x_low), _exponents(y, y_low), _exponents(z, z_low)
    lowest = a + c + e - 2 * 53  # each of the four parts of a product is taken as 53 bits
    return lowest, (b + d + f - lowest) // BITS + 4


@device_function
def _add_products(digits, lowest, x, x_low, y, y_low, z, z_low):
    """Add the products of a determinant to the digits."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for a in (x[i], x_low[i]):
            for b in (y[j], y_low[j]):
                _add_product(digits, lowest, a, b, z[k])
                _add_product(digits, lowest, a, b, z_low[k])
            for b in (y[k], y_low[k]):
                _add_product(digits, lowest, -a, b, z[j])
                _add_product(digits, lowest, -a, b, z_low[j])


@device_function
def _add_product(digits, lowest, a, b, c):
    """Add a b c, split into four float64 without error, with separate exponents."""
    if a == 0.0 or b == 0.0 or c == 0.0:
        return
    a, i = math.frexp(a)
    b, j = math.frexp(b)
    c, k = math.frexp(c)
    product = a * b
    for part in (product, fma(a, b, -product)):
        high = part * c
        _add(digits, high, i + j + k - lowest)
        _add(digits, fma(part, c, -high), i + j + k - lowest)


@device_function
def _add(digits, number, exponent):
    """Add number x 2^exponent, in units of the lowest digit."""
    if number == 0.0:
        return
    fraction, own = math.frexp(number)
    integer, position = np.int64(abs(fraction) * 2.0**53), exponent + own - 53
    sign, at, shift = np.int64(1 if number > 0.0 else -1), position // BITS, position % BITS
    low, high = (integer & DIGIT) << shift, (integer >> BITS) << shift
    digits[at] += sign * (low & DIGIT)
    digits[at + 1] += sign * ((low >> BITS) + (high & DIGIT))
    digits[at + 2] += sign * (high >> BITS)


@device_function
def _carry(digits):
    """Bring the digits into [0, 2^BITS); return the sign of the number, whose absolute value they then hold."""
    carry, rest = np.int64(0), np.int64(0)
    for i in range(len(digits)):
        carry += digits[i]
        digits[i] = carry & DIGIT
        rest |= digits[i]
        carry >>= BITS
    if carry >= 0:
        return np.int64(rest != 0)
    carry = np.int64(1)
    for i in range(len(digits)):
        carry += DIGIT - digits[i]
        digits[i] = carry & DIGIT
        carry >>= BITS
    return np.int64(-1)


@njit(_nrt=True)
def _as_float(x, x_low, y, y_low, z, z_low):
    """Return the determinant summed as an integer, rounded to float64 with an error below 2^-52 and the right sign."""
    lowest, n = _scale(x, x_low, y, y_low, z, z_low)
    digits = np.zeros(n, np.int64)
    _add_products(digits, lowest, x, x_low, y, y_low, z, z_low)
    sign, top = _carry(digits), n - 1
    if sign == 0:
        return 0.0
    while digits[top] == 0:
        top -= 1
    value = 0.0
    for i in range(top, max(top - 3, -1), -1):
        value = value * 2.0**BITS + digits[i]
    return sign * max(math.ldexp(value, lowest + BITS * max(top - 2, 0)), 5e-324)


@njit(_nrt=True)
def compare_quotients(a, b, c, d):
    """Return the exact sign of a / b - c / d for four determinants given as the arguments of `determinant`."""
    (a_lowest, n_a), (b_lowest, n_b), (c_lowest, n_c), (d_lowest, n_d) = _scale(*a), _scale(*b), _scale(*c), _scale(*d)
    p, q, r, s = np.zeros(n_a, np.int64), np.zeros(n_b, np.int64), np.zeros(n_c, np.int64), np.zeros(n_d, np.int64)
    _add_products(p, a_lowest, *a)
    _add_products(q, b_lowest, *b)
    _add_products(r, c_lowest, *c)
    _add_products(s, d_lowest, *d)
    p_sign, q_sign, r_sign, s_sign = _carry(p), _carry(q), _carry(r), _carry(s)
    # a d - c b; the product with the lower unit starts at the first bit
    lowest = min(a_lowest + d_lowest, c_lowest + b_lowest)
    shift, other_shift = a_lowest + d_lowest - lowest, c_lowest + b_lowest - lowest
    n = max(n_a + n_d + shift // BITS, n_c + n_b + other_shift // BITS) + 3
    difference = np.zeros(n, np.int64)
    _add_digits_product(difference, p, s, shift, p_sign * s_sign)
    _add_digits_product(difference, r, q, other_shift, -r_sign * q_sign)
    return _carry(difference) * q_sign * s_sign


@device_function
def _add_digits_product(digits, a, b, shift, sign):
    """Add sign x a x b x 2^shift, for numbers whose digits are in [0, 2^BITS)."""
    skipped, shift, carry = shift // BITS, shift % BITS, np.int64(0)
    for i in range(len(a) + 1):  # digits of a, shifted by less than a digit
        digit = carry
        if i < len(a):
            moved = a[i] << shift
            digit, carry = (moved & DIGIT) | carry, moved >> BITS
        if digit != 0:
            for j in range(len(b)):
                product = np.uint64(digit) * np.uint64(b[j])
                digits[i + j + skipped] += sign * np.int64(product & np.uint64(DIGIT))
                digits[i + j + skipped + 1] += sign * np.int64(product >> np.uint64(BITS))
