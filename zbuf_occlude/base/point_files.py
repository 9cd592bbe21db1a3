"""Point cloud files: binary PLY, PCD 0.7 as Open3D and PCL read it, CSV; their writers, and a reader of these PCD."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import FloatArray

TYPES = {"<f8": "double", "<f4": "float", "<i4": "int", "|u1": "uchar"}
RGB = ("red", "green", "blue")
"""Properties of a vertex with a colour."""
_PCD_HEADER = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS {names}
SIZE {sizes}
TYPE {types}
COUNT {counts}
WIDTH {width}
HEIGHT {height}
VIEWPOINT {viewpoint}
POINTS {n}
DATA binary
"""


def columns_of(
    positions: FloatArray, normals: FloatArray | None = None, colors: NDArray[np.uint8] | None = None
) -> NDArray[Any]:
    """Return a structured array: x, y, z float64; if given, nx, ny, nz float32 and red, green, blue uint8."""
    fields: list[tuple[str, str]] = [(axis, "<f8") for axis in "xyz"]
    if normals is not None:
        fields += [("n" + axis, "<f4") for axis in "xyz"]
    if colors is not None:
        fields += [(name, "|u1") for name in RGB]
    table = np.empty(len(positions), dtype=fields)
    for number, axis in enumerate("xyz"):
        table[axis] = positions[:, number]
        if normals is not None:
            table["n" + axis] = normals[:, number]
        if colors is not None:
            table[RGB[number]] = colors[:, number]
    return table


def positions_of(table: NDArray[Any]) -> FloatArray:
    """Return x, y, z of each row, float64, of an array (n, 3 or more) or of a structured one such as `columns_of`.

    Raises ValueError for an array of another shape or type.
    """
    if set("xyz") <= set(table.dtype.names or ()):
        return np.stack([table[axis].astype(np.float64) for axis in "xyz"], axis=1)
    if table.ndim != 2 or table.shape[1] < 3 or table.dtype.kind not in "fiu":
        raise ValueError(f"it must have rows of x, y, z; it has {table.dtype} of shape {table.shape}")
    return np.asarray(table[:, :3], dtype=np.float64)


def write_ply(
    path: Path, positions: FloatArray, normals: FloatArray | None = None, colors: NDArray[np.uint8] | None = None
) -> None:
    """Write a cloud (n, 3) as little-endian binary PLY: positions float64, normals float32, colours uint8."""
    write_table(path, columns_of(positions, normals, colors))


def write_table(path: Path, table: NDArray[Any], *, comment: str = "", synced: bool = True) -> None:
    """Write a structured array as the vertices of a PLY; `comment` is one line of its header."""
    header = ["ply", "format binary_little_endian 1.0", *([f"comment {comment}"] if comment else [])]
    header.append(f"element vertex {len(table)}")
    header += [f"property {TYPES[table.dtype[name].str]} {name}" for name in table.dtype.names or ()]
    text = "\n".join([*header, "end_header", ""])
    atomic.write(path, lambda file: file.write(text.encode() + table.tobytes()), synced=synced)


def write_csv(path: Path, table: NDArray[Any]) -> None:
    """Write a structured array as lines of numbers between commas, below a line of its columns' names.

    Each number has the digits that tell it from its neighbours: 17 of float64, 9 of float32.
    """
    names = table.dtype.names or ()
    digits = ["%.17g" if table.dtype[name] == np.float64 else "%.9g" for name in names]
    rows = np.stack([table[name].astype(np.float64) for name in names], axis=1)
    header = ",".join(names)
    atomic.write(path, lambda file: np.savetxt(file, rows, delimiter=",", header=header, comments="", fmt=digits))


def write_pcd(path: Path, record: Any) -> None:
    """Write the points of a record, and their normals and colours where it has them."""
    names = record.dtype.names or ()
    normals, colors = (record[name] if name in names else None for name in ("normal", "color"))
    write_pcd_columns(path, record["data"], normals, colors, synced=False)


def pcl_table(
    positions: NDArray[Any], normals: NDArray[Any] | None = None, colors: NDArray[np.uint8] | None = None
) -> tuple[list[str], NDArray[np.float32]]:
    """Return the names and values (n, fields) of PCL's fields of points, float32.

    A colour is one number: the bits 0xRRGGBB as a float.
    """
    names, columns = ["x", "y", "z"], [positions.astype("<f4")]
    if normals is not None:
        names += ["normal_x", "normal_y", "normal_z"]
        columns.append(normals.astype("<f4"))
    if colors is not None:
        names.append("rgb")
        columns.append((colors.astype("<u4") @ np.array([1 << 16, 1 << 8, 1], "<u4")).view("<f4")[:, None])
    return names, np.concatenate(columns, axis=1)


def write_pcd_columns(
    path: Path,
    positions: NDArray[Any],
    normals: NDArray[Any] | None = None,
    colors: NDArray[np.uint8] | None = None,
    *,
    size: tuple[int, int] | None = None,
    viewpoint: Sequence[float] = (0, 0, 0, 1, 0, 0, 0),
    synced: bool = True,
) -> None:
    """Write (n, 3) positions, and normals and colours where there are any (`pcl_table`).

    An organised cloud has the points of the pixels of an image, row by row: `size` is its height and width. `viewpoint`
    is the sensor's position and quaternion w x y z.
    """
    names, table = pcl_table(positions, normals, colors)
    repeated = {key: " ".join(word * len(names)) for key, word in (("sizes", "4"), ("types", "F"), ("counts", "1"))}
    height, width = size or (1, len(table))
    placed = {"width": width, "height": height, "viewpoint": " ".join(f"{number:.9g}" for number in viewpoint)}
    header = _PCD_HEADER.format(n=len(table), names=" ".join(names), **placed, **repeated)
    atomic.write(path, lambda file: file.write(header.encode() + table.tobytes()), synced=synced)


def read_pcd_positions(path: Path) -> NDArray[np.float32]:
    """Return the positions (n, 3) in a file of `write_pcd_columns`; a ValueError where it is not one."""
    header, _, body = path.read_bytes().partition(b"DATA binary\n")
    names = next((line.split()[1:] for line in header.splitlines() if line.startswith(b"FIELDS ")), [])
    if names[:3] != [b"x", b"y", b"z"]:
        raise ValueError("it must be a binary PCD that begins with x, y, z")
    return np.frombuffer(body, "<f4").reshape(-1, len(names))[:, :3]
