"""How the points of an object, which of them each view sees, and scans become bytes; pure functions of arrays.

Numbers that grow slowly from point to point become small ones: each is replaced by its difference to the one before,
folded so that small negative ones are small too (0, -1, 1, -2, 2 become 0, 1, 2, 3, 4), and the bytes are regrouped:
first the lowest byte of all, then the next. What is left for the archive's compression (deflate) is mostly zeros.

Scans are not rounded, so that clouds drawn of them are those of any other format, byte for byte. They are NumPy's
arrays, one after the other: offsets (k + 1,), the table of the k places, a row per scan, a row per point.
"""

import io
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.dataset.clouds import ScanPoints
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.views import Views

BITS = 16
STEPS = 2**BITS - 1
"""An object's longest side is this many steps long; positions are rounded to whole steps."""


class Grid(NamedTuple):
    """Where rounded positions lie: ``low + step * q`` for the integers q in 0..65535.

    Parameters
    ----------
    low : (3,) float64
        Lower corner of the object's box, world space.
    step : float
        The longest side / 65,535, the same along the three axes. A position is off by at most half of it along each.
    """

    low: FloatArray
    step: float

    @classmethod
    def of_box(cls, bounds: FloatArray) -> "Grid":
        """Return the grid of an object's box, (2, 3)."""
        return cls(bounds[0], float(np.ptp(bounds, axis=0).max()) / STEPS)

    def rounded(self, positions: FloatArray) -> NDArray[np.uint16]:
        """Round positions (n, 3) in the box to steps."""
        return np.clip(np.round((positions - self.low) / self.step), 0, STEPS).astype(np.uint16)

    def positions(self, rounded: NDArray[np.uint16]) -> FloatArray:
        """Return the positions (n, 3) of steps, world space."""
        return np.asarray(self.low + self.step * rounded)


def pack_steps(rounded: NDArray[np.uint16]) -> bytes:
    """Pack steps (n, 3): for x, y, z in turn, differences folded, low bytes before high bytes."""
    return b"".join(_pack(rounded[:, axis].view(np.int16)) for axis in range(3))


def unpack_steps(content: bytes, n_points: int) -> NDArray[np.uint16]:
    """Return the steps (n, 3)."""
    _check(content, 6 * n_points, "steps")
    columns = [_unpack(content[2 * n_points * i :][: 2 * n_points], np.dtype("<i2")) for i in range(3)]
    return np.stack(columns, axis=1).view(np.uint16)


def pack_faces(face_ids: IntArray) -> bytes:
    """Pack face ids (n,): differences folded, lowest bytes first."""
    return _pack(face_ids)


def unpack_faces(content: bytes, n_points: int) -> IntArray:
    """Return the face ids (n,)."""
    _check(content, 4 * n_points, "face ids")
    return np.asarray(_unpack(content, np.dtype("<i4")), dtype=np.int32)


def pack_normals(normals: FloatArray) -> bytes:
    """Pack normals (n, 3) as float32: for x, y, z in turn the differences of their bits, none along a face."""
    bits = np.ascontiguousarray(normals.T, dtype=np.float32).view(np.int32)
    return b"".join(map(_pack, bits))


def unpack_normals(content: bytes, n_points: int) -> FloatArray:
    """Return the normals (n, 3)."""
    _check(content, 12 * n_points, "normals")
    columns = [_unpack(content[4 * n_points * i :][: 4 * n_points], np.dtype("<i4")) for i in range(3)]
    return np.stack(columns, axis=1).view(np.float32).astype(np.float64)


def pack_colors(colors: NDArray[np.uint8]) -> bytes:
    """Pack colours (n, 3): for red, green, blue in turn, differences folded."""
    return b"".join(map(_pack, np.ascontiguousarray(colors.T).view(np.int8)))


