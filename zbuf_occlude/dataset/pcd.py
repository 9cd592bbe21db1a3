"""Point clouds as PCD 0.7, binary and uncompressed, as Open3D and PCL read them: positions, normals, colours."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic

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


def write_pcd(path: Path, record: Any) -> None:
    """Write the points of a record, and their normals and colours where it has them.

    A colour is one number, as PCL has it: the bits 0xRRGGBB as a float.
    """
    names, columns = ["x", "y", "z"], [record["data"].astype("<f4")]
    if "normal" in (record.dtype.names or ()):
        names += ["normal_x", "normal_y", "normal_z"]
        columns.append(record["normal"].astype("<f4"))
    if "color" in (record.dtype.names or ()):
        names.append("rgb")
        columns.append((record["color"].astype("<u4") @ np.array([1 << 16, 1 << 8, 1], "<u4")).view("<f4")[:, None])
    table = np.concatenate(columns, axis=1)
    repeated = {key: " ".join(word * len(names)) for key, word in (("sizes", "4"), ("types", "F"), ("counts", "1"))}
    header = _HEADER.format(n=len(table), names=" ".join(names), **repeated)
    atomic.write(path, lambda file: file.write(header.encode() + table.tobytes()))


def read_pcd(path: Path) -> NDArray[np.float32]:
    """Read the positions (n, 3) of a cloud as `write_pcd` writes it.

    Raises
    ------
    ValueError
        It is not one.
    """
    header, mark, body = path.read_bytes().partition(b"DATA binary\n")
    fields = next((line.split()[1:] for line in header.splitlines() if line.startswith(b"FIELDS ")), [])
    if not mark or fields[:3] != [b"x", b"y", b"z"] or len(body) % (4 * len(fields)):
        raise ValueError(f"{path.name} is no PCD as written here")
    return np.frombuffer(body, "<f4").reshape(-1, len(fields))[:, :3]
