"""Checks of arrays, numbers and flags at the public border; everything inside may trust what it is given."""

import math
from collections.abc import Callable
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.errors import ArgumentError, shown
from zbuf_occlude.jit.compiler import njit

LARGEST = 1e70
"""Coordinates beyond this would overflow where lengths are raised to the fourth power (areas squared)."""

SHORTEST = 1e-20
"""Directions shorter than this, and as much longer ones, would lose digits or overflow in products."""

_SHORTEST_BITS, _LONGEST_BITS = (int(bits) for bits in np.array([SHORTEST, 1.0 / SHORTEST]).view(np.int64))

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]
BoolArray = NDArray[np.bool_]


def shape_and_dtype(values: Any) -> str:
    """Describe what should be an array, e.g. ``(3, 100) float32``."""
    try:
        array = np.asarray(values)
    except ValueError:
        return "rows of unequal length"
    return f"{array.shape} {array.dtype}"


def as_array(values: ArrayLike, name: str, want: str, remedy: str = "Pass one array.") -> NDArray[Any]:
    """Return values as an array of whatever shape and type; raise ArgumentError for rows of unequal length."""
    try:
        return np.asarray(values)
    except ValueError:
        raise ArgumentError(f"{name} must be {want}; got rows of unequal length. {remedy}") from None


def as_numbers(values: ArrayLike, name: str, shape: tuple[int, ...], hint: str = "") -> FloatArray:
    """Return values as float64; raise ArgumentError unless they are numbers in an array of that shape."""
    array = as_array(values, name, str(shape or "a number"), hint.strip() or "Pass one array.")
    if array.dtype.kind not in "fiu" or array.shape != shape:
        raise ArgumentError(f"{name} must be {shape or 'a number'}; got {shape_and_dtype(values)}.{hint}")
    return np.asarray(array, dtype=np.float64)


def as_number(value: Any, name: str, want: str, fits: Callable[[float], bool] = lambda number: True) -> float:
    """Return a value as a float; raise ArgumentError unless it is a finite real number that fits.

    Parameters
    ----------
    value : real number
        A bool is none, nor is a text.
    name, want : str
        What the caller calls it, and what it must be: "{name} must be {want}; got ...".
    fits : callable
        Whether a finite number is what is wanted.
    """
    try:
        number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    except OverflowError:
        number = math.inf
    if not (math.isfinite(number) and fits(number)):
        raise ArgumentError(f"{name} must be {want}; got {shown(value)}.")
    return number


def as_flag(value: Any, name: str) -> bool:
    """Return a bool; raise ArgumentError for what is none, such as the word "no", which is true."""
    if not isinstance(value, bool | np.bool_):
        raise ArgumentError(f"{name} must be True or False; got {shown(value)}.")
    return bool(value)


def as_vectors(values: ArrayLike, name: str) -> FloatArray:
    """Check an array of 3-vectors.

    Parameters
    ----------
    values : array_like, (n, 3), any real dtype
    name : str
        What the caller calls it; opens the error message.

    Returns
    -------
    (n, 3) float64, C-contiguous, all finite. The input itself when it already is that.

    Raises
    ------
    ArgumentError
        Not (n, 3), not numeric, with NaN or infinity, or beyond `LARGEST`.
    """
    array = as_triples(values, name)
    if not (array.max(initial=0.0) <= LARGEST and array.min(initial=0.0) >= -LARGEST):  # NaN is neither
        bad = int(np.flatnonzero(~(np.abs(array) <= LARGEST).all(axis=1))[0])
        what = f"at most {LARGEST:g} in size" if np.isfinite(array).all() else "finite"
        raise ArgumentError(f"{name} must be {what}; row {bad} is {array[bad].tolist()}. Remove or repair it.")
    return array


def as_vector(values: ArrayLike, name: str) -> FloatArray:
    """Return one vector (3,), checked as `as_vectors` does it."""
    return as_vectors(as_array(values, name, "(3,) float")[None], name)[0]


