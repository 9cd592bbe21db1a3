"""The layout of modelnet40_normal_resampled, as PointNet++'s loaders read it; a cloud is a shape of its own there.

CLASS/CLASS_0001.txt ...                     x,y,z per line, y up; with `--with normals` x,y,z,nx,ny,nz
modelnet40_train.txt, modelnet40_test.txt    CLASS_0001 ... (and modelnet40_val.txt)
modelnet40_shape_names.txt                   the 40 classes

Loaders take the part of a shape's name before its last "_" for its class, and centre and scale each cloud themselves.
The axes are those of modelnet40_ply_hdf5_2048, to which ModelNet40-C turns meshes; about the vertical that is assumed.
"""

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.formats.published import (
    Names,
    from_theirs,
    listed,
    read_cloud_files,
    rest_name,
    to_theirs,
    write_rest,
)
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Content, Source

NAME, SHAPES = "modelnet40-normal", "modelnet40_shape_names.txt"


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    yield from (SHAPES, *map(_list_of, plan.splits))
    yield from (rest_name(part.split, part.number) for part in plan.parts)
    for mesh_id in range(len(plan.meshes)):
        yield from (_name(plan, mesh_id, number) for number in range(plan.clouds_per_mesh))


def write_part(content: Content, out: Path) -> list[str]:
    """Write a file per cloud, and what they lack."""
    written = []
    for record in content.records:
        written.append(_name_of(content.plan, record))
        columns = [record[name] for name in ("data", "normal") if name in (record.dtype.names or ())]
        _write_text(out / written[-1], np.hstack([to_theirs(each, content.plan.recipe, NAME) for each in columns]))
    return [write_rest(out, content), *written]


def finish(out: Path, plan: Plan, names: dict[str, list[str]], n_clouds: dict[str, int]) -> dict[str, list[str]]:
    """Write the lists of classes and clouds."""
    atomic.write_lines(out / SHAPES, plan.classes)
    for split, of_split in names.items():
        shapes = [Path(name).stem for name in of_split if name.endswith(".txt")]
        atomic.write_lines(out / _list_of(split), shapes)
    files = listed(out, names)
    return {split: [*of_split, SHAPES, _list_of(split)] for split, of_split in files.items()}


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the clouds; as text holds nine digits, they are the very numbers that were written."""

    def name_of(split: str, names: Names, record: Any) -> str:
        return _name_of(plan, record)

    return read_cloud_files(out, plan, files, lambda path: from_theirs(_read_text(path), plan.recipe, NAME), name_of)


def _list_of(split: str) -> str:
    return f"modelnet40_{split}.txt"


def _name_of(plan: Plan, record: Any) -> str:
    return _name(plan, int(record["mesh_id"]), int(record["variation"]) * len(plan.views) + int(record["view_id"]))


def _name(plan: Plan, mesh_id: int, number: int) -> str:
    label = plan.meshes[mesh_id].label
    return f"{label}/{label}_{_ranks(plan)[mesh_id] * plan.clouds_per_mesh + number + 1:04d}.txt"


@lru_cache(maxsize=2)
def _ranks(plan: Plan) -> list[int]:
    """Number the meshes of each class."""
    n_before, ranks = dict[str, int](), []
    for entry in plan.meshes:
        ranks.append(n_before.get(entry.label, 0))
        n_before[entry.label] = ranks[-1] + 1
    return ranks


def _write_text(path: Path, values: NDArray[Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    line = ",".join(["%.9g"] * values.shape[1]) + "\n"
    text = line * len(values) % tuple(values.ravel().tolist())
    atomic.write(path, lambda file: file.write(text.encode()))


def _read_text(path: Path) -> NDArray[Any]:
    return np.loadtxt(path, dtype=np.float32, delimiter=",", ndmin=2)[:, :3]
