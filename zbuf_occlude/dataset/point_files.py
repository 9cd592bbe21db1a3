"""Point clouds as files: PLY, PCD 0.7 as Open3D and PCL read it, and CSV written; also .bin, .npy and .npz read."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import LARGEST, FloatArray
from zbuf_occlude.dataset import atomic
from zbuf_occlude.errors import DatasetError, MeshError, describe, escape_control
from zbuf_occlude.extras import importing
from zbuf_occlude.geometry.cloud import columns_of
from zbuf_occlude.meshes.load import warn_of_foreign_lines
from zbuf_occlude.meshes.ply import read_ply_points

TYPES = {"<f8": "double", "<f4": "float", "<i4": "int", "|u1": "uchar"}
READABLE = (".ply", ".pcd", ".bin", ".npy", ".npz")
"""Suffixes of the files that `read_points` reads."""
MOST_BYTES = 2_000_000_000
"""Maximum size of a file that is read."""
_PCD_HEADER = """# .PCD v0.7 - Point Cloud Data file format
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
        if path.stat().st_size > MOST_BYTES:
            raise DatasetError(f"{name}: a cloud must have at most {MOST_BYTES:,} bytes.")
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
            raise ValueError(f"it must hold {columns} float32 numbers per point; it has {len(data)} bytes")
        return np.frombuffer(data, "<f4").reshape(-1, columns)[:, :3].astype(np.float64)
    loaded: Any = np.load(path, allow_pickle=False)
    table = loaded["points"] if suffix == ".npz" else loaded
    if table.dtype.names is not None:
        return np.stack([table[axis].astype(np.float64) for axis in "xyz"], axis=1)
    if table.ndim != 2 or table.shape[1] < 3 or table.dtype.kind not in "fiu":
        raise ValueError(f"it must hold rows of x, y, z; it has {table.dtype} of shape {table.shape}")
    return np.asarray(table[:, :3], np.float64)


def write_ply(
    path: Path, positions: FloatArray, normals: FloatArray | None = None, colors: NDArray[np.uint8] | None = None
) -> None:
    """Write a cloud (n, 3) as little-endian binary PLY: float64, so that nothing is lost, float32 and uint8."""
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
    header = _PCD_HEADER.format(n=len(table), names=" ".join(names), **repeated)
    atomic.write(path, lambda file: file.write(header.encode() + table.tobytes()), synced=synced)
