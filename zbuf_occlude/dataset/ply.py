"""Point clouds as binary PLY, to look at. (trimesh writes no normals for points, hence ours.)"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.dataset import atomic

TYPES = {"<f8": "double", "<f4": "float", "<i4": "int", "|u1": "uchar"}

RGB = ("red", "green", "blue")


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
    fields: list[tuple[str, str]] = [(axis, "<f8") for axis in "xyz"]
    if normals is not None:
        fields += [(axis, "<f4") for axis in ("nx", "ny", "nz")]
    if colors is not None:
        fields += [(name, "|u1") for name in RGB]
    table = np.empty(len(positions), dtype=fields)
    for axis, name in enumerate("xyz"):
        table[name] = positions[:, axis]
        if normals is not None:
            table["n" + name] = normals[:, axis]
        if colors is not None:
            table[RGB[axis]] = colors[:, axis]
    write_table(path, table)


def write_table(path: Path, table: NDArray[Any], *, comment: str = "") -> None:
    """Write a structured array as the vertices of a PLY; `comment` is one line of its header."""
    header = ["ply", "format binary_little_endian 1.0", *([f"comment {comment}"] if comment else [])]
    header.append(f"element vertex {len(table)}")
    header += [f"property {TYPES[table.dtype[name].str]} {name}" for name in table.dtype.names or ()]
    text = "\n".join([*header, "end_header", ""])
    atomic.write(path, lambda file: file.write(text.encode() + table.tobytes()))
