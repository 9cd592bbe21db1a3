"""Point clouds as files: binary PLY, PCD 0.7 as Open3D and PCL read it, and a dataset exported as a PLY for each cloud.

    ply/SPLIT/CLASS/MESH-VARIATION-VIEW.ply     listed in SPLIT_files.txt

Vertices of these are x, y, z (float32) and face_id (int32), of scans also range, incidence and so on; nx, ny, nz and
red, green, blue where there are normals and colours. A comment in the header holds all other fields as JSON.
"""

import json
import re
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.export import LONGEST, Exported
from zbuf_occlude.dataset.folder import list_of
from zbuf_occlude.dataset.plan import DatasetConfig, Plan
from zbuf_occlude.dataset.records import further_fields
from zbuf_occlude.dataset.source import CloudReader
from zbuf_occlude.geometry.cloud import RGB, columns_of

TYPES = {"<f8": "double", "<f4": "float", "<i4": "int", "|u1": "uchar"}
PROPERTIES = {"data": ("x", "y", "z"), "normal": ("nx", "ny", "nz"), "color": RGB}
"""Fields that are several properties of a vertex."""
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


def export(source: CloudReader, out: Path) -> Exported:
    """Write a PLY per cloud, and for each split the list of its files."""
    files = dict[str, list[str]]()
    for split in source.order:
        files[split] = []
        for records in source.batches(split):
            for record in records:
                name = _name(source.plan, record)
                (out / name).parent.mkdir(parents=True, exist_ok=True)
                _write_cloud(out / name, record, source.plan.recipe)
                files[split].append(name)
        atomic.write_lines(out / list_of(split), files[split])
    return Exported(files, source.n_clouds)


def _name(plan: Plan, record: Any) -> str:
    mesh_id, variation, view = (int(record[name]) for name in ("mesh_id", "variation", "view_id"))
    entry = plan.meshes[mesh_id]
    stem = re.sub(r"[^\w.+-]", "_", PurePosixPath(entry.key).stem)[:LONGEST]
    label = re.sub(r"[^\w+-]", "_", entry.label)[:LONGEST]
    return f"ply/{entry.split}/{label}/{mesh_id:05d}-{stem}-{variation}-{view:03d}.ply"


def _write_cloud(path: Path, record: Any, recipe: DatasetConfig) -> None:
    fields = further_fields(recipe)
    single = [(name, kind) for name, (kind, shape) in fields.items() if not shape]
    split = [(part, fields[name][0]) for name, parts in PROPERTIES.items() if name in fields for part in parts]
    place = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("face_id", "<i4")]
    table = np.empty(len(record["data"]), [*place, *single, *split])
    for name in ("data", *fields):
        for part, values in zip(PROPERTIES.get(name, (name,)), np.atleast_2d(record[name].T), strict=True):
            table[part] = values
    table["face_id"] = record["face_ids"]
    facts = {name: record[name].tolist() for name in record.dtype.names if name not in ("data", "face_ids", *fields)}
    write_table(path, table, comment=json.dumps(facts), synced=False)
