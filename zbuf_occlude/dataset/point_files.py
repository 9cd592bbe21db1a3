"""Point clouds as files: binary PLY (trimesh writes no normals for points), and PCD 0.7 as Open3D and PCL read it."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.dataset import atomic
from zbuf_occlude.geometry.cloud import columns_of

TYPES = {"<f8": "double", "<f4": "float", "<i4": "int", "|u1": "uchar"}

_HEADER = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS {names}
SIZE {sizes}
TYPE {types}
COUNT {counts}
WIDTH {n}
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS {n}
DATA binary
"""


def write_ply(
    path: Path, positions: FloatArray, normals: FloatArray | None = None, colors: NDArray[np.uint8] | None = None
) -> None:
    """Write a cloud as little-endian binary PLY.

    Parameters
    ----------
    path : Path
    positions : (n, 3) float
        Written as float64, so that nothing is lost.
    normals : (n, 3) float, optional
        Written as float32.
    colors : (n, 3) uint8, optional
        Red, green, blue.
    """
    write_table(path, columns_of(positions, normals, colors))


def write_table(path: Path, table: NDArray[Any], *, comment: str = "", synced: bool = True) -> None:
    """Write a structured array as the vertices of a PLY; `comment` is one line of its header."""
    header = ["ply", "format binary_little_endian 1.0", *([f"comment {comment}"] if comment else [])]
    header.append(f"element vertex {len(table)}")
    header += [f"property {TYPES[table.dtype[name].str]} {name}" for name in table.dtype.names or ()]
    text = "\n".join([*header, "end_header", ""])
    atomic.write(path, lambda file: file.write(text.encode() + table.tobytes()), synced=synced)


def write_csv(path: Path, table: NDArray[Any]) -> None:
    """Write a structured array as lines of numbers between commas, below a line of its columns' names."""
    names = table.dtype.names or ()
    rows = np.stack([table[name].astype(np.float64) for name in names], axis=1)
    header = ",".join(names)
    atomic.write(path, lambda file: np.savetxt(file, rows, delimiter=",", header=header, comments="", fmt="%.9g"))


def write_pcd(path: Path, record: Any) -> None:
    """Write the points of a record, and their normals and colours where it has them."""
    names = record.dtype.names or ()
    normals, colors = (record[name] if name in names else None for name in ("normal", "color"))
    write_pcd_columns(path, record["data"], normals, colors, synced=False)


def write_pcd_columns(
    path: Path,
    positions: NDArray[Any],
    normals: NDArray[Any] | None = None,
    colors: NDArray[np.uint8] | None = None,
    *,
    synced: bool = True,
) -> None:
    """Write (n, 3) positions, and normals and colours where there are any, as float32.

    A colour is one number, as PCL has it: the bits 0xRRGGBB as a float.
    """
    names, columns = ["x", "y", "z"], [positions.astype("<f4")]
    if normals is not None:
        names += ["normal_x", "normal_y", "normal_z"]
        columns.append(normals.astype("<f4"))
    if colors is not None:
        names.append("rgb")
        columns.append((colors.astype("<u4") @ np.array([1 << 16, 1 << 8, 1], "<u4")).view("<f4")[:, None])
    table = np.concatenate(columns, axis=1)
    repeated = {key: " ".join(word * len(names)) for key, word in (("sizes", "4"), ("types", "F"), ("counts", "1"))}
    header = _HEADER.format(n=len(table), names=" ".join(names), **repeated)
    atomic.write(path, lambda file: file.write(header.encode() + table.tobytes()), synced=synced)
