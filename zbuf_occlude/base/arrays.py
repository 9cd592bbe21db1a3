"""Checks of arrays, numbers and flags at the public interface; internal code relies on them."""

import math
from collections.abc import Callable
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.base.errors import ArgumentError, shown
from zbuf_occlude.base.jit.compiler import njit

LARGEST = 1e70
"""Largest absolute coordinate: the fourth power of longer lengths (areas squared) would overflow."""

MAX_STEP = 2e-4
"""Largest distance between neighbouring float32 numbers, relative to the longest side of what is stored in them."""

SHORTEST = 1e-20
"""Shortest direction with a safe norm, its inverse the longest: others would underflow or overflow in products."""

_SHORTEST_BITS, _LONGEST_BITS = (int(bits) for bits in np.array([SHORTEST, 1.0 / SHORTEST]).view(np.int64))

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]
BoolArray = NDArray[np.bool_]


def unit_vectors(vectors: FloatArray) -> FloatArray:
    """Return vectors (..., 3) scaled to length 1; zero vectors stay zero."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), np.finfo(np.float64).tiny))


def float32_fault(positions: FloatArray) -> str:
    """Return why positions (n, 3) are too far from the origin, for their extent, to be stored in float32; else ""."""
    low, high = positions.min(axis=0, initial=np.inf), positions.max(axis=0, initial=-np.inf)
    reach, side = float(np.maximum(-low, high).max()), float((high - low).max())
    with np.errstate(over="ignore"):
        nearest = np.float32(max(reach, 0.0))
    step = float(np.spacing(nearest)) if np.isfinite(nearest) else np.inf
    if side <= 0.0 or step <= MAX_STEP * side:
        return ""
    return (
        f"coordinates reach {reach:.9g}, where float32 numbers are {step:.2g} apart: too coarse for a longest side of "
        f"{side:.3g}"
    )


def shape_and_dtype(values: Any) -> str:
    """Return shape and dtype of array-like values, e.g. ``(3, 100) float32``."""
    try:
        array = np.asarray(values)
    except ValueError:
        return "rows of unequal length"
    return f"{array.shape} {array.dtype}"


def as_array(values: ArrayLike, name: str, want: str, remedy: str = "Pass one array.") -> NDArray[Any]:
    """Return values as an array of any shape and type.

    Raises ArgumentError for rows of unequal length, and for tensors that NumPy does not read: PyTorch says why.
    """
    try:
        return np.asarray(values)
    except ValueError:
        raise ArgumentError(f"{name} must be {want}; got rows of unequal length. {remedy}") from None
    except (RuntimeError, TypeError) as error:  # a tensor with a gradient; one on a GPU, or sparse
        raise ArgumentError(f"{name} must be {want}; got a {type(values).__name__}: {error}") from None


def as_numbers(values: ArrayLike, name: str, shape: tuple[int, ...], hint: str = "") -> FloatArray:
    """Return values as float64; raise ArgumentError unless they are numbers in an array of the given shape."""
    array = as_array(values, name, str(shape or "a number"), hint.strip() or "Pass one array.")
    if array.dtype.kind not in "fiu" or array.shape != shape:
        raise ArgumentError(f"{name} must be {shape or 'a number'}; got {shape_and_dtype(values)}.{hint}")
    return np.asarray(array, dtype=np.float64)


def as_number(value: Any, name: str, want: str, fits: Callable[[float], bool] = lambda number: True) -> float:
    """Return a value as a float; raise ArgumentError unless it is a finite real number that fits.

    Parameters
    ----------
    value : real number
        Neither a bool nor a str.
    name, want : str
        Parts of the message: "{name} must be {want}; got ...".
    fits : callable
        Predicate on a finite number.
    """
    try:
        number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    except OverflowError:
        number = math.inf
    if not (math.isfinite(number) and fits(number)):
        raise ArgumentError(f"{name} must be {want}; got {shown(value)}.")
    return number


def as_flag(value: Any, name: str) -> bool:
    """Return a bool; raise ArgumentError for other values, such as the str "no", which is true."""
    if not isinstance(value, bool | np.bool_):
        raise ArgumentError(f"{name} must be True or False; got {shown(value)}.")
    return bool(value)


def as_vectors(values: ArrayLike, name: str) -> FloatArray:
    """Check an array of 3-vectors.

    Parameters
    ----------
    values : array_like, (n, 3), any real dtype
    name : str
        Name of the argument, which starts the error message.

    Returns
    -------
    (n, 3) float64, C-contiguous, all finite. The input itself if it already is such an array.

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
    """Return one vector (3,), checked as by `as_vectors`."""
    return as_vectors(as_numbers(values, name, (3,))[None], name)[0]


def as_triples(values: ArrayLike, name: str) -> FloatArray:
    """Check the shape and type as `as_vectors`, but not the numbers."""
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
    """Return whether the norms of n directions are safe: the largest component is within `SHORTEST` and its inverse.

    Parameters
    ----------
    bits : (3 n,) int64
        Bit patterns of the float64. Without their sign they are ordered as the absolute values, with NaN above all
        numbers, and their comparison vectorises.
    """
    size = np.int64(2**63 - 1)
    least, largest = size, np.int64(0)
    for i in range(len(bits) // 3):
        x, y, z = bits[3 * i] & size, bits[3 * i + 1] & size, bits[3 * i + 2] & size
        most = max(max(x, y), z)
        least, largest = min(least, most), max(largest, most)
    return bool(least >= _SHORTEST_BITS) & bool(largest <= _LONGEST_BITS)


def rescale_directions(directions: FloatArray) -> FloatArray:
    """Return directions scaled by powers of two, which is exact, unless all have safe norms.

    Parameters
    ----------
    directions : (n, 3) float64, C-contiguous
        Returned themselves if all have safe norms.

    Raises
    ------
    ArgumentError
        A direction is zero, not finite, or too large.
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
        The smallest index allowed; -1 if -1 stands for none.

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


def as_selection(which: ArrayLike, n: int, things: str) -> NDArray[np.intp]:
    """Return the indices of those of n things that a boolean mask (n,) or an index array (m,) selects.

    `things` names them in the message. Raises ArgumentError for anything else, and for an index of none of them.
    """
    want = "a mask or indices, (m,) bool or int"
    chosen = as_array(which, "which", want)
    if chosen.ndim != 1 or (chosen.size and chosen.dtype.kind not in "biu"):
        raise ArgumentError(f"which must be {want}; got {shape_and_dtype(chosen)}.")
    if chosen.dtype.kind == "b":
        if len(chosen) != n:
            raise ArgumentError(f"which must pick among {n} {things}; boolean it has {len(chosen)} entries.")
        return np.flatnonzero(chosen)
    if (outside := chosen[(chosen < -n) | (chosen >= n)]).size:
        raise ArgumentError(f"which must pick among {n} {things}; index {outside[0]} is out of bounds.")
    return chosen.astype(np.intp, copy=False)


def readonly_copy(array: NDArray[Any]) -> Any:
    """Return a read-only copy, so that checked values cannot change."""
    return set_readonly(array.copy())


def set_readonly(array: NDArray[Any]) -> Any:
    """Make an array without other references read-only, and return it."""
    array.flags.writeable = False
    return array


class ReadOnlyArrays:
    """Base class of objects whose arrays stay read-only when they are unpickled.

    Unpickled arrays are writable, for which numba would compile every kernel a second time.
    """

    def __setstate__(self, state: dict[str, Any]) -> None:
        arrays = {name: set_readonly(value) for name, value in state.items() if isinstance(value, np.ndarray)}
        vars(self).update(state | arrays)
