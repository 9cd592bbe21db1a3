"""Point pass: points projected on the GPU and tested against the depth atlas, one bit per point and eye."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.base.jit.threads import n_blocks, parallel_for, parallel_kernel, take_block
from zbuf_occlude.engines.gl.buffers import Buffers, parts
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.engines.gl.depth_pass import MeshArrays
from zbuf_occlude.engines.gl.shaders import set_uniforms
from zbuf_occlude.engines.gl.tiles import EYES_PER_BYTE, Unit
from zbuf_occlude.geometry.hilbert import hilbert_order

MAX_HIDDEN = 0.3
"""Maximum share of the weighted votes for "hidden" with which a point without a witness is visible."""

BLOCK = 256
"""Points of a work group of 64 invocations, four each."""

MAX_POINTS = 1 << 20
"""Maximum points of one buffer: an entry of the list of doubtful pairs has 20 bits for the point."""

MAX_LISTED = 1 << 22
"""Maximum pairs of eye and point of one dispatch: the list of doubtful pairs has room for all of them."""

_MAX_GROUPS = 65535
"""Work groups along an axis that every driver allows."""

_SOFTWARE_GROUPS, _HARDWARE_GROUPS = 128, 4096
"""Work groups among which the doubtful pairs are divided: few for a CPU, which runs a few at a time."""

PACKED, SPREAD = 1024, 4096
"""Points per block of a thread, as they are packed and as their answers are read."""


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
        World space.
    face_ids : (n,) int32
        Own faces, -1 for none.
    mesh : MeshArrays
    unit : Unit
    """

    def __init__(self, gl: GlContext, positions: FloatArray, face_ids: IntArray, mesh: MeshArrays, unit: Unit) -> None:
        order = hilbert_order(positions)
        self.n_slots = -(-len(order) // BLOCK) * BLOCK
        """Number of points, the last block filled up by repetition."""
        self.slots = np.empty(len(order), dtype=np.int32)
        """Place of each point, and of its byte among the answers."""
        records = np.empty((self.n_slots, 8), dtype=np.float32)  # two uvec4 of shaders/include/points.glsl
        where = unit.centre, unit.scale, mesh.normals, mesh.ranks
        filled = self.slots, records, records.view(np.int32)
        parallel_for(_pack, n_blocks(self.n_slots, PACKED), positions, face_ids, order, *where, *filled)
        self.buffers = Buffers(gl, points=records)

    def __len__(self) -> int:
        return len(self.slots)

    def release(self) -> None:
        """Free the GPU's memory; calling it again does nothing."""
        self.buffers.release()


@parallel_kernel
def _pack(tasks, positions, face_ids, order, centre, scale, normals, ranks, slots, records, numbers):
    """Fill blocks of records: position in unit space, own face by rank, its normal, one unused; and points' slots."""
    begin, end = take_block(tasks, len(records), PACKED)
    while begin < end:
        for slot in range(begin, end):
            point = order[min(slot, len(order) - 1)]
            face = face_ids[point]
            for axis in range(3):
                records[slot, axis] = (positions[point, axis] - centre[axis]) * scale
                records[slot, 4 + axis] = normals[face, axis] if face >= 0 else 0.0
            numbers[slot, 3] = ranks[face] if face >= 0 else -1
            numbers[slot, 7] = 0
            if slot < len(order):
                slots[point] = slot
        begin, end = take_block(tasks, len(records), PACKED)


class PointPass:
    """Answers for points: a byte per point and group of eyes, and at most 16 MiB for a list of doubtful pairs.

    `out`, (k, n) bool, receives the answers to `batches`. If `doubts` is True, doubtful pairs are listed.
    """

    def __init__(
        self, gl: GlContext, points: UploadedPoints, out: BoolArray, batches: list[EyeBatch], *, doubts: bool
    ) -> None:
        self._ctx, self._points, self._out, self._batches = gl.ctx, points, out, batches
        self._n_words = points.n_slots // 4
        self._deciding_groups = _SOFTWARE_GROUPS if gl.is_software else _HARDWARE_GROUPS
        n_groups = sum(batch.n_groups for batch in batches)
        self._answers = np.empty((n_groups, points.n_slots), dtype=np.uint8)
        listed = 4 * min(points.n_slots * max(batch.n_eyes for batch in batches), MAX_LISTED)
        counts = np.zeros(sum(len(self._dispatches(batch)) for batch in batches), dtype=np.uint32)
        lists: dict[str, Any] = {"counts": counts, "doubtful": listed} if doubts else {}
        self._n_dispatched = 0
        self._buffers = Buffers(gl, answers=self._answers.nbytes, **lists)

    def _dispatches(self, batch: EyeBatch) -> list[slice]:
        """Divide the blocks of points among dispatches."""
        return parts(self._n_words // 64, min(MAX_LISTED // (BLOCK * batch.n_eyes), _MAX_GROUPS))

    def test(self, batch: EyeBatch, answer: Any, decide: Any = None) -> None:
        """Test the points against a batch just drawn, by depth_test.comp alone or vote.comp and witness.comp."""
        self._points.buffers.bind(points=0)
        self._buffers.bind(answers=1)
        if decide is not None:
            self._buffers.bind(counts=2, doubtful=3)
        for program in (answer, decide):
            first_word = batch.first_group * self._n_words
            set_uniforms(program, n_eyes=batch.n_eyes, first_word=first_word, n_words=self._n_words)
        for blocks in self._dispatches(batch):
            set_uniforms(answer, first_block=blocks.start, dispatch=self._n_dispatched)
            answer.run(blocks.stop - blocks.start, batch.n_groups)
            self._ctx.memory_barrier()
            if decide is not None:
                set_uniforms(decide, dispatch=self._n_dispatched)
                decide.run(self._deciding_groups)
                self._ctx.memory_barrier()
            self._n_dispatched += 1

    def fetch(self) -> None:
        """Read back the answers to all batches."""
        self._buffers.read_into("answers", self._answers)
        groups = [
            (batch.first_eye + first, min(EYES_PER_BYTE, batch.n_eyes - first))
            for batch in self._batches
            for first in range(0, batch.n_eyes, EYES_PER_BYTE)
        ]
        asked = self._answers, self._points.slots, np.array(groups), self._out.view(np.uint8)
        parallel_for(_spread, n_blocks(len(self._points), SPREAD), *asked, own=_new_bytes)

    def release(self) -> None:
        """Free the GPU's memory; calling it again does nothing."""
        self._buffers.release()


def _new_bytes() -> NDArray[np.uint8]:
    return np.empty(SPREAD, dtype=np.uint8)


@parallel_kernel
def _spread(tasks, answers, slots, groups, out, chosen):
    """Write the answers of blocks of points: row `eye`, one byte per point."""
    begin, end = take_block(tasks, len(slots), SPREAD)
    while begin < end:
        for group in range(len(groups)):
            for i in range(end - begin):
                chosen[i] = answers[group, slots[begin + i]]
            for bit in range(groups[group, 1]):
                row, mask = out[groups[group, 0] + bit, begin:end], np.uint8(1 << bit)
                for i in range(len(row)):
                    row[i] = np.uint8((chosen[i] & mask) != 0)
        begin, end = take_block(tasks, len(slots), SPREAD)
