"""A binary PLY for each cloud, to look at: ply/SPLIT/CLASS/MESH-VARIATION-VIEW.ply, listed in SPLIT_files.txt.

Vertices are x, y, z (float32) and face_id (int32), of scans also range, incidence and so on; nx, ny, nz and red, green,
blue where there are normals and colours. A comment in the header holds all other fields as JSON.
"""

import json
import re
from collections.abc import Iterator
from functools import partial
from itertools import product, starmap
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.clouds import point_columns, record_type
from zbuf_occlude.dataset.damage import reading
from zbuf_occlude.dataset.folder import list_of
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.ply import RGB, write_table
from zbuf_occlude.dataset.source import Content, Source, source_of_files

SPLIT = {"data": ("x", "y", "z"), "normal": ("nx", "ny", "nz"), "color": RGB}
"""Fields of a record that are several properties of a vertex."""
PLACE = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("face_id", "<i4")]


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all clouds."""
    return starmap(
        partial(_name, plan), product(*map(range, (len(plan.meshes), plan.recipe.variations, len(plan.views))))
    )


def write_part(content: Content, out: Path) -> list[str]:
    """Write a file a cloud."""
    names, plan = list[str](), content.plan
    for record in content.records:
        names.append(_name(plan, int(record["mesh_id"]), int(record["variation"]), int(record["view_id"])))
        (out / names[-1]).parent.mkdir(parents=True, exist_ok=True)
        _write_cloud(out / names[-1], record, plan.recipe)
    return names


def finish(out: Path, plan: Plan, names: dict[str, list[str]], n_clouds: dict[str, int]) -> dict[str, list[str]]:
    """Write for each split the list of its files."""
    for split, names_of_split in names.items():
        atomic.write_lines(out / list_of(split), names_of_split)
    return {split: [list_of(split)] for split in names}


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the clouds of the files in these lists."""
    paths = {}
    for split, names in files.items():
        with reading(out / names[0]):
            paths[split] = [out / line for line in (out / names[0]).read_text().splitlines()]
    return source_of_files(
        plan, paths, lambda path: 1, lambda path, rows: _read_cloud(path, plan.recipe)[rows], one_each=True
    )


def _name(plan: Plan, mesh_id: int, variation: int, view: int) -> str:
    entry = plan.meshes[mesh_id]
    stem = re.sub(r"[^\w.+-]", "_", PurePosixPath(entry.key).stem)
    label = re.sub(r"[^\w.+-]", "_", entry.label)
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
    write_table(path, table, comment=json.dumps(facts))


def _read_cloud(path: Path, recipe: Recipe) -> NDArray[Any]:
    vertex = _vertex_type(recipe)
    header, _, body = path.read_bytes().partition(b"end_header\n")
    comment = re.search(rb"^comment (.*)$", header, re.MULTILINE)
    counted = re.search(rb"^element vertex (\d+)$", header, re.MULTILINE)
    size = recipe.sample_size or (int(counted[1]) if counted else 0)
    if comment is None or not size or len(body) != size * vertex.itemsize:
        raise ValueError(f"no PLY of {recipe.sample_size or 'some'} points as written here")
    table = np.frombuffer(body, vertex)
    records = np.zeros(1, record_type(recipe))
    for name, value in json.loads(comment[1]).items():
        records[name][0] = value
    records["face_ids"][0] = table["face_id"]
    for name in ("data", *point_columns(recipe)):
        parts = [table[part] for part in SPLIT.get(name, (name,))]
        records[name][0] = np.stack(parts, axis=1) if name in SPLIT else parts[0]
    return records
