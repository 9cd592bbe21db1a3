"""Irregular z-buffer as a compute pass: exact visibility for packets of points and many eyes at once."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.base.errors import GlError
from zbuf_occlude.base.jit.threads import n_blocks, parallel_for, parallel_kernel, take_block
from zbuf_occlude.engines.gl.buffers import Buffers, answer_limit, block_limit, parts
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.engines.gl.tiles import Unit
from zbuf_occlude.geometry.hilbert import hilbert_order
from zbuf_occlude.geometry.mesh import Mesh

MAX_LEVELS = 9
"""Maximum levels of the tree of boxes: enough for 8 * 8^8 faces, far more than a storage block holds."""

BUDGET = 6000
"""Steps after which a work group stops; llvmpipe allows 65,535 iterations, of which a step may take eight."""

_FACE_BYTES, _POINT_BYTES = 72, 32
"""Size of the largest record of a face, and of a point, in one buffer."""

_MAX_GROUPS = 65535
"""Work groups along an axis that every driver allows."""

EPSILON = 2.0**-24
"""Unit roundoff of float32, the unit of the shader's error bounds."""

MIN_NORMAL = 1e-6
"""Shortest normal, as a share of the longest edge squared, that says on which side of a face an eye is; rounded edges
of thinner faces may say otherwise. The shader gets a zero then, which leaves all points of the face to float64."""

DISPATCH_SECONDS = 0.1
"""Target time of one dispatch. A GPU with a display is reset after some seconds, and other programs wait."""

_FIRST_GROUPS = 1 << 14
"""Work groups of the first dispatch, before any was timed."""

_BINDINGS = 10

_HEAD = 8
"""Numbers before the list of unfinished tasks."""

WIDTH = 8
"""Children of an inner box."""

LEAF = 8
"""Faces of a cluster."""

BLOCK = 256
"""Packets per block of a thread."""

WORDS = 128
"""Words of 32 answers per block of a thread."""

NO_INDEX = np.uint32(0xFFFFFFFF)

