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
from zbuf_occlude.dataset.export import Exported
from zbuf_occlude.dataset.export.shared import LONGEST
from zbuf_occlude.dataset.folder import list_of
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.records import further_fields
from zbuf_occlude.dataset.source import Source

TYPES = {"<f8": "double", "<f4": "float", "<i4": "int", "|u1": "uchar"}
PROPERTIES = {"data": ("x", "y", "z"), "normal": ("nx", "ny", "nz"), "color": ("red", "green", "blue")}
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
    columns = {"data": ("<f8", positions), "normal": ("<f4", normals), "color": ("|u1", colors)}
    given = [
        (name, kind, values[:, axis])
        for field, (kind, values) in columns.items()
        if values is not None
        for axis, name in enumerate(PROPERTIES[field])
    ]
    table = np.empty(len(positions), [(name, kind) for name, kind, _ in given])
    for name, _, values in given:
        table[name] = values
    write_table(path, table)


def write_table(path: Path, table: NDArray[Any], *, comment: str = "", synced: bool = True) -> None:
    """Write a structured array as the vertices of a PLY; `comment` is one line of its header."""
    header = ["ply", "format binary_little_endian 1.0", *([f"comment {comment}"] if comment else [])]
    header.append(f"element vertex {len(table)}")
    header += [f"property {TYPES[table.dtype[name].str]} {name}" for name in table.dtype.names or ()]
    text = "\n".join([*header, "end_header", ""])
    atomic.write(path, lambda file: file.write(text.encode() + table.tobytes()), synced=synced)


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
    header = _PCD_HEADER.format(n=len(table), names=" ".join(names), **repeated)
    atomic.write(path, lambda file: file.write(header.encode() + table.tobytes()), synced=False)


def export(source: Source, out: Path) -> Exported:
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


def _write_cloud(path: Path, record: Any, recipe: Recipe) -> None:
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
