"""Storage buffers: sizes, the driver's limit, contents there and back, release."""

import numpy as np
import pytest

from zbuf_occlude.base.errors import GlError
from zbuf_occlude.engines.gl import buffers
from zbuf_occlude.engines.gl.buffers import Buffers, parts
from zbuf_occlude.engines.gl.context import GlContext


def test_parts_are_few_and_cover_all() -> None:
    assert [(p.start, p.stop) for p in parts(10, 4)] == [(0, 4), (4, 8), (8, 10)]
    assert [(p.start, p.stop) for p in parts(4, 4)] == [(0, 4)]


def test_contents_there_and_back(gl: GlContext) -> None:
    numbers, back = np.arange(6, dtype=np.uint32), np.empty(3, dtype=np.uint32)
    with Buffers(gl, numbers=numbers) as some:
        some.read_into("numbers", back, offset=8)
        assert back.tolist() == [2, 3, 4]
        some.clear("numbers", 8)
        some.read_into("numbers", back)
        assert back.tolist() == [0, 0, 2]
        some.clear("numbers")
        some.read_into("numbers", back)
        assert back.tolist() == [0, 0, 0]
    some.release()
    some.release()


def test_a_buffer_over_the_limit_is_refused(gl: GlContext, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(buffers, "block_limit", lambda gl: 100)
    with pytest.raises(GlError, match="numbers must fit into a storage block of 100 bytes; it has 104"):
        Buffers(gl, numbers=np.zeros(26, dtype=np.float32))


def test_out_of_memory_is_an_error_where_it_happens(gl: GlContext, monkeypatch: pytest.MonkeyPatch) -> None:
    """Petabytes, as no driver here refuses what can be had: moderngl lets it pass, and the next user is blamed."""
    monkeypatch.setattr(buffers, "block_limit", lambda gl: 1 << 62)
    with pytest.raises(GlError, match="room of 1125899906842624 bytes must"):
        Buffers(gl, small=4, room=1 << 50)
    gl.check()


def test_answers_are_within_what_every_driver_shows(gl: GlContext, monkeypatch: pytest.MonkeyPatch) -> None:
    assert buffers.answer_limit(gl) <= 1 << 27
    monkeypatch.setattr(buffers, "block_limit", lambda gl: 1000)
    assert buffers.answer_limit(gl) == 1000
