"""The scans of an object in a packed file: their points as they are, what the sensor knows of each, where it stood.

Arrays of NumPy's, one behind the other: offsets (k + 1,), the table of the k places, a row per scan, a row per point.
Nothing is rounded, so that clouds drawn of them are those that `generate` draws for any other format, byte for byte.
"""

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.dataset.clouds import ScanPoints
from zbuf_occlude.views import Views


def pack_scans(points: ScanPoints, mask: BoolArray, places: Views) -> bytes:
    """Return the bytes of k scans whose points stand one after the other; `mask` (k, n) says whose each point is."""
    of_points: dict[str, NDArray[Any]] = {"position": points.positions, "face_id": points.face_ids, **points.columns}
    offsets = np.cumsum([0, *np.count_nonzero(mask, axis=1)], dtype=np.int64)
    file = io.BytesIO()
    for array in (offsets, places.table, _rows(dict(points.facts)), _rows(of_points)):
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


def _rows(columns: dict[str, NDArray[Any]]) -> NDArray[Any]:
    kinds = [(name, values.dtype.newbyteorder("<"), values.shape[1:]) for name, values in columns.items()]
    rows: NDArray[Any] = np.empty(len(next(iter(columns.values()))), kinds)
    for name, values in columns.items():
        rows[name] = values
    return rows
