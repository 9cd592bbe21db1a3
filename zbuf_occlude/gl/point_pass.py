"""The points on the GPU: reprojected and tested against the depth atlas, one bit a point and eye."""

from typing import Any

import numpy as np

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.geometry.hilbert import hilbert_order
from zbuf_occlude.gl.buffers import Buffers, parts
from zbuf_occlude.gl.context import GlContext
from zbuf_occlude.gl.point_data import GROUP, Batch, PointData

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


class UploadedPoints:
    """Points on the GPU, in the order in which neighbours look at neighbouring pixels.

    Parameters
    ----------
    gl : GlContext
    points : PointData
        At most `MOST_POINTS`.

    Notes
    -----
    GPU memory: 32 bytes per point.
    """

    def __init__(self, gl: GlContext, points: PointData) -> None:
        order = hilbert_order(points.positions)
        n_blocks = -(-len(order) // BLOCK)
        slots = np.resize(order, n_blocks * BLOCK)  # repeats points to fill the last block
        records = np.zeros(len(order), dtype=POINT)
        records["position"], records["normal"] = points.positions, points.normals
        records["own"] = points.own
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
    """Some points on the GPU, and their answers.

    Parameters
    ----------
    gl : GlContext
    points : UploadedPoints
        The caller's.
    out : (k, n) bool
        Receives the answers.
    n_groups : int
        Groups of answers that there is to be room for.
    most_eyes : int
        Of a batch.
    doubts : bool
        Whether there is to be room for a list of doubtful pairs.

    Notes
    -----
    GPU memory: a byte a point and group, and at most 16 MiB for the list of doubtful pairs.
    """

    def __init__(
        self,
        gl: GlContext,
        points: UploadedPoints,
        out: BoolArray,
        *,
        n_groups: int,
        most_eyes: int,
        doubts: bool,
    ) -> None:
        self._ctx, self._points, self._out = gl.ctx, points, out
        self._n_words = points.n_slots // 4
        self._answers = np.empty((n_groups, points.n_slots), dtype=np.uint8)
        listed = 4 * min(points.n_slots * most_eyes, MOST_LISTED)
        lists = {"count": 4, "doubtful": listed} if doubts else {}
        self._buffers = Buffers(gl, answers=self._answers.nbytes, **lists)

    def ask(self, batch: Batch, answer: Any, decide: Any = None) -> None:
        """Answer for a batch, which has just been drawn; `finish` fetches the answers.

        Parameters
        ----------
        batch : Batch
        answer, decide : moderngl.ComputeShader
            depth_test.comp alone, or vote.comp and witness.comp.
        """
        self._points.buffers.bind(points=0)
        self._buffers.bind(answers=1)
        if decide is not None:
            self._buffers.bind(count=2, doubtful=3)
        for program in (answer, decide):
            set_uniforms(
                program,
                n_eyes=batch.n_eyes,
                first_word=batch.first_group * self._n_words,
                n_words=self._n_words,
            )
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

    def finish(self, batches: list[Batch]) -> None:
        """Fetch the answers to all batches."""
        self._buffers.read_into("answers", self._answers)
        chosen = np.empty(len(self._points.bytes), dtype=np.uint8)
        bit = np.empty_like(chosen)
        for batch in batches:
            for eye in range(batch.n_eyes):
                group, place = divmod(eye, GROUP)
                if place == 0:
                    np.take(self._answers[batch.first_group + group], self._points.bytes, out=chosen, mode="clip")
                np.bitwise_and(chosen, 1 << place, out=bit)
                np.not_equal(bit, 0, out=self._out[batch.first_eye + eye])

    def release(self) -> None:
        """Give the GPU's memory back; calling it again does nothing."""
        self._buffers.release()


def set_uniforms(program: Any, **values: Any) -> None:
    """Set those of the uniforms that the compiler has not found to be unused; nothing without a program."""
    for name, value in values.items():
        if program is not None and name in program:
            program[name].value = value