Pairs = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Indices of eyes, and of points."""

EXACT_POINT = np.dtype([("position", "<f8", 3), ("order", "<u4"), ("unused", "<u4")])
EYE = np.dtype([("position", "<f8", 3), ("unused", "<f8"), ("scaled", "<f4", 4)])


@dataclass(frozen=True)
class WorkGroup:
    """Division of the work for the hardware; no answer depends on it."""

    threads: int  # threads of a work group
    per_thread: int  # points of a thread, at most 31
    strands: int  # threads that share a point and divide its triangles; divides `threads`
    triangles: int  # triangles listed before the points test them

    @property
    def packet(self) -> int:
        """Number of points of a packet."""
        return self.threads // self.strands * self.per_thread


WorkGroups = tuple[tuple[float, WorkGroup], ...]
"""Work groups with the least number of points per face for which each is the best, in descending order down to 0."""

SOFTWARE: WorkGroups = ((0.4, WorkGroup(8, 16, 1, 24)), (0.05, WorkGroup(8, 1, 2, 24)), (0.0, WorkGroup(8, 1, 8, 24)))
"""Work groups for llvmpipe: one vector per group, and many points per thread because its shared memory is slow."""

HARDWARE: WorkGroups = (
    (20.0, WorkGroup(32, 2, 1, 16)),
    (4.0, WorkGroup(32, 1, 1, 16)),
    (0.7, WorkGroup(32, 1, 2, 16)),
    (0.05, WorkGroup(32, 1, 8, 16)),
    (0.0, WorkGroup(32, 1, 32, 16)),
)
"""Work groups for a GPU: one warp per group, and little shared memory so that many groups run at a time. The packet
sizes are those with the fewest operations: small for sparse points, where a large packet would test too many faces."""


def best_work_group(work_groups: WorkGroups, n_points: int, n_faces: int) -> WorkGroup:
    """Choose the work group by the number of points per face."""
    return next(shape for least, shape in work_groups if n_points >= least * n_faces)


def shader_constants(shape: WorkGroup, counting: bool) -> dict[str, object]:
    """Return the constants of shaders/exact.comp."""
    opened = max(shape.threads // WIDTH, 1)
    return {
        "THREADS": shape.threads,
        "PER_THREAD": shape.per_thread,
        "STRANDS": shape.strands,
        "TRIANGLES": shape.triangles,
        "WIDTH": WIDTH,
        "LEAF": LEAF,
        "BUDGET": BUDGET,
        "EPSILON": EPSILON,
        "COUNTING": counting,
        "MAX_LEVELS": MAX_LEVELS,
        # `opened` boxes add opened * WIDTH boxes to the next level, when fewer than `opened` of that are left
        "STACK": MAX_LEVELS * opened * (WIDTH + 1),
    }


@dataclass(frozen=True)
class FaceArrays:
    """Faces in Hilbert order, and a tree of boxes over clusters of `LEAF` faces, with `WIDTH` children per box.

    Child j of box i of level l is box i WIDTH + j of level l + 1; the boxes of the last level are the clusters.
    """

    face_ids: IntArray  # (f,) the mesh's faces in Hilbert order
    faces: NDArray[np.float32]  # (f, 16) unit space: corner a, edges ab, ac, normal or 0 (`MIN_NORMAL`), edge bc, 0
    corners: FloatArray  # (f, 9) world space
    boxes: NDArray[np.float32]  # (boxes, 8) centre and half size, each padded to 4; the root first
    level_size: list[int]


def arrange_faces(corners: FloatArray, unit: Unit) -> FaceArrays:
    """Arrange faces given by their corners (f, 3, 3), world space."""
    order = hilbert_order(corners.mean(axis=1))
    corners = corners[order]
    local = unit.to(corners)
    a, b, c = local[:, 0], local[:, 1], local[:, 2]
    faces = np.zeros((len(corners), 16), dtype=np.float32)
    # rounded from float64 differences, so that small faces keep their precision
    faces[:, 0:3], faces[:, 3:6], faces[:, 6:9] = a, b - a, c - a
    normals, faces[:, 12:15] = np.cross(b - a, c - a), c - b
    longest = np.max([np.sum(edge * edge, axis=1) for edge in (b - a, c - a, c - b)], axis=0)
    thin = np.linalg.norm(normals, axis=1) <= MIN_NORMAL * longest
    faces[:, 9:12] = np.where(thin[:, None], 0.0, normals)
    low, high = local.min(axis=1), local.max(axis=1)
    levels: list[tuple[FloatArray, FloatArray]] = []
    step = LEAF
    while True:
        starts = np.arange(0, len(low), step)
        low, high = np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)
        levels.insert(0, (low, high))
        step = WIDTH
        if len(levels) > 1 and len(low) == 1:
            break
    sizes = [len(low) for low, _ in levels]
    boxes = np.zeros((sum(sizes), 8), dtype=np.float32)
    boxes[:, 0:3] = np.concatenate([(low + high) / 2.0 for low, high in levels])
    boxes[:, 4:7] = np.concatenate([(high - low) / 2.0 for low, high in levels])
    return FaceArrays(order, faces, corners.reshape(-1, 9), boxes, sizes)


@dataclass(frozen=True)
class PointArrays:
    """Points in packets of neighbours."""

    points: NDArray[np.uint32]  # (packets * size, 4) bits of the float32 offset from the centre; rank of the own face
    exact_points: NDArray[Any]  # (packets * size,) EXACT_POINT: world space, index; `NO_INDEX` for padding
    packets: NDArray[np.float32]  # (packets, 8) centre and radius, half size; unit space


def arrange_points(positions: FloatArray, own_ranks: IntArray, size: int, unit: Unit) -> PointArrays:
    """Arrange n points into packets of `size`; own_ranks (n,) are their own faces' ranks in FaceArrays, -1 for none."""
    n = len(positions)
    n_packets = -(-n // size)
    order = np.empty(n_packets * size, dtype=np.int64)
    order[:n] = hilbert_order(positions)
    order[n:] = order[n - 1]
    exact_points = np.empty(len(order), dtype=EXACT_POINT)
    points = np.empty((len(order), 4), dtype=np.uint32)
    packets = np.zeros((n_packets, 8), dtype=np.float32)
    offsets, world = points.view(np.float32), exact_points.view(np.float64).reshape(-1, 4)
    in_unit = unit.centre, unit.scale
    parallel_for(_pack, n_blocks(n_packets, BLOCK), positions, order, size, *in_unit, offsets, world, packets)
    points[:, 3] = own_ranks[order].astype(np.uint32)
    exact_points["order"] = order
    exact_points["order"][n:] = NO_INDEX
    return PointArrays(points, exact_points, packets)


@parallel_kernel
def _pack(tasks, positions, order, size, unit_centre, scale, offsets, world, packets):
    """Fill in the geometry of packets; the fourth columns of `offsets` and `world` are not written."""
    begin, end = take_block(tasks, len(packets), BLOCK)
    while begin < end:
        for packet in range(begin, end):
            first = packet * size
            largest = 0.0
            for axis in range(3):
                low, high = np.inf, -np.inf
                for i in range(first, first + size):
                    world[i, axis] = positions[order[i], axis]
                    local = (world[i, axis] - unit_centre[axis]) * scale
                    low, high = min(low, local), max(high, local)
                packets[packet, axis] = (low + high) / 2.0
                # enlarged slightly, for the rounding to float32
                centre = np.float64(packets[packet, axis])
                packets[packet, 4 + axis] = max(high - centre, centre - low) * (1.0 + 1e-6)
            for i in range(first, first + size):
                squared = 0.0
                for axis in range(3):
                    offset = (world[i, axis] - unit_centre[axis]) * scale - np.float64(packets[packet, axis])
                    offsets[i, axis] = offset
                    squared += offset * offset
                largest = max(largest, squared)
            packets[packet, 3] = np.sqrt(largest) * (1.0 + 1e-6)
        begin, end = take_block(tasks, len(packets), BLOCK)


def arrange_eyes(eyes: FloatArray, unit: Unit) -> NDArray[Any]:
    """Return EYE records of eyes (k, 3): world space, unit space times a power of two g, and g."""
    local = unit.to(eyes)
    exponent = -np.frexp(1.0 + 2.0 * np.abs(local).max(axis=1))[1]
    records = np.zeros(len(eyes), dtype=EYE)
    records["position"] = eyes
    records["scaled"][:, :3] = np.ldexp(local, exponent[:, None])
    # float32 has no smaller powers, and beyond 2^100 the mesh is smaller than the rounding of an eye
    records["scaled"][:, 3] = np.ldexp(1.0, np.maximum(exponent, -100))
    return records


class WorkCounts(NamedTuple):
    """Operations, summed over all calls."""

    groups: int = 0  # pairs of packet and eye, and parts of pairs that were divided
    boxes: int = 0  # boxes tested against a packet's shaft
    triangles: int = 0  # triangles tested against a packet's shaft
    tests: int = 0  # tests of a triangle by all points of a packet
    doubts: int = 0  # tests of a triangle by one point in float64


@dataclass(frozen=True)
class PointPackets:
    """Points on the GPU, in parts that fit into a storage block."""

    n_points: int
    shape: WorkGroup
    parts: list[tuple[slice, int, Buffers]]  # points, number of packets, buffers

    def release(self) -> None:
        """Free the GPU's memory."""
        for _, _, buffers in self.parts:
            buffers.release()


@dataclass(frozen=True)
class _FacePart:
    """Faces that fit into one storage block, with their tree."""

    first: int
    n_faces: int
    level_size: list[int]
    buffers: Buffers


class ExactPass:
    """Mesh on the GPU, prepared for queries. With `counting` True, `work` counts operations, at some cost.

    Takes 141 bytes of the GPU's memory per face and 48 per point, and at most 256 MiB during a query. No buffer exceeds
    the driver's limit: more faces or points are processed in parts.
    """

    def __init__(self, gl: GlContext, mesh: Mesh, contact: float, counting: bool = False) -> None:
        self._gl = gl
        available = int(gl.info["GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS"])
        if available < _BINDINGS:
            raise GlError(f"a compute shader needs {_BINDINGS} storage blocks; {gl.renderer} allows {available}.")
        self._unit = Unit.from_box(mesh.centre, mesh.diagonal)
        self._work_groups = SOFTWARE if gl.is_software else HARDWARE
        self.work = WorkCounts()
        self._contact = contact
        self._counting = counting
        self._limit = block_limit(gl)
        self._groups_per_second = _FIRST_GROUPS / DISPATCH_SECONDS
        self._ranks = np.empty(len(mesh.faces), dtype=np.int32)
        self._face_parts = []
        for part in parts(len(mesh.faces), self._limit // _FACE_BYTES):
            arrays = arrange_faces(mesh.corners[part], self._unit)
            self._ranks[part][arrays.face_ids] = np.arange(part.start, part.stop)
            buffers = Buffers(gl, faces=arrays.faces, corners=arrays.corners, boxes=arrays.boxes)
            self._face_parts.append(_FacePart(part.start, part.stop - part.start, arrays.level_size, buffers))

    def upload(self, positions: FloatArray, face_ids: IntArray) -> PointPackets:
        """Upload points (world space) and their own faces (-1 for none) to the GPU; the caller releases them."""
        shape = best_work_group(self._work_groups, len(positions), len(self._ranks))
        largest = min(self._limit // _POINT_BYTES, _MAX_GROUPS * shape.packet) // shape.packet * shape.packet
        own = np.where(face_ids >= 0, self._ranks[face_ids], -1)
        uploaded = PointPackets(len(positions), shape, [])
        for part in parts(len(positions), largest):
            arrays = arrange_points(positions[part], own[part], shape.packet, self._unit)
            buffers = Buffers(self._gl, points=arrays.points, exact=arrays.exact_points, packets=arrays.packets)
            uploaded.parts.append((part, len(arrays.packets), buffers))
        return uploaded

    def visible(self, points: PointPackets, eyes: FloatArray) -> tuple[BoolArray, Pairs]:
        """Return which points no face certainly hides from each eye (k, 3), world space; and the undecided pairs.

        Returns
        -------
        visible : (k, n) bool
        undecided : pair of (m,) int
            Eyes and points of pairs that a face may hide, but its edge or plane is too near for float64 to decide.
        """
        program = self._program(points.shape)
        answer = np.empty((len(eyes), points.n_points), dtype=np.bool_)
        undecided: list[Pairs] = []
        with Buffers(self._gl, eyes=arrange_eyes(eyes, self._unit)) as eye_buffer:
            eye_buffer.bind(eyes=6)
            for part, n_packets, buffers in points.parts:
                buffers.bind(points=3, exact=4, packets=5)
                for rows, columns in self._answer(program, n_packets, answer[:, part]):
                    undecided.append((rows, columns + part.start))
        rows, columns = (np.concatenate(each) for each in zip(*undecided, strict=True))
        return answer, (rows, columns)

    def _program(self, shape: WorkGroup) -> Any:
        """Return the program for a work group, which the context compiles when it is first needed."""
        program = self._gl.program("exact.comp", **shader_constants(shape, self._counting))
        program["contact"].value = self._contact * self._unit.scale
        program["contact64"].value = self._contact
        return program

    def _answer(self, program: Any, n_packets: int, answer: BoolArray) -> Iterator[Pairs]:
        """Answer for the bound points, into (k, n), and yield the undecided pairs of some eyes at a time."""
        k, n = answer.shape
        words = -(-n // 32)
        # two rows of bits per eye, and the list of unfinished tasks: at most all pairs of eye and packet
        row, limit = max(8 * words, 8 * n_packets), answer_limit(self._gl) - 4 * _HEAD
        most = max(1, min(limit // row, _MAX_GROUPS, k))
        program["n_packets"].value = n_packets
        program["words"].value = words
        bits: NDArray[np.uint32] = np.empty((most, 2, words), dtype=np.uint32)
        with Buffers(self._gl, bits=bits.nbytes, unfinished=8 * most * n_packets + 4 * _HEAD) as buffer:
            buffer.bind(bits=7, unfinished=9)
            first = 0
            while first < k:
                in_time = max(1, int(self._groups_per_second * DISPATCH_SECONDS / n_packets))
                last = min(first + min(most, in_time), k)
                began = time.perf_counter()
                buffer.clear("bits")
                program["first_eye"].value = first
                for part in self._face_parts:
                    self._ask(program, part, buffer, n_packets, last - first)
                buffer.read_into("bits", bits[: last - first])
                groups = (last - first) * n_packets * len(self._face_parts)
                self._groups_per_second = groups / max(time.perf_counter() - began, 1e-6)
                hidden, undecided = bits[: last - first, 0], bits[: last - first, 1]
                read = answer[first:last].view(np.uint8)
                parallel_for(_unpack, n_blocks(words, WORDS), hidden, read)
                eyes, points = _set_bits(undecided & ~hidden)
                yield eyes + first, points
                first = last

    def _ask(self, program: Any, part: _FacePart, answers: Buffers, n_packets: int, n_eyes: int) -> None:
        """Test a part of the faces for every packet and eye; tasks too large for one work group are divided."""
        part.buffers.bind(faces=0, corners=1, boxes=2)
        program["first_face"].value = part.first
        program["n_faces"].value = part.n_faces
        program["n_levels"].value = len(part.level_size)
        sizes = np.pad(part.level_size, (0, MAX_LEVELS - len(part.level_size)))
        program["level_size"].value = tuple(sizes.tolist())
        program["level_start"].value = tuple((np.cumsum(sizes) - sizes).tolist())
        program["n_tasks"].value = 0
        largest = n_packets * n_eyes
        tasks = self._run(program, answers, n_packets, n_eyes)
        while len(tasks):
            tasks = _divided(tasks, part.level_size)
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
        """Dispatch, and return the unfinished tasks: (tasks, 2), pair of eye and packet, box."""
        head = np.empty(_HEAD, dtype=np.uint32)
        answers.clear("unfinished", head.nbytes)
        program.run(columns, rows)
        self._gl.ctx.memory_barrier()
        answers.read_into("unfinished", head)
        tasks = np.empty((int(head[0]), 2), dtype=np.uint32)
        if len(tasks):
            answers.read_into("unfinished", tasks, offset=head.nbytes)
        self.work = WorkCounts(*(int(done) for done in np.add(self.work, head[2:7])))
        return tasks

    def release(self) -> None:
        """Free the GPU's memory."""
        for part in self._face_parts:
            part.buffers.release()


@parallel_kernel
def _unpack(tasks, hidden, answer):
    """Write blocks of answers (k, n), 0 for each bit of `hidden` (k, words) that is set, else 1."""
    n = answer.shape[1]
    begin, end = take_block(tasks, hidden.shape[1], WORDS)
    while begin < end:
        for eye in range(len(answer)):
            row = answer[eye]
            for word in range(begin, end):
                shown, first = ~hidden[eye, word], 32 * word
                if first + 32 <= n:
                    for bit in range(32):
                        row[first + bit] = np.uint8(shown >> np.uint32(bit) & np.uint32(1))
                else:
                    for bit in range(n - first):
                        row[first + bit] = np.uint8(shown >> np.uint32(bit) & np.uint32(1))
        begin, end = take_block(tasks, hidden.shape[1], WORDS)


def _set_bits(words: NDArray[Any]) -> Pairs:
    """Return rows and columns of the set bits of (k, words)."""
    rows, places = np.nonzero(words)
    bits_of_words = np.unpackbits(words[rows, places].view(np.uint8).reshape(-1, 4), axis=1, bitorder="little")
    found, bits = np.nonzero(bits_of_words)
    return rows[found], 32 * places[found] + bits


def _divided(tasks: NDArray[np.uint32], level_size: list[int]) -> NDArray[np.uint32]:
    """Replace each task by the tasks of its box's children."""
    level = (tasks[:, 1] >> np.uint32(28)) + np.uint32(1)
    nodes = (tasks[:, 1] & np.uint32(0x0FFFFFFF))[:, None] * np.uint32(WIDTH) + np.arange(WIDTH, dtype=np.uint32)
    exists = nodes < np.asarray(level_size, dtype=np.uint32)[level][:, None]
    pairs = np.broadcast_to(tasks[:, :1], nodes.shape)
    entries = np.bitwise_or(level[:, None] << np.uint32(28), nodes)
    return np.stack([pairs[exists], entries[exists]], axis=1)