def unpack_colors(content: bytes, n_points: int) -> NDArray[np.uint8]:
    """Return the colours (n, 3)."""
    _check(content, 3 * n_points, "colours")
    columns = [_unpack(content[n_points * i :][:n_points], np.dtype("i1")) for i in range(3)]
    return np.stack(columns, axis=1).view(np.uint8)


def pack_mask(mask: BoolArray) -> bytes:
    """Pack a mask (k, n): a row of ceil(n / 8) bytes per view, the first point in the highest bit."""
    return np.packbits(mask, axis=1).tobytes()


def unpack_mask(content: bytes, n_views: int, n_points: int) -> BoolArray:
    """Return the mask (k, n)."""
    width = -(-n_points // 8)
    _check(content, n_views * width, "visibility bits")
    rows = np.frombuffer(content, np.uint8).reshape(n_views, width)
    return np.unpackbits(rows, axis=1, count=n_points).view(np.bool_)


def pack_scans(points: ScanPoints, mask: BoolArray, places: Views) -> bytes:
    """Return the bytes of k scans whose points stand one after the other; `mask` (k, n) says whose each point is."""
    of_points: dict[str, NDArray[Any]] = {"position": points.positions, "face_id": points.face_ids, **points.columns}
    offsets = np.cumsum([0, *np.count_nonzero(mask, axis=1)], dtype=np.int64)
    file = io.BytesIO()
    for array in (offsets, places.table, _table(dict(points.facts)), _table(of_points)):
        np.save(file, array, allow_pickle=False)
    return file.getvalue()


def unpack_scans(content: bytes) -> tuple[ScanPoints, BoolArray, Views]:
    """Return what was packed.

    Raises
    ------
    ValueError, KeyError
        It is something else.
    """
    file = io.BytesIO(content)
    offsets, table, facts, rows = (np.load(file, allow_pickle=False) for _ in range(4))
    lengths = np.diff(offsets)
    if len(table) != len(lengths) or len(facts) != len(lengths) or offsets[-1] != len(rows):
        raise ValueError(f"{len(lengths)} scans, where there are {len(table)} places and {len(rows)} points")
    columns = {name: np.ascontiguousarray(rows[name]) for name in rows.dtype.names or ()}
    points = ScanPoints(
        columns.pop("position"),
        columns.pop("face_id"),
        columns["normal"],
        columns.get("color"),
        columns=columns,
        facts={name: facts[name] for name in facts.dtype.names or ()},
    )
    mask = np.repeat(np.arange(len(lengths)), lengths) == np.arange(len(lengths))[:, None]
    return points, mask, Views.from_table(table)


def _table(columns: dict[str, NDArray[Any]]) -> NDArray[Any]:
    kinds = [(name, values.dtype.newbyteorder("<"), values.shape[1:]) for name, values in columns.items()]
    rows: NDArray[Any] = np.empty(len(next(iter(columns.values()))), kinds)
    for name, values in columns.items():
        rows[name] = values
    return rows


def _pack(values: NDArray[Any]) -> bytes:
    kind = values.dtype
    differences = np.diff(values, prepend=kind.type(0))  # wraps around, and back again
    folded = (differences << kind.type(1)) ^ (differences >> kind.type(8 * kind.itemsize - 1))
    return folded.astype(kind.newbyteorder("<")).view(np.uint8).reshape(-1, kind.itemsize).T.tobytes()


def _unpack(content: bytes, kind: np.dtype[Any]) -> NDArray[Any]:
    planes = np.frombuffer(content, np.uint8).reshape(kind.itemsize, -1)
    folded = np.ascontiguousarray(planes.T).view(kind.str.replace("i", "u"))[:, 0]
    differences = (folded >> 1).astype(kind) ^ -(folded & 1).astype(kind)
    return np.cumsum(differences, dtype=kind)


def _check(content: bytes, size: int, what: str) -> None:
    if len(content) != size:
        raise DatasetError(f"the {what} must be {size} bytes; they are {len(content)}. The file is damaged; verify it.")
