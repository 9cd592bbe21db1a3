"""A binary PLY for each cloud, to look at: ply/SPLIT/CLASS/MESH-VARIATION-VIEW.ply, listed in SPLIT_files.txt.

Vertices are x, y, z (float32) and face_id (int32), of scans also range, incidence and so on; nx, ny, nz and red, green,
blue where there are normals and colours. A comment in the header holds all other fields as JSON.
"""

import json
import re
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.clouds import point_columns
from zbuf_occlude.dataset.export import Exported
from zbuf_occlude.dataset.export.names import LONGEST
from zbuf_occlude.dataset.folder import list_of
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.point_files import write_table
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.geometry.cloud import RGB

SPLIT = {"data": ("x", "y", "z"), "normal": ("nx", "ny", "nz"), "color": RGB}
"""Fields of a record that are several properties of a vertex."""
PLACE = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("face_id", "<i4")]


def export(source: Source, out: Path) -> Exported:
    """Write a file per cloud, and for each split the list of its files."""
    files = dict[str, list[str]]()
    for split in source.order:
        written = []
        for records in source.batches(split):
            for record in records:
                place = (int(record[name]) for name in ("mesh_id", "variation", "view_id"))
                written.append(_name(source.plan, *place))
                (out / written[-1]).parent.mkdir(parents=True, exist_ok=True)
                _write_cloud(out / written[-1], record, source.plan.recipe)
        atomic.write_lines(out / list_of(split), written)
        files[split] = written
    return Exported(files, source.n_clouds)


def _name(plan: Plan, mesh_id: int, variation: int, view: int) -> str:
    entry = plan.meshes[mesh_id]
    stem = re.sub(r"[^\w.+-]", "_", PurePosixPath(entry.key).stem)[:LONGEST]
    label = re.sub(r"[^\w+-]", "_", entry.label)[:LONGEST]
    return f"ply/{entry.split}/{label}/{mesh_id:05d}-{stem}-{variation}-{view:03d}.ply"


def _vertex_type(recipe: Recipe) -> np.dtype[Any]:
    columns = point_columns(recipe)
    single = [(name, kind) for name, (kind, shape) in columns.items() if not shape]
    split = [(part, columns[name][0]) for name, parts in SPLIT.items() if name in columns for part in parts]
    return np.dtype([*PLACE, *single, *split])


def _write_cloud(path: Path, record: Any, recipe: Recipe) -> None:
    columns = point_columns(recipe)
    table = np.empty(len(record["data"]), _vertex_type(recipe))
    for name in ("data", *columns):
        for part, values in zip(SPLIT.get(name, (name,)), np.atleast_2d(record[name].T), strict=True):
            table[part] = values
    table["face_id"] = record["face_ids"]
    facts = {name: record[name].tolist() for name in record.dtype.names if name not in ("data", "face_ids", *columns)}
    write_table(path, table, comment=json.dumps(facts), synced=False)
