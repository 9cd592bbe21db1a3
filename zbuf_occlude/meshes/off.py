"""The Object File Format (OFF), with the variants found in ModelNet and elsewhere."""

import re

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import MeshError
from zbuf_occlude.meshes.polygons import Ints, Polygons
from zbuf_occlude.meshes.text import Lines, check_text, runs

# [ST][C][N][4][n]OFF; in ModelNet40 the number of vertices follows without a blank: "OFF3514 3546 0"
_BLANK = rb"(?:\s|#[^\r\n]*)*"  # comments too
_HEADER = re.compile(_BLANK + rb"(ST)?(C)?(N)?(4)?(n)?(?:OFF|off)(?=[\s\d#]|$)")
_NUMBER, _BINARY = re.compile(_BLANK + rb"\d"), re.compile(_BLANK + rb"BINARY")
_TOKEN = re.compile(rb"#[^\r\n]*|[^\s#]+|\r\n?|\n")
_EXTRAS = {1: 2, 2: 4, 3: 3}  # further numbers of a vertex by the group of _HEADER: texture, colour, normal


def read_off(data: bytes) -> Polygons:
    """Return the polygons of an OFF file, of any number of corners, in the order of the file.

    Accepted are counts without a blank after the header; no header; no number of edges; comments and blank lines
    anywhere; any line ends; records over several lines. The headers COFF, NOFF, CNOFF and STOFF are read. Numbers after
    the coordinates of a vertex or the indices of a face are ignored. Binary files and other dimensions are refused.

    Almost all files have one record per line and are read by lines, which separates the numbers after a face from the
    next face. Text after the last record is ignored, unless it is another face: then the counts are wrong. Any other
    file is read as one stream of numbers, in which a face has nothing after its indices.

    Raises
    ------
    MeshError
        The file is no OFF file, cut short or damaged, or declares more than it contains. Declared counts are compared
        with the numbers in the file before any allocation.
    """
    check_text(data)
    header = _HEADER.match(data)
    if header is None and not _NUMBER.match(data):
        raise MeshError("an OFF file must begin with OFF; this one does not. Is it of another format, or damaged?")
    start = extras = 0
    if header is not None:
        if header[4] or header[5]:
            raise MeshError("an OFF file must have points of three coordinates; this one has others. Convert it.")
        start = header.end()
        if _BINARY.match(data, start):
            raise MeshError("an OFF file must be text; this one is binary. Convert it.")
        extras = sum(extra for group, extra in _EXTRAS.items() if header[group])
    n_vertices, n_faces, start = _counts(data, start)
    lines = Lines(data, start, comment=b"#")
    if 3 * n_vertices + n_faces > lines.n_numbers:
        raise MeshError(
            f"an OFF file must contain what it declares; it declares {n_vertices:,} vertices and {n_faces:,} faces, "
            f"but only {lines.n_numbers:,} numbers follow. Is it damaged or cut short?"
        )
    polygons = _by_lines(lines, n_vertices, n_faces)
    if polygons is not None:
        return polygons
    n_before = _numbers_before_lines_of_faces(lines, n_faces)
    if n_before not in (None, n_vertices * (3 + extras)):
        raise MeshError(
            f"an OFF file must have the {n_vertices:,} vertices that it declares, of {3 + extras} numbers each, before "
            f"its faces; it has {n_before:,} numbers there. Is it damaged?"
        )
    return _as_stream(lines.numbers(), n_vertices, n_faces, 3 + extras)


def _counts(data: bytes, start: int) -> tuple[int, int, int]:
    """Return the numbers of vertices and faces, and the end of the counts; the number of edges may be missing."""
    tokens, lines, line = [], [], 0
    for match in _TOKEN.finditer(data, start):
        if match[0][0] in b"\r\n":
            line += 1
        elif match[0][:1] != b"#":
            tokens.append(match)
            lines.append(line)
            if len(tokens) == 4:
                break
    if len(tokens) < 2 or not all(re.fullmatch(rb"\d{1,18}", token[0]) for token in tokens[:2]):
        found = b" ".join(token[0][:20] for token in tokens[:3]).decode("latin-1") or "nothing"
        raise MeshError(f"an OFF file must begin with its numbers of vertices and faces; it has {found!r}.")
    lines += [-1, -2]
    # the third number is of edges, unless the counts end their line and a record of several numbers follows
    edges_missing = lines[0] == lines[1] != lines[2] and lines[2] == lines[3]
    last = tokens[1] if edges_missing or len(tokens) == 2 else tokens[2]
    return int(tokens[0][0]), int(tokens[1][0]), last.end()


