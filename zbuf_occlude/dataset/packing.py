"""How the points of an object, and which of them each view sees, become few bytes; pure functions of arrays.

Numbers that grow slowly from point to point become small ones: each is replaced by its difference to the one before,
folded so that small negative ones are small too (0, -1, 1, -2, 2 become 0, 1, 2, 3, 4), and the bytes are regrouped:
first the lowest byte of all, then the next. What is left for the archive's compression (deflate) is mostly zeros.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.errors import DatasetError

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
