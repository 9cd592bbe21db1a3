"""The points on the GPU: reprojected and tested against the depth atlas, one bit a point and eye."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.gl.buffers import Buffers, parts

GROUP = 8
"""Eyes whose answers share a byte."""

BLOCK = 256
"""Points of a work group of 64 invocations, four each."""

MOST_POINTS = 1 << 20
"""In one buffer; a place in the list of doubtful pairs has 20 bits for the point."""

MOST_LISTED = 1 << 22
"""Pairs of eye and point that one dispatch asks, at most: the list of doubtful ones has room for all of them."""

POINT = np.dtype([("position", "<f4", 3), ("own", "<i4"), ("normal", "<f4", 3), ("closed", "<u4")])
"""Two uvec4 of shaders/include/points.glsl."""

_MOST_GROUPS = 65535
"""What every driver allows of work groups along an axis."""

_STRIDED_GROUPS = 128
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
    closed : (n,) bool
        Whether the own face's surface is closed, and the normal points outwards.
    n_groups : int
        Groups of answers that there is to be room for.
    most_eyes : int
        Of a batch whose doubtful pairs are to be listed; 0 for no list.

    Notes
    -----
    GPU memory: 32 bytes a point, a byte a point and group, and at most 16 MiB for the list of doubtful pairs.
    """

    def __init__(
        self,
        ctx: Any,
        positions: FloatArray,
        normals: NDArray[np.float32],
        own: IntArray,
        closed: BoolArray,
        *,
        n_groups: int,
        most_eyes: int,
    ) -> None:
        self._ctx = ctx
        order = coherent_order(positions, normals)
        n_blocks = -(-len(order) // BLOCK)
        slots = np.resize(order, n_blocks * BLOCK)  # repeats points to fill the last block
        points = np.empty(len(order), dtype=POINT)
        points["position"], points["normal"], points["own"], points["closed"] = positions, normals, own, closed
        points = points[slots]
        # the byte of each slot: an invocation's four slots are 64 apart, their answers make a word
        bytes_of_slots = np.arange(len(slots)).reshape(n_blocks, 64, 4).transpose(0, 2, 1).reshape(-1)
        self._bytes = np.empty(len(order), dtype=np.int64)
        self._bytes[order] = bytes_of_slots[: len(order)]
        self._n_words = len(slots) // 4
        self._answers = np.empty((n_groups, len(slots)), dtype=np.uint8)
        listed = {"count": 4, "doubtful": 4 * min(len(slots) * most_eyes, MOST_LISTED)} if most_eyes else {}
        self._buffers = Buffers(ctx, points=points, answers=self._answers.nbytes, **listed)

    def ask(self, batch: Batch, vote: Any, decide: Any = None) -> None:
        """Answer for a batch: by depth_test.comp, or by vote.comp with witness.comp for the pairs that are doubtful."""
        self._buffers.bind(points=0, answers=1)
        if decide is not None:
            self._buffers.bind(count=2, doubtful=3)
        for program in (vote, decide):
            set_uniforms(
                program,
                n_eyes=batch.n_eyes,
                first_word=batch.first_group * self._n_words,
                n_words=self._n_words,
            )
        n_blocks = self._n_words // 64
        for part in parts(n_blocks, min(MOST_LISTED // (BLOCK * batch.n_eyes), _MOST_GROUPS)):
            if decide is not None:
                self._buffers.write("count", np.zeros(1, dtype=np.uint32))
            set_uniforms(vote, first_block=part.start)
            vote.run(part.stop - part.start, batch.n_groups)
            self._ctx.memory_barrier()
            if decide is not None:
                decide.run(_STRIDED_GROUPS)
                self._ctx.memory_barrier()

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


def coherent_order(positions: FloatArray, normals: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return an order in which neighbours look at neighbouring pixels, which caches like.

    Cells of a 16 x 16 x 16 grid, for each octant of the normals apart; what shares a cell keeps its order.
    """
    low = positions.min(axis=0)
    side = float((positions.max(axis=0) - low).max())
    cells = ((positions - low) * (16.0 * (1.0 - 1e-9) / side if side > 0.0 else 0.0)).astype(np.uint16)
    octants = (normals > 0.0) @ np.array([1, 2, 4], dtype=np.uint16)
    keys = octants << 12 | cells[:, 0] << 8 | cells[:, 1] << 4 | cells[:, 2]
    return np.argsort(keys, kind="stable")  # a radix sort, for 16 bits


def set_uniforms(program: Any, **values: Any) -> None:
    """Set those of the uniforms that the compiler has not found to be unused; nothing without a program."""
    for name, value in values.items():
        if program is not None and name in program:
            program[name].value = value
