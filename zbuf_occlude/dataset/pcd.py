"""Point clouds as PCD 0.7, binary and uncompressed, as Open3D and PCL read them: fields x, y, z, float32."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic

_HEADER = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS x y z
SIZE 4 4 4
TYPE F F F
COUNT 1 1 1
WIDTH {n}
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS {n}
DATA binary
"""


def write_pcd(path: Path, positions: NDArray[Any]) -> None:
    """Write a cloud (n, 3), making the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    content = _HEADER.format(n=len(positions)).encode() + positions.astype("<f4").tobytes()
    atomic.write(path, lambda file: file.write(content))


def read_pcd(path: Path) -> NDArray[np.float32]:
    """Read a cloud as `write_pcd` writes it.

    Raises
    ------
    ValueError
        It is not one.
    """
    header, mark, body = path.read_bytes().partition(b"DATA binary\n")
    if not mark or b"FIELDS x y z\n" not in header or len(body) % 12:
        raise ValueError(f"{path.name} is no PCD as written here")
    return np.frombuffer(body, "<f4").reshape(-1, 3)