def _by_lines(lines: Lines, n_vertices: int, n_faces: int) -> Polygons | None:
    """Return the polygons of a file with one record per line; None for any other file."""
    n_lines = n_vertices + n_faces
    if len(lines) < n_lines or (lines.counts[:n_vertices] < 3).any():
        return None
    numbers = lines.numbers(n_lines)
    first = lines.first[n_vertices:n_lines]
    declared = numbers[first]
    if not ((declared >= 0) & (declared < lines.counts[n_vertices:n_lines]) & (declared == np.floor(declared))).all():
        return None
    if len(lines) > n_lines and _is_face(lines, n_lines):
        raise MeshError(
            f"an OFF file must end after the {n_vertices:,} vertices and {n_faces:,} faces that it declares; another "
            "face follows. Is it damaged?"
        )
    counts = declared.astype(np.int64)
    vertices = numbers[lines.first[:n_vertices, None] + np.arange(3)]
    return Polygons(vertices, numbers[runs(first + 1, counts)], counts)


def _is_face(lines: Lines, line: int) -> bool:
    """Return whether a line may be a face of three or more corners."""
    try:
        first = lines.numbers(line + 1)[lines.first[line]]
    except MeshError:
        return False  # words
    return bool(3 <= first < lines.counts[line] and first == first // 1)


def _numbers_before_lines_of_faces(lines: Lines, n_faces: int) -> int | None:
    """Return the count of numbers before the last `n_faces` lines if each of these is a whole face; else None."""
    n_before = len(lines) - n_faces
    if n_before < 0 or not n_faces:
        return None
    first = lines.first[n_before:]
    are_faces = (lines.numbers()[first] == lines.counts[n_before:] - 1).all()
    return int(first[0]) if are_faces else None


def _as_stream(numbers: FloatArray, n_vertices: int, n_faces: int, width: int) -> Polygons:
    """Return the polygons of a stream of numbers, whatever its lines; a vertex has `width` numbers."""
    table, rest = numbers[: n_vertices * width], numbers[n_vertices * width :]
    if len(table) < n_vertices * width:
        raise MeshError(
            f"an OFF file must contain the {n_vertices:,} vertices that it declares; it ends after "
            f"{len(table) // width:,}. Is it damaged or cut short?"
        )
    starts, counts = _walk(rest, n_faces)
    return Polygons(table.reshape(-1, width)[:, :3], rest[runs(starts, counts)], counts)


def _walk(numbers: FloatArray, n_faces: int) -> tuple[Ints, Ints]:
    """Return the starts and corner counts of the faces, each `n, index 1, ..., index n`, that fill `numbers`."""
    if len(numbers) == 4 * n_faces and (numbers[::4] == 3).all():
        return np.arange(n_faces) * 4 + 1, np.full(n_faces, 3)
    starts, counts = np.empty(n_faces, dtype=np.int64), np.empty(n_faces, dtype=np.int64)
    values = numbers.tolist()
    position = 0
    for face in range(n_faces):  # the start of a face depends on the one before
        if position >= len(values):
            raise MeshError(f"an OFF file must contain the {n_faces:,} faces that it declares; it ends after {face:,}.")
        count = values[position]
        if not (count >= 0 and count == count // 1):
            raise MeshError(f"face {face} must begin with its number of corners; it begins with {count:g}.")
        if count > len(values) - position - 1:
            raise MeshError(
                f"face {face} must have the {count:g} corners that it declares; the file ends before. Is it damaged "
                "or cut short?"
            )
        starts[face], counts[face] = position + 1, count
        position += 1 + int(count)
    if position < len(values):
        raise MeshError(
            f"an OFF file must end after the {n_faces:,} faces that it declares, or have one record per line; "
            f"{len(values) - position:,} numbers are left over. Is it damaged?"
        )
    return starts, counts
