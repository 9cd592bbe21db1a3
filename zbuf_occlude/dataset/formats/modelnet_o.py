"""ModelNet-O's layout: CLASS/{train,test}/OBJECT_001.xyz ..., a text file per cloud, x y z per line."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.formats.published import (
    Names,
    check_version,
    listed,
    names_of,
    read_cloud_files,
    rest_name,
    write_rest,
)
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import Content, Source


def names(plan: Plan) -> Iterator[str]:
    """Yield the names of all files."""
    names = names_of(plan)
    yield from (rest_name(part.split, part.number) for part in plan.parts)
    for mesh_id, entry in enumerate(plan.meshes):
        yield from (_name(entry.split, names, mesh_id, number) for number in range(plan.clouds_per_mesh))


def write_part(content: Content, out: Path) -> list[str]:
    """Write a file per cloud, and what they lack."""
    names, written = names_of(content.plan), []
    for record in content.records:
        written.append(_name_of(content.split, names, record, content.plan))
        _write_xyz(out / written[-1], record["data"])
    return [write_rest(out, content), *written]


def finish(out: Path, plan: Plan, names: dict[str, list[str]], n_clouds: dict[str, int]) -> dict[str, list[str]]:
    """Write for each split the list of its clouds."""
    return listed(out, names)


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the clouds; as text holds nine digits, they are the very numbers that were written."""
    check_version(plan, since=8)

    def name_of(split: str, names: Names, record: Any) -> str:
        return _name_of(split, names, record, plan)

    return read_cloud_files(out, plan, files, _read_xyz, name_of)


def _name(split: str, names: Names, mesh_id: int, number: int) -> str:
    return f"{names.classes[mesh_id]}/{split}/{names.objects[mesh_id]}_{number + 1:03d}.xyz"


def _name_of(split: str, names: Names, record: Any, plan: Plan) -> str:
    number = int(record["variation"]) * len(plan.views) + int(record["view_id"])
    return _name(split, names, int(record["mesh_id"]), number)


def _write_xyz(path: Path, positions: NDArray[Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    text = "%.9g %.9g %.9g\n" * len(positions) % tuple(positions.ravel().tolist())  # a third of np.savetxt's time
    atomic.write(path, lambda file: file.write(text.encode()))


def _read_xyz(path: Path) -> NDArray[Any]:
    return np.loadtxt(path, dtype=np.float32, ndmin=2)
