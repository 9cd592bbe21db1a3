"""The points on the GPU: reprojected and tested against the depth atlas, one bit a point and eye."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.geometry.hilbert import hilbert_order
from zbuf_occlude.gl.buffers import Buffers, parts
from zbuf_occlude.gl.context import GlContext
from zbuf_occlude.gl.shaders import set_uniforms
from zbuf_occlude.gl.tiles import EYES_PER_BYTE

MOST_HIDDEN = 0.3
"""Without a witness, a point is visible when no more than this of the weighed votes around it says hidden."""

BLOCK = 256
"""Points of a work group of 64 invocations, four each."""

MOST_POINTS = 1 << 20
"""In one buffer; a place in the list of doubtful pairs has 20 bits for the point."""

MOST_LISTED = 1 << 22
"""Pairs of eye and point that one dispatch asks, at most: the list of doubtful ones has room for all of them."""

POINT = np.dtype([("position", "<f4", 3), ("own", "<i4"), ("normal", "<f4", 3), ("unused", "<u4")])
"""Two uvec4 of shaders/include/points.glsl."""

_MOST_GROUPS = 65535
"""What every driver allows of work groups along an axis."""

_STRIDED_GROUPS = 128
"""Work groups that share out the doubtful pairs among them."""


class EyeBatch(NamedTuple):
    """Eyes that are drawn and asked together: their numbers, and where their groups of answers lie."""

    first_eye: int
    n_eyes: int
    first_group: int

    @property
    def n_groups(self) -> int:
        """How many groups of `EYES_PER_BYTE` eyes there are; the last may not be full."""
        return -(-self.n_eyes // EYES_PER_BYTE)


def batches_of(n_eyes: int, most: int) -> list[EyeBatch]:
    """Cut eyes into the fewest batches of at most `most`, equally long, each with whole groups of answers."""
    batches: list[EyeBatch] = []
    length = -(-n_eyes // -(-n_eyes // most))
    # among several groups, one that is not full takes as long
    length = min(most, -(-length // EYES_PER_BYTE) * EYES_PER_BYTE)
    for first in range(0, n_eyes, length):
        group = batches[-1].first_group + batches[-1].n_groups if batches else 0
        batches.append(EyeBatch(first, min(length, n_eyes - first), group))
    return batches


class UploadedPoints:
    """At most `MOST_POINTS` points on the GPU, in the order in which neighbours look at neighbouring pixels.

    Parameters
    ----------
    gl : GlContext
    positions : (n, 3) float64
        Unit space.
    normals : (n, 3) float32
        Of their faces, unit length; 0 for none.
    own : (n,) int
        Place of the own face in the order of drawing, -1 for none.
    """

    def __init__(self, gl: GlContext, positions: FloatArray, normals: NDArray[np.float32], own: IntArray) -> None:
        order = hilbert_order(positions)
        n_blocks = -(-len(order) // BLOCK)
        slots = np.resize(order, n_blocks * BLOCK)  # repeats points to fill the last block
        records = np.zeros(len(order), dtype=POINT)
        records["position"], records["normal"], records["own"] = positions, normals, own
        # the byte of each slot: an invocation's four slots are 64 apart, their answers make a word
        bytes_of_slots = np.arange(len(slots)).reshape(n_blocks, 64, 4).transpose(0, 2, 1).reshape(-1)
        self.bytes = np.empty(len(order), dtype=np.int64)
        self.bytes[order] = bytes_of_slots[: len(order)]
        self.n_slots = len(slots)
        self.buffers = Buffers(gl, points=records[slots])

    def release(self) -> None:
        """Give the GPU's memory back; calling it again does nothing."""
        self.buffers.release()


class PointPass:
    """The answers for some points: a byte a point and group, and at most 16 MiB for a list of doubtful pairs.

    `out`, (k, n) bool, receives the answers to `batches`; `doubts`: whether doubtful pairs are listed.
    """

    def __init__(
        self, gl: GlContext, points: UploadedPoints, out: BoolArray, batches: list[EyeBatch], *, doubts: bool
    ) -> None:
        self._ctx, self._points, self._out, self._batches = gl.ctx, points, out, batches
        self._n_words = points.n_slots // 4
        n_groups = sum(batch.n_groups for batch in batches)
        self._answers = np.empty((n_groups, points.n_slots), dtype=np.uint8)
        listed = 4 * min(points.n_slots * max(batch.n_eyes for batch in batches), MOST_LISTED)
        lists = {"count": 4, "doubtful": listed} if doubts else {}
        self._buffers = Buffers(gl, answers=self._answers.nbytes, **lists)

    def ask(self, batch: EyeBatch, answer: Any, decide: Any = None) -> None:
        """Answer for a batch, which has just been drawn, by depth_test.comp alone or vote.comp and witness.comp."""
        self._points.buffers.bind(points=0)
        self._buffers.bind(answers=1)
        if decide is not None:
            self._buffers.bind(count=2, doubtful=3)
        for program in (answer, decide):
            first_word = batch.first_group * self._n_words
            set_uniforms(program, n_eyes=batch.n_eyes, first_word=first_word, n_words=self._n_words)
        n_blocks = self._n_words // 64
        for part in parts(n_blocks, min(MOST_LISTED // (BLOCK * batch.n_eyes), _MOST_GROUPS)):
            if decide is not None:
                self._buffers.clear("count")
            set_uniforms(answer, first_block=part.start)
            answer.run(part.stop - part.start, batch.n_groups)
            self._ctx.memory_barrier()
            if decide is not None:
                decide.run(_STRIDED_GROUPS)
                self._ctx.memory_barrier()

    def finish(self) -> None:
        """Fetch the answers to all batches."""
        self._buffers.read_into("answers", self._answers)
        chosen = np.empty(len(self._points.bytes), dtype=np.uint8)
        bit = np.empty_like(chosen)
        for batch in self._batches:
            for eye in range(batch.n_eyes):
                group, place = divmod(eye, EYES_PER_BYTE)
                if place == 0:
                    np.take(self._answers[batch.first_group + group], self._points.bytes, out=chosen, mode="clip")
                np.bitwise_and(chosen, 1 << place, out=bit)
                np.not_equal(bit, 0, out=self._out[batch.first_eye + eye])

    def release(self) -> None:
        """Give the GPU's memory back; calling it again does nothing."""
        self._buffers.release()
