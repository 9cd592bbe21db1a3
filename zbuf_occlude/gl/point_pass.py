"""The points on the GPU: reprojected and tested against the depth atlas, one bit a point and eye."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.gl.buffers import Buffers
from zbuf_occlude.gl.hilbert import hilbert_order

GROUP = 8
"""Eyes whose answers share a byte."""

BLOCK = 256
"""Points of a work group of 64 invocations, four each."""

MOST_POINTS = 1 << 19
"""In one buffer; the list of doubtful pairs, which has room for all, then takes at most 96 MiB (48 eyes)."""

POINT = np.dtype([("position", "<f4", 3), ("own", "<i4"), ("normal", "<f4", 3), ("unused", "<u4")])
"""Two uvec4 of shaders/include/points.glsl."""

_STRIDED_GROUPS = 512
"""Work groups that share out the doubtful pairs among them."""


class Batch(NamedTuple):
    """Eyes that are drawn and asked together: their numbers, and where their groups of answers lie."""

    first_eye: int
    n_eyes: int
    first_group: int

    @property
    def n_groups(self) -> int:
        """How many groups of `GROUP` eyes there are; the last may not be full."""
        return -(-self.n_eyes // GROUP)


class PointPass:
    """Some points on the GPU, and their answers.

    Parameters
    ----------
    ctx : moderngl.Context
    positions, normals : (n, 3) float
        Unit space, at most `MOST_POINTS`.
    own : (n,) int
        Index of the own face among those drawn, -1 for none.
    n_groups : int
        Groups of answers that there is to be room for.
    most_eyes : int
        Of a batch whose doubtful pairs are to be listed; 0 for no list.

    Notes
    -----
    GPU memory: 32 bytes a point, a byte a point and group, and 4 bytes a point and eye of a batch for the list.
    """

    def __init__(
        self, ctx: Any, positions: FloatArray, normals: FloatArray, own: IntArray, *, n_groups: int, most_eyes: int
    ) -> None:
        self._ctx = ctx
        # neighbours along the curve look at neighbouring pixels, which caches like
        order = hilbert_order(positions)
        n_blocks = -(-len(order) // BLOCK)
        slots = np.resize(order, n_blocks * BLOCK)  # repeats points to fill the last block
        points = np.empty(len(slots), dtype=POINT)
        points["position"], points["normal"], points["own"] = positions[slots], normals[slots], own[slots]
        # the byte of each slot: an invocation's four slots are 64 apart, their answers make a word
        bytes_of_slots = np.arange(len(slots)).reshape(n_blocks, 64, 4).transpose(0, 2, 1).reshape(-1)
        self._bytes = np.empty(len(order), dtype=np.int64)
        self._bytes[order] = bytes_of_slots[: len(order)]
        self._n_words = len(slots) // 4
        self._answers = np.empty((n_groups, len(slots)), dtype=np.uint8)
        listed = {"count": 4, "doubtful": 4 * len(slots) * most_eyes} if most_eyes else {}
        self._buffers = Buffers(ctx, points=points, answers=self._answers.nbytes, **listed)

    def vote(self, program: Any, batch: Batch) -> None:
        """Answer for a batch by depth_test.comp, or by vote.comp, which lists the pairs that are doubtful."""
        self._buffers.bind(points=0, answers=2)
        if "Doubtful" in program:
            self._buffers.write("count", np.zeros(1, dtype=np.uint32))
            self._buffers.bind(count=3, doubtful=4)
        self._set(program, batch)
        program.run(self._n_words // 64, batch.n_groups)
        self._ctx.memory_barrier()

    def decide(self, program: Any, batch: Batch) -> None:
        """Decide the doubtful pairs of the last vote by witness.comp."""
        self._set(program, batch)
        program.run(_STRIDED_GROUPS)
        self._ctx.memory_barrier()

    def _set(self, program: Any, batch: Batch) -> None:
        set_uniforms(
            program,
            first_eye=batch.first_eye,
            n_eyes=batch.n_eyes,
            first_word=batch.first_group * self._n_words,
            n_words=self._n_words,
        )

    def read_into(self, mask: BoolArray, batches: list[Batch]) -> None:
        """Write the answers to (eyes, n) bool; row i is eye i of those the batches number."""
        self._buffers.read_into("answers", self._answers)
        chosen = np.empty(len(self._bytes), dtype=np.uint8)
        bit = np.empty_like(chosen)
        for batch in batches:
            for eye in range(batch.n_eyes):
                group, place = divmod(eye, GROUP)
                if place == 0:
                    np.take(self._answers[batch.first_group + group], self._bytes, out=chosen, mode="clip")
                np.bitwise_and(chosen, 1 << place, out=bit)
                np.not_equal(bit, 0, out=mask[batch.first_eye + eye])

    def release(self) -> None:
        """Give the GPU's memory back; calling it again does nothing."""
        self._buffers.release()


def set_uniforms(program: Any, **values: Any) -> None:
    """Set those of the uniforms that the compiler has not found to be unused."""
    for name, value in values.items():
        if name in program:
            program[name].value = value


def drawn_order(corners: FloatArray) -> NDArray[np.int64]:
    """Return the order in which to draw faces (f, 3, 3): along a space-filling curve, so that tiles stay in caches."""
    return hilbert_order(corners.mean(axis=1))
