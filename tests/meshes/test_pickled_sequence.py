"""It is the sequence that it was made of, wherever it has travelled."""

import pickle

import pytest

from zbuf_occlude.meshes.collection import BUNDLE, PickledSequence


@pytest.mark.parametrize("n", [0, 1, BUNDLE, 2 * BUNDLE + 1])
def test_it_is_the_sequence_it_was_made_of(n: int) -> None:
    things = [(f"thing {i}", i) for i in range(n)]
    for sequence in (PickledSequence(things), pickle.loads(pickle.dumps(PickledSequence(things)))):
        assert len(sequence) == n
        assert list(sequence) == things
        assert [sequence[i] for i in reversed(range(n))] == things[::-1]
        assert sequence[-3:] == tuple(things[-3:])
        with pytest.raises(IndexError):
            sequence[n]
