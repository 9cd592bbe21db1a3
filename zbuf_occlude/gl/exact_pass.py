"""The irregular z-buffer as a compute pass: visible or not, exactly, for packets of points and many eyes at once."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.errors import GlError
from zbuf_occlude.gl.buffers import Buffers, answer_limit, block_limit, parts
from zbuf_occlude.gl.context import GlContext
from zbuf_occlude.gl.exact_data import LEAF, WIDTH, Unit, arrange_eyes, arrange_faces, arrange_points
from zbuf_occlude.gl.exact_shapes import HARDWARE, SOFTWARE, Shape, Shapes, best_shape

MAX_LEVELS = 9
"""Of the tree of boxes: enough for 8 * 8^8 faces, far more than a storage block holds."""

BUDGET = 6000
"""Steps after which a work group gives up; llvmpipe allows 65,535 iterations, of which a step may take eight."""

_FACE_BYTES, _POINT_BYTES = 72, 32
"""The largest record of a face, and of a point, in one buffer."""

_MAX_GROUPS = 65535
"""What every driver allows of work groups along an axis."""

EPSILON = 2.0**-24
"""float32's unit roundoff, in which the shader states its bounds."""

DISPATCH_SECONDS = 0.1
"""What one dispatch may take: drivers of GPUs with a display reset them after some seconds, and others wait."""

_FIRST_GROUPS = 1 << 14
"""Of the first dispatch, before any was timed."""

_BINDINGS = 10

_HEAD = 8
"""Numbers before the list of the unfinished."""


@dataclass
class Work:
    """What was done to answer, summed over all calls.

    Attributes
    ----------
    groups : int
        Work groups: packets x eyes, and those that were cut out of too large ones.
    boxes, triangles : int
        Held against a packet's shaft.
    tests : int
        Of a triangle by all points of a packet.
    doubts : int
        Of a triangle by one point, decided in float64.
    """

    groups: int = 0
    boxes: int = 0
    triangles: int = 0
    tests: int = 0
    doubts: int = 0


@dataclass(frozen=True)
class UploadedPoints:
    """Points on the GPU, in parts that fit into a storage block: which points, packets, buffers."""

    n_points: int
    shape: Shape
    parts: list[tuple[slice, int, Buffers]]

    def release(self) -> None:
        """Give the GPU's memory back."""
        for _, _, buffers in self.parts:
            buffers.release()


@dataclass(frozen=True)
class _FacePart:
    """Faces that fit into one storage block, with their tree."""

    first: int
    n_faces: int
    level_start: list[int]
    level_size: list[int]
    buffers: Buffers


