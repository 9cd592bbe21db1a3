"""Reader of cloud files: PLY, PCD, KITTI's and nuScenes' .bin, .npy and .npz."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.base.arrays import LARGEST, FloatArray
from zbuf_occlude.base.errors import DatasetError, MeshError, describe, escape_control
from zbuf_occlude.base.extras import importing
from zbuf_occlude.base.point_files import positions_of
from zbuf_occlude.meshes.load import warn_of_foreign_lines
from zbuf_occlude.meshes.ply import read_ply_points

READABLE = (".ply", ".pcd", ".bin", ".npy", ".npz")
"""Suffixes of the files that `read_points` reads."""
MAX_BYTES = 2_000_000_000
"""Maximum size of a file that is read."""


def read_points(path: Path) -> FloatArray:
    """Read the points (n, 3) of a cloud in its file's frame and unit; points not finite or at the origin are left out.

    Parameters
    ----------
    path : Path
        PLY without faces; PCD; ``.bin`` of KITTI (x, y, z, intensity as float32) or, where the name ends in
        ``.pcd.bin``, of nuScenes (and ring); ``.npy``: (n, 3 or more), or structured with x, y, z as `Cloud.save`
        writes; ``.npz`` with ``points``.

    Raises
    ------
    DatasetError
        The file cannot be read, has another format, has no points, or has coordinates beyond `LARGEST`.
    UnavailableError
        PCD without Open3D.
    """
    name, suffix = escape_control(str(path)), path.suffix.lower()
    if suffix not in READABLE:
        raise DatasetError(f"{name}: a cloud must end in one of {', '.join(READABLE)}.")
    try:
        if path.stat().st_size > MAX_BYTES:
            raise DatasetError(f"{name}: a cloud must have at most {MAX_BYTES:,} bytes.")
        points = _read(path, suffix)
    except (OSError, ValueError, KeyError, MeshError) as error:
        raise DatasetError(f"{name}: cannot read the points: {escape_control(describe(error))}") from None
    return real_points(points, name)


def real_points(points: FloatArray, name: str) -> FloatArray:
    """Return the points that are finite and not at the origin, where sensors put what did not return.

    Raises DatasetError, with `name`, where none is left or one is beyond `LARGEST`.
    """
    points = points[np.isfinite(points).all(axis=1) & points.any(axis=1)]
    if not len(points):
        raise DatasetError(f"{name} must have points; it has none.")
    if (np.abs(points) > LARGEST).any():
        raise DatasetError(f"{name}: coordinates must be below {LARGEST:g}; one is {np.abs(points).max():g}. Clean it.")
    return points


def _read(path: Path, suffix: str) -> FloatArray:
    if suffix == ".ply":
        data = path.read_bytes()
        vertices = read_ply_points(data)
        warn_of_foreign_lines(path, data)
        if vertices is None:
            raise ValueError("it has faces: it is a mesh")
        return vertices
    if suffix == ".pcd":
        with importing("open3d", "reading PCD"):
            import open3d
        return np.asarray(open3d.io.read_point_cloud(path).points, dtype=np.float64)
    if suffix == ".bin":
        columns, data = 5 if path.name.lower().endswith(".pcd.bin") else 4, path.read_bytes()
        if len(data) % (4 * columns):
            raise ValueError(
                f"it must hold {columns} float32 numbers per point; it has {len(data)} bytes. Is it cut short?"
            )
        return np.frombuffer(data, "<f4").reshape(-1, columns)[:, :3].astype(np.float64)
    loaded: Any = np.load(path, allow_pickle=False)
    if isinstance(loaded, Mapping):  # an archive, whatever its suffix
        if "points" not in loaded:
            raise ValueError(f"it must have an array `points`; it has {', '.join(loaded) or 'none':.200}")
        loaded = loaded["points"]
    return positions_of(loaded)
