"""load_cloud: the positions in a file of points without faces; for methods that need no mesh."""

import os
from pathlib import Path

import numpy as np

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.errors import MeshError, in_words
from zbuf_occlude.meshes.archives import read_bytes
from zbuf_occlude.meshes.ply import read_ply_points

SUFFIXES = (".ply", ".npy", ".csv")
"""Endings of the files that `load_cloud` reads, in lower case."""


def load_cloud(path: str | os.PathLike[str]) -> FloatArray | None:
    """Load a point cloud: PLY without faces, .npy of (n, 3), or .csv with x, y, z in front.

    Returns
    -------
    (n, 3) float64 or None
        In the file's own coordinates. None when the file is of another kind: a mesh, perhaps.

    Raises
    ------
    MeshError
        No such file, damaged, or points that are not finite. The message names the file.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        return None
    try:
        positions = read_ply_points(read_bytes(path)) if suffix == ".ply" else _table(path, suffix)
        if positions is None:
            return None
        if not len(positions) or not np.isfinite(positions).all():
            raise MeshError("a point cloud must have points with finite coordinates; this one has not. Clean it.")
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    return positions


def _table(path: Path, suffix: str) -> FloatArray:
    """Read x, y, z of each row of a .npy or .csv file; a first line of words is a heading."""
    try:
        if suffix == ".npy":
            table = np.load(path, allow_pickle=False)
        else:
            with path.open(encoding="utf-8", errors="replace") as file:
                heading = any(letter.isalpha() and letter not in "einfaE" for letter in file.readline())
            table = np.loadtxt(path, delimiter=",", skiprows=int(heading), ndmin=2)
    except (OSError, ValueError) as error:
        raise MeshError(f"it must be readable as numbers; reading says: {in_words(error)}. Check it.") from None
    if table.ndim != 2 or table.shape[1] < 3 or table.dtype.kind not in "fiu":
        raise MeshError(f"it must have rows x, y, z; it has {table.dtype} of shape {table.shape}. Convert it.")
    return np.asarray(table[:, :3], dtype=np.float64)
