"""A shelf is the sequence that it was made of, wherever it has travelled."""

import pickle

import pytest

from zbuf_occlude.meshes.collection import BUNDLE, Shelf


@pytest.mark.parametrize("n", [0, 1, BUNDLE, 2 * BUNDLE + 1])
def test_a_shelf_is_the_sequence_it_was_made_of(n: int) -> None:
    things = [(f"thing {i}", i) for i in range(n)]
    for shelf in (Shelf(things), pickle.loads(pickle.dumps(Shelf(things)))):
        assert len(shelf) == n
        assert list(shelf) == things
        assert [shelf[i] for i in reversed(range(n))] == things[::-1]
        assert shelf[-3:] == tuple(things[-3:])
        with pytest.raises(IndexError):
            shelf[n]
