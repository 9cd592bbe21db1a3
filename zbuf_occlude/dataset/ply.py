"""Point clouds as binary PLY, to look at. (trimesh writes no normals for points, hence ours.)"""

from pathlib import Path

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.dataset import atomic


def write_ply(path: Path, positions: FloatArray, normals: FloatArray | None = None) -> None:
    """Write a cloud as little-endian binary PLY.

    Parameters
    ----------
    path : Path
    positions : (n, 3) float
        Written as float64, so that nothing is lost.
    normals : (n, 3) float, optional
        Written as float32.
    """
    fields: list[tuple[str, str]] = [(axis, "<f8") for axis in "xyz"]
    if normals is not None:
        fields += [(axis, "<f4") for axis in ("nx", "ny", "nz")]
    table = np.empty(len(positions), dtype=fields)
    for axis, name in enumerate("xyz"):
        table[name] = positions[:, axis]
        if normals is not None:
            table["n" + name] = normals[:, axis]
    ply_types = {"<f8": "double", "<f4": "float"}
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    header += [f"property {ply_types[kind]} {name}" for name, kind in fields] + ["end_header", ""]
    atomic.write(path, lambda file: file.write("\n".join(header).encode() + table.tobytes()))