def as_triples(values: ArrayLike, name: str) -> FloatArray:
    """Check the shape and type as `as_vectors` does, but not the numbers."""
    array = as_array(values, name, "(n, 3) float")
    if array.dtype.kind not in "fiu":
        raise ArgumentError(f"{name} must be (n, 3) float; got {shape_and_dtype(array)}. Convert it to numbers.")
    if array.ndim != 2 or array.shape[1] != 3:
        hint = ""
        if array.shape == (3,):
            hint = " Add a leading axis: values[None]."
        elif array.ndim == 2 and array.shape[0] == 3:
            hint = " Transpose it?"
        raise ArgumentError(f"{name} must be (n, 3) float; got {shape_and_dtype(array)}.{hint}")
    return np.ascontiguousarray(array, dtype=np.float64)


@njit(cache=True)
def have_safe_norms(bits: NDArray[np.int64]) -> bool:
    """Return whether n directions are all of usual length: the largest component from `SHORTEST` to 1 / that.

    Parameters
    ----------
    bits : (3 n,) int64
        The bits of float64, which without their sign are in the order of the sizes: so several are compared at a time,
        and what is not a number is larger than any.
    """
    size = np.int64(2**63 - 1)
    least, largest = size, np.int64(0)
    for i in range(len(bits) // 3):
        x, y, z = bits[3 * i] & size, bits[3 * i + 1] & size, bits[3 * i + 2] & size
        most = max(max(x, y), z)
        least, largest = min(least, most), max(largest, most)
    return bool(least >= _SHORTEST_BITS) & bool(largest <= _LONGEST_BITS)


def rescale_directions(directions: FloatArray) -> FloatArray:
    """Return the same directions, shortened or lengthened by powers of two where not all are of usual length.

    Parameters
    ----------
    directions : (n, 3) float64, C-contiguous
        Where all are of usual length they are returned themselves. Powers of two round nothing.

    Raises
    ------
    ArgumentError
        One is zero, not finite, or too large.
    """
    if have_safe_norms(directions.reshape(-1).view(np.int64)):
        return directions
    largest = np.abs(as_vectors(directions, "directions")).max(axis=1)
    if not largest.all():
        raise ArgumentError(f"directions must have a length; row {int(largest.argmin())} is zero. Leave it out.")
    return np.asarray(np.ldexp(directions, -np.frexp(largest)[1][:, None]))


def as_indices(values: ArrayLike, name: str, *, columns: int | None, upper: int, lowest: int = 0) -> IntArray:
    """Check an integer array of indices in ``[lowest, upper)``.

    Parameters
    ----------
    values : array_like of int, (n,) when `columns` is None, else (n, columns)
    name : str
    columns : int or None
    upper : int
        One past the largest index allowed.
    lowest : int
        The smallest index allowed; -1 where -1 means "none".

    Returns
    -------
    int32, C-contiguous, of the same shape.

    Raises
    ------
    ArgumentError
        Wrong shape, not integers, or an index out of range.
    """
    want = "(n,)" if columns is None else f"(n, {columns})"
    array = as_array(values, name, f"{want} int")
    right_shape = array.ndim == 1 if columns is None else array.ndim == 2 and array.shape[1] == columns
    if array.size == 0 and right_shape:
        return np.ascontiguousarray(array, dtype=np.int32)
    if array.dtype.kind not in "iu":
        raise ArgumentError(f"{name} must be {want} int; got {shape_and_dtype(array)}. Convert it with astype(int).")
    if not right_shape:
        raise ArgumentError(f"{name} must be {want} int; got {shape_and_dtype(array)}.")
    low, high = int(array.min()), int(array.max())
    if low < lowest or high >= upper:
        raise ArgumentError(f"{name} must lie in [{lowest}, {upper}); got values from {low} to {high}.")
    return np.ascontiguousarray(array, dtype=np.int32)


def readonly_copy(array: NDArray[Any]) -> Any:
    """Return a read-only copy, so that neither the caller nor we can change what was checked."""
    return set_readonly(array.copy())


def set_readonly(array: NDArray[Any]) -> Any:
    """Make an array without other references read-only, and return it."""
    array.flags.writeable = False
    return array


class ReadOnlyArrays:
    """Base of values with read-only arrays: they are that in another process too.

    A pickle forgets it, and for writable arrays numba compiles every kernel a second time.
    """

    def __setstate__(self, state: dict[str, Any]) -> None:
        arrays = {name: set_readonly(value) for name, value in state.items() if isinstance(value, np.ndarray)}
        vars(self).update(state | arrays)
