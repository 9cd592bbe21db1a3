"""Export of a dataset as a PLY for each cloud.

    ply/SPLIT/CLASS/MESH-VARIATION-VIEW.ply     listed in SPLIT_files.txt

Vertices are x, y, z (float32) and face_id (int32), of scans also range, incidence and so on; nx, ny, nz and red, green,
blue where there are normals and colours. A comment in the header holds all other fields as JSON.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.base import atomic
from zbuf_occlude.base.point_files import RGB, write_table
from zbuf_occlude.datasets.export import Exported, names_of
from zbuf_occlude.datasets.folder import list_of
from zbuf_occlude.datasets.plan import DatasetConfig
from zbuf_occlude.datasets.records import further_fields
from zbuf_occlude.datasets.source import CloudReader

PROPERTIES = {"data": ("x", "y", "z"), "normal": ("nx", "ny", "nz"), "color": RGB}
"""Fields that are several properties of a vertex."""


def export(source: CloudReader, out: Path) -> Exported:
    """Write a PLY per cloud, and for each split the list of its files."""
    names, files = names_of(source.plan), dict[str, list[str]]()
    for split in source.order:
        files[split] = []
        for records in source.batches(split):
            for record in records:
                mesh_id, variation, view = (int(record[each]) for each in ("mesh_id", "variation", "view_id"))
                path = f"ply/{split}/{{label}}/{mesh_id:05d}-{{name}}-{variation}-{view:03d}.ply"
                name = names.object_file(path, mesh_id)
                (out / name).parent.mkdir(parents=True, exist_ok=True)
                _write_cloud(out / name, record, source.plan.config)
                files[split].append(name)
        atomic.write_lines(out / list_of(split), files[split])
    return Exported(files, source.n_clouds)


def _write_cloud(path: Path, record: Any, config: DatasetConfig) -> None:
    fields = further_fields(config)
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
