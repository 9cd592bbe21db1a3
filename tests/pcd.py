"""PCD files read as their description says, for tests of what is written."""

from pathlib import Path

import numpy as np


def read_pcd(path: Path) -> np.ndarray:
    """Read the positions (n, 3) of a binary PCD whose first fields are x, y, z."""
    header, _, body = path.read_bytes().partition(b"DATA binary\n")
    fields = next(line.split()[1:] for line in header.splitlines() if line.startswith(b"FIELDS "))
    assert fields[:3] == [b"x", b"y", b"z"]
    return np.frombuffer(body, "<f4").reshape(-1, len(fields))[:, :3]