class ExactPass:
    """A mesh on the GPU, ready to be asked.

    Parameters
    ----------
    gl : GlContext
    corners : (f, 3, 3) float64
        World space.
    centre, diagonal
        Of the mesh's bounding box.
    contact : float
        In world units.
    shapes : Shapes, optional
        By default `SOFTWARE` or `HARDWARE`, as the context is.
    counting : bool
        Whether to sum up what is done in `work`, which costs some time.

    Notes
    -----
    GPU memory: 141 bytes per face, 48 bytes per point, and while it answers at most 256 MiB, whatever the number of
    eyes. No buffer exceeds the driver's block: faces and points beyond it are asked about in parts.
    """

    def __init__(
        self,
        gl: GlContext,
        corners: FloatArray,
        centre: FloatArray,
        diagonal: float,
        contact: float,
        shapes: Shapes | None = None,
        counting: bool = False,
    ) -> None:
        self._gl = gl
        available = int(gl.info["GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS"])
        if available < _BINDINGS:
            raise GlError(f"a compute shader must see {_BINDINGS} storage blocks; {gl.renderer} shows it {available}.")
        self._unit = Unit.of(centre, diagonal)
        self.shapes = shapes or (SOFTWARE if gl.is_software else HARDWARE)
        self.work = Work()
        self._contact, self._diagonal = contact, diagonal
        self._counting = counting
        self._limit = block_limit(gl)
        self._groups_per_second = _FIRST_GROUPS / DISPATCH_SECONDS
        self._places = np.empty(len(corners), dtype=np.int32)
        self._face_parts = []
        for part in parts(len(corners), self._limit // _FACE_BYTES):
            arrays = arrange_faces(corners[part], self._unit)
            self._places[part][arrays.face_ids] = np.arange(part.start, part.stop)
            buffers = Buffers(gl, faces=arrays.faces, corners=arrays.corners, boxes=arrays.boxes)
            self._face_parts.append(
                _FacePart(part.start, part.stop - part.start, arrays.level_start, arrays.level_size, buffers)
            )

    def upload(self, positions: FloatArray, face_ids: IntArray) -> "UploadedPoints":
        """Put points on the GPU, ready to be asked about any number of times.

        Parameters
        ----------
        positions : (n, 3) float64
            World space.
        face_ids : (n,) int
            Own faces, -1 for none.

        Returns
        -------
        UploadedPoints
            The caller's, who releases it.
        """
        shape = best_shape(self.shapes, len(positions), len(self._places))
        largest = min(self._limit // _POINT_BYTES, _MAX_GROUPS * shape.packet) // shape.packet * shape.packet
        own = np.where(face_ids >= 0, self._places[face_ids], -1)
        uploaded = UploadedPoints(len(positions), shape, [])
        for part in parts(len(positions), largest):
            arrays = arrange_points(positions[part], own[part], shape.packet, self._unit)
            buffers = Buffers(self._gl, points=arrays.points, exact=arrays.exact_points, packets=arrays.packets)
            uploaded.parts.append((part, arrays.n_packets, buffers))
        return uploaded

    def visible(self, points: "UploadedPoints", eyes: FloatArray) -> BoolArray:
        """Answer which points each eye (k, 3), world space, sees: (k, n) bool."""
        program = self._program(points.shape)
        answer = np.empty((len(eyes), points.n_points), dtype=np.bool_)
        with Buffers(self._gl, eyes=arrange_eyes(eyes, self._unit)) as eye_buffer:
            eye_buffer.bind(eyes=6)
            for part, n_packets, buffers in points.parts:
                buffers.bind(points=3, exact=4, packets=5)
                self._answer(program, n_packets, answer[:, part])
        return answer

    def _program(self, shape: Shape) -> Any:
        """Return the pass for a shape, which the context compiles when it is first needed."""
        opened = max(shape.threads // WIDTH, 1)
        program = self._gl.program(
            "exact.comp",
            THREADS=shape.threads,
            PER_THREAD=shape.per_thread,
            STRANDS=shape.strands,
            TRIANGLES=shape.triangles,
            WIDTH=WIDTH,
            LEAF=LEAF,
            BUDGET=BUDGET,
            EPSILON=EPSILON,
            COUNTING=self._counting,
            MAX_LEVELS=MAX_LEVELS,
            # a level gets opened * WIDTH boxes at once, and more only when less than `opened` are left of it
            STACK=MAX_LEVELS * opened * (WIDTH + 1),
        )
        program["contact"].value = self._contact * self._unit.scale
        program["contact64"].value, program["diagonal64"].value = self._contact, self._diagonal
        return program

    def _answer(self, program: Any, n_packets: int, answer: BoolArray) -> None:
        """Answer for the points bound, into (k, n)."""
        k, n = answer.shape
        words = -(-n // 32)
        # a row of bits per eye, and the list of the unfinished: at most all pairs of eye and packet
        row, limit = max(4 * words, 8 * n_packets), answer_limit(self._gl) - 4 * _HEAD
        most = max(1, min(limit // row, _MAX_GROUPS, k))
        program["n_packets"].value = n_packets
        program["words"].value = words
        bits = np.empty((most, words), dtype=np.uint32)
        with Buffers(self._gl, bits=bits.nbytes, unfinished=8 * most * n_packets + 4 * _HEAD) as buffer:
            buffer.bind(bits=7, unfinished=9)
            first = 0
            while first < k:
                last = min(first + min(most, self._eyes_at_once(n_packets)), k)
                began = time.perf_counter()
                buffer.clear("bits")
                program["first_eye"].value = first
                for part in self._face_parts:
                    self._ask(program, part, buffer, n_packets, last - first)
                buffer.read_into("bits", bits[: last - first])
                groups = (last - first) * n_packets * len(self._face_parts)
                self._groups_per_second = groups / max(time.perf_counter() - began, 1e-6)
                np.invert(bits, out=bits)
                unpacked = np.unpackbits(bits[: last - first].view(np.uint8), axis=1, count=n, bitorder="little")
                answer[first:last] = unpacked.view(np.bool_)
                first = last

    def _eyes_at_once(self, n_packets: int) -> int:
        """How many eyes make a dispatch of about `DISPATCH_SECONDS`, by how fast the last one was."""
        return max(1, int(self._groups_per_second * DISPATCH_SECONDS / n_packets))

    def _ask(self, program: Any, part: _FacePart, answers: Buffers, n_packets: int, n_eyes: int) -> None:
        """Let every packet and eye test a part of the faces; what is too much for one work group is cut smaller."""
        part.buffers.bind(faces=0, corners=1, boxes=2)
        program["first_face"].value = part.first
        program["n_faces"].value = part.n_faces
        program["n_levels"].value = len(part.level_size)
        program["level_start"].value = _padded(part.level_start)
        program["level_size"].value = _padded(part.level_size)
        program["n_tasks"].value = 0
        largest = n_packets * n_eyes
        tasks = self._run(program, answers, n_packets, n_eyes)
        while len(tasks):
            tasks = _cut(tasks, part.level_size)
            left = []
            for some in parts(len(tasks), largest):
                with Buffers(self._gl, tasks=tasks[some]) as task_buffer:
                    task_buffer.bind(tasks=8)
                    n_tasks = some.stop - some.start
                    program["n_tasks"].value = n_tasks
                    columns = min(n_tasks, _MAX_GROUPS)
                    left.append(self._run(program, answers, columns, -(-n_tasks // columns)))
            tasks = np.concatenate(left)

    def _run(self, program: Any, answers: Buffers, columns: int, rows: int) -> NDArray[np.uint32]:
        """Dispatch, and return the tasks left unfinished: (tasks, 2), pair of eye and packet, box."""
        head = np.empty(_HEAD, dtype=np.uint32)
        answers.clear("unfinished", head.nbytes)
        program.run(columns, rows)
        self._gl.ctx.memory_barrier()
        answers.read_into("unfinished", head)
        tasks = np.empty((int(head[0]), 2), dtype=np.uint32)
        if len(tasks):
            answers.read_into("unfinished", tasks, offset=head.nbytes)
        self.work.groups += int(head[2])
        self.work.boxes += int(head[3])
        self.work.triangles += int(head[4])
        self.work.tests += int(head[5])
        self.work.doubts += int(head[6])
        return tasks

    def release(self) -> None:
        """Give the GPU's memory back."""
        for part in self._face_parts:
            part.buffers.release()


def _padded(values: list[int]) -> tuple[int, ...]:
    return (*values, *[0] * (MAX_LEVELS - len(values)))


def _cut(tasks: NDArray[np.uint32], level_size: list[int]) -> NDArray[np.uint32]:
    """Replace each task by the tasks of its box's children."""
    level = (tasks[:, 1] >> np.uint32(28)) + np.uint32(1)
    nodes = (tasks[:, 1] & np.uint32(0x0FFFFFFF))[:, None] * np.uint32(WIDTH) + np.arange(WIDTH, dtype=np.uint32)
    exists = nodes < np.asarray(level_size, dtype=np.uint32)[level][:, None]
    pairs = np.broadcast_to(tasks[:, :1], nodes.shape)
    entries = np.bitwise_or(level[:, None] << np.uint32(28), nodes)
    return np.stack([pairs[exists], entries[exists]], axis=1)
