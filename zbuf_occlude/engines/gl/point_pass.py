"""Point pass: points projected on the GPU and tested against the depth atlas, one bit per point and eye."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.engines.gl.buffers import Buffers, parts
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.engines.gl.shaders import set_uniforms
from zbuf_occlude.engines.gl.tiles import EYES_PER_BYTE
from zbuf_occlude.geometry.hilbert import hilbert_order

MAX_HIDDEN = 0.3
"""Maximum share of the weighted votes for "hidden" with which a point without a witness is visible."""

BLOCK = 256
"""Points of a work group of 64 invocations, four each."""

MAX_POINTS = 1 << 20
"""Maximum points of one buffer: an entry of the list of doubtful pairs has 20 bits for the point."""

MAX_LISTED = 1 << 22
"""Maximum pairs of eye and point of one dispatch: the list of doubtful pairs has room for all of them."""

POINT = np.dtype([("position", "<f4", 3), ("own", "<i4"), ("normal", "<f4", 3), ("unused", "<u4")])
"""Record of a point: two uvec4 of shaders/include/points.glsl."""

_MAX_GROUPS = 65535
"""Work groups along an axis that every driver allows."""

_STRIDED_GROUPS = 128
"""Work groups among which the doubtful pairs are divided."""


class EyeBatch(NamedTuple):
    """Range of eyes that are drawn and tested together, and the first of their groups of answers."""

    first_eye: int
    n_eyes: int
    first_group: int

    @property
    def n_groups(self) -> int:
        """Number of groups of `EYES_PER_BYTE` eyes; the last may not be full."""
        return -(-self.n_eyes // EYES_PER_BYTE)


def batches_of(n_eyes: int, most: int) -> list[EyeBatch]:
    """Divide eyes into the fewest batches of at most `most`, of equal length, each of whole groups of answers."""
    batches: list[EyeBatch] = []
    length = -(-n_eyes // -(-n_eyes // most))
    # a group that is not full takes as long as a full one
    length = min(most, -(-length // EYES_PER_BYTE) * EYES_PER_BYTE)
    for first in range(0, n_eyes, length):
        group = batches[-1].first_group + batches[-1].n_groups if batches else 0
        batches.append(EyeBatch(first, min(length, n_eyes - first), group))
    return batches


class UploadedPoints:
    """Points on the GPU, at most `MAX_POINTS`, in Hilbert order so that neighbours access neighbouring pixels.

    Parameters
    ----------
    gl : GlContext
    positions : (n, 3) float64
        Unit space.
    normals : (n, 3) float32
        Unit normals of their faces; 0 for none.
    own : (n,) int
        Rank of the own face in drawing order, -1 for none.
    """

    def __init__(self, gl: GlContext, positions: FloatArray, normals: NDArray[np.float32], own: IntArray) -> None:
        order = hilbert_order(positions)
        n_blocks = -(-len(order) // BLOCK)
        slots = np.resize(order, n_blocks * BLOCK)  # the last block is padded by repeated points
        records = np.zeros(len(order), dtype=POINT)
        records["position"], records["normal"], records["own"] = positions, normals, own
        # the byte of each slot: an invocation's four slots are 64 apart, and their answers form a word
        bytes_of_slots = np.arange(len(slots)).reshape(n_blocks, 64, 4).transpose(0, 2, 1).reshape(-1)
        self.bytes = np.empty(len(order), dtype=np.int64)
        self.bytes[order] = bytes_of_slots[: len(order)]
        self.n_slots = len(slots)
        self.buffers = Buffers(gl, points=records[slots])

    def release(self) -> None:
        """Free the GPU's memory; calling it again does nothing."""
        self.buffers.release()


class PointPass:
    """Answers for points: a byte per point and group of eyes, and at most 16 MiB for a list of doubtful pairs.

    `out`, (k, n) bool, receives the answers to `batches`. If `doubts` is True, doubtful pairs are listed.
    """

    def __init__(
        self, gl: GlContext, points: UploadedPoints, out: BoolArray, batches: list[EyeBatch], *, doubts: bool
    ) -> None:
        self._ctx, self._points, self._out, self._batches = gl.ctx, points, out, batches
        self._n_words = points.n_slots // 4
        n_groups = sum(batch.n_groups for batch in batches)
        self._answers = np.empty((n_groups, points.n_slots), dtype=np.uint8)
        listed = 4 * min(points.n_slots * max(batch.n_eyes for batch in batches), MAX_LISTED)
        lists = {"count": 4, "doubtful": listed} if doubts else {}
        self._buffers = Buffers(gl, answers=self._answers.nbytes, **lists)

    def test(self, batch: EyeBatch, answer: Any, decide: Any = None) -> None:
        """Test the points against a batch just drawn, by depth_test.comp alone or vote.comp and witness.comp."""
        self._points.buffers.bind(points=0)
        self._buffers.bind(answers=1)
        if decide is not None:
            self._buffers.bind(count=2, doubtful=3)
        for program in (answer, decide):
            first_word = batch.first_group * self._n_words
            set_uniforms(program, n_eyes=batch.n_eyes, first_word=first_word, n_words=self._n_words)
        n_blocks = self._n_words // 64
        for part in parts(n_blocks, min(MAX_LISTED // (BLOCK * batch.n_eyes), _MAX_GROUPS)):
            if decide is not None:
                self._buffers.clear("count")
            set_uniforms(answer, first_block=part.start)
            answer.run(part.stop - part.start, batch.n_groups)
            self._ctx.memory_barrier()
            if decide is not None:
                decide.run(_STRIDED_GROUPS)
                self._ctx.memory_barrier()

    def fetch(self) -> None:
        """Read back the answers to all batches."""
        self._buffers.read_into("answers", self._answers)
        chosen = np.empty(len(self._points.bytes), dtype=np.uint8)
        bit = np.empty_like(chosen)
        for batch in self._batches:
            for eye in range(batch.n_eyes):
                group, position = divmod(eye, EYES_PER_BYTE)
                if position == 0:
                    np.take(self._answers[batch.first_group + group], self._points.bytes, out=chosen, mode="clip")
                np.bitwise_and(chosen, 1 << position, out=bit)
                np.not_equal(bit, 0, out=self._out[batch.first_eye + eye])

    def release(self) -> None:
        """Free the GPU's memory; calling it again does nothing."""
        self._buffers.release()
