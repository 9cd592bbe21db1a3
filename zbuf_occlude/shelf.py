"""Shelf: a sequence kept as bytes and unpickled where it is asked for; a million things are two arrays to be shared."""

import pickle
from collections.abc import Iterator, Sequence
from typing import Generic, TypeVar, overload

import numpy as np

BUNDLE = 64
"""Things are pickled this many at a time: their common parts, such as classes and folders, stand there once."""

Thing = TypeVar("Thing")


class Shelf(Sequence[Thing], Generic[Thing]):
    """Things by their index, of which only the bundle is in memory that was asked for last.

    Parameters
    ----------
    things : sequence
        All of which can be pickled.
    """

    def __init__(self, things: Sequence[Thing]) -> None:
        bundles = [pickle.dumps(tuple(things[i : i + BUNDLE]), protocol=5) for i in range(0, len(things), BUNDLE)]
        self._n = len(things)
        self._ends = np.cumsum([0, *map(len, bundles)])
        self._bytes = np.frombuffer(b"".join(bundles), np.uint8)
        self._last: tuple[int, tuple[Thing, ...]] = (-1, ())

    def __len__(self) -> int:
        return self._n

    @overload
    def __getitem__(self, index: int) -> Thing: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Thing, ...]: ...
    def __getitem__(self, index: int | slice) -> Thing | tuple[Thing, ...]:
        """Return a thing, or for a slice a tuple."""
        if isinstance(index, slice):
            return tuple(self[i] for i in range(*index.indices(self._n)))
        bundle, place = divmod(range(self._n)[index], BUNDLE)
        return self._bundle(bundle)[place]

    def __iter__(self) -> Iterator[Thing]:
        for bundle in range(len(self._ends) - 1):
            yield from self._bundle(bundle)

    def _bundle(self, number: int) -> tuple[Thing, ...]:
        known, things = self._last  # read once: another thread may be here
        if known != number:
            things = pickle.loads(self._bytes[self._ends[number] : self._ends[number + 1]].tobytes())
            self._last = number, things
        return things
