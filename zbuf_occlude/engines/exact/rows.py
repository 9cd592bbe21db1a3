"""Boxes as rows of 16 numbers, so that one minimum joins two, and the best place to divide a sequence of them."""

import numpy as np

from zbuf_occlude.base.jit.compiler import always_inline, device_function
from zbuf_occlude.base.jit.simd import load, load_scalar, load_scalar3, load_unchecked, minimum, store, store_unchecked
from zbuf_occlude.engines.exact.layout import UPPER

ROW, CENTRE = 16, 6
"""Length of a row (`put_row`), and the index of its first number of the centre."""


@always_inline
def put_row(rows, i, axis, lower, upper):
    """Write row i along an axis: the lower and the negated upper bound; then their sum, twice the centre, and minus it.

    The last four numbers of a row are unused.
    """
    at = ROW * i + axis
    store_unchecked(rows, at, lower)
    store_unchecked(rows, at + UPPER, -upper)
    store_unchecked(rows, at + CENTRE, lower + upper)
    store_unchecked(rows, at + CENTRE + UPPER, -lower - upper)


@always_inline
def range_of_centres(rows, i, axis):
    """Return twice the least centre of the boxes that row i joins along an axis, and twice the width of all centres.

    The width of rounded-out boxes is 0 or at least 2^-48.
    """
    at = ROW * i + CENTRE + axis
    low = load_scalar(rows, at)
    return low, -load_scalar(rows, at + UPPER) - low


@device_function
def half_area(rows, i):
    """Return half the area of the box of a row."""
    lower, upper = load_scalar3(rows, ROW * i, 1), load_scalar3(rows, ROW * i + UPPER, 1)
    x, y, z = lower[0] + upper[0], lower[1] + upper[1], lower[2] + upper[2]  # negated sides
    return x * y + y * z + z * x


@device_function
def joined_rows(rows, members, first, last):
    """Return the join of the rows of members first to last - 1."""
    joined = load(rows, ROW * np.int64(load_unchecked(members, first)))
    for i in range(first + 1, last):
        joined = minimum(joined, load(rows, ROW * np.int64(load_unchecked(members, i))))
    return joined


@device_function
def cheapest(rows, row, sizes, n, areas):
    """Return the least cost of dividing n rows in two, and the number of rows in the first part.

    The rows start at `row` and hold `sizes` leaves or faces each; the last of `rows` is scratch. The cost is that of
    the surface area heuristic: area times size, of both parts. Without a finite cost, as where all members are in one
    row, it returns infinity and 1.
    """
    last = len(rows) // ROW - 1
    joined, behind = load(rows, ROW * (row + n - 1)), 0
    for i in range(n - 1, 0, -1):
        joined = minimum(joined, load(rows, ROW * (row + i)))
        store(rows, ROW * last, joined)
        store_unchecked(areas, i, half_area(rows, last))
        behind += load_unchecked(sizes, i)
    joined, before = load(rows, ROW * row), 0
    least, middle = np.float32(np.inf), 1
    for i in range(1, n):
        joined = minimum(joined, load(rows, ROW * (row + i - 1)))
        store(rows, ROW * last, joined)
        before += load_unchecked(sizes, i - 1)
        cost = half_area(rows, last) * np.float32(before) + load_unchecked(areas, i) * np.float32(behind)
        behind -= load_unchecked(sizes, i)
        if cost < least:
            least, middle = cost, i
    return least, middle


@device_function
def partition(order, keys, end, spare):
    """Move members with a key below `end` to the front, else keep the order; return their number."""
    n = 0
    for i in range(len(order)):  # without branches, which would be hard to predict
        which = load_unchecked(order, i)
        store_unchecked(order, n, which)
        store_unchecked(spare, i - n, which)
        n += int(load_unchecked(keys, np.int64(which)) < end)
    for i in range(n, len(order)):
        store_unchecked(order, i, load_unchecked(spare, i - n))
    return n
