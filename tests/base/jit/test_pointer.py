"""Pointers to NamedTuples: fields are read and written through; an unknown field is refused."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError

from zbuf_occlude.base.jit.pointer import pointer_to


class Inner(NamedTuple):
    values: Any


class Outer(NamedTuple):
    number: int
    table: Any
    pair: tuple[float, float]
    inner: Inner


def some() -> Outer:
    return Outer(7, np.arange(6.0).reshape(2, 3), (0.25, 0.5), Inner(np.array([3, 4], dtype=np.int32)))


@njit(_nrt=False)
def _inner_kernel(outer):
    outer.table[1, 2] += outer.number
    outer.inner.values[0] = outer.table.shape[0]
    return outer.pair[1] + outer.inner.values[1]


@njit(_nrt=False)
def _kernel(outer):
    return _inner_kernel(pointer_to(outer))


def test_fields_are_the_tuples_own() -> None:
    outer = some()
    assert _kernel(outer) == 4.5
    assert outer.table[1, 2] == 12.0
    assert outer.inner.values.tolist() == [2, 4]


def test_a_field_that_is_not_there_is_refused() -> None:
    @njit(_nrt=False)
    def kernel(outer):
        return pointer_to(outer).nothing

    with pytest.raises(TypingError, match="Unknown attribute 'nothing'"):
        kernel(some())
