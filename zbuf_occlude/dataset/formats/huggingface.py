"""A folder for Hugging Face's datasets: Parquet shards of 2,048 clouds, and a card that says what is in them.

data/train-000000.parquet ...    points, label, mesh (its key), face_ids, view, pose, centre, factor, ...
README.md                        the card: splits, types of the columns, names of the classes

datasets.load_dataset("FOLDER")  reads it; nothing is uploaded.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.clouds import point_fields, record_type
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.ragged import OFFSETS, laid_out, taken
from zbuf_occlude.dataset.source import Content, Source, kept, source_of_files
from zbuf_occlude.extras import importing

CARD = "README.md"
_ROWS_PER_GROUP = 128


def check(plan: Plan) -> None:
    """Raise UnavailableError where the package pyarrow is missing or broken."""
    _arrow()


def names(plan: Plan) -> Iterator[str]:
    """Yield the card's name, and of as many shards as the plan's clouds may need."""
    yield CARD
    yield from (_name(part.split, part.number) for part in plan.parts)


def write_part(content: Content, out: Path) -> list[str]:
    """Write one shard."""
    (out / "data").mkdir(exist_ok=True)
    name = _name(content.split, content.number)
    _write_shard(out / name, content.records, content.plan)
    return [name]


def finish(out: Path, plan: Plan, names: dict[str, list[str]], n_clouds: dict[str, int]) -> dict[str, list[str]]:
    """Write the card."""
    atomic.write(out / CARD, lambda file: file.write(_card(plan, n_clouds).encode()))
    return {split: [*names_of_split, CARD] for split, names_of_split in names.items()}


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> Source:
    """Return the clouds of these shards; the last shard used is kept in memory."""
    paths = {split: [out / name for name in names if name != CARD] for split, names in files.items()}
    return source_of_files(plan, paths, _count, kept(lambda path: _read_shard(path, plan)))


def _name(split: str, number: int) -> str:
    return f"data/{split}-{number:06d}.parquet"


def _arrow() -> Any:
    with importing("pyarrow", "format huggingface"):
        import pyarrow.parquet
    return pyarrow


def _write_shard(path: Path, records: NDArray[Any], plan: Plan) -> None:
    arrow = _arrow()
    columns = {"mesh": arrow.array([plan.meshes[int(i)].key for i in records["mesh_id"]])}
    arrays = laid_out(records, plan.recipe)
    offsets = arrays.pop(OFFSETS, None)
    for name, values in arrays.items():
        column = _column(arrow, values[:, 0] if name == "label" else values)
        if offsets is not None and name in point_fields(plan.recipe):
            column = arrow.ListArray.from_arrays(arrow.array(offsets, arrow.int32()), column)
        columns["points" if name == "data" else name] = column
    table = arrow.table(columns)
    atomic.write(path, lambda file: arrow.parquet.write_table(table, file, row_group_size=_ROWS_PER_GROUP))


def _column(arrow: Any, values: NDArray[Any]) -> Any:
    """Nest an array (n, a, b) into lists of known lengths."""
    column = arrow.array(np.ascontiguousarray(values).reshape(-1))
    for length in reversed(values.shape[1:]):
        column = arrow.FixedSizeListArray.from_arrays(column, length)
    return column


def _read_shard(path: Path, plan: Plan) -> NDArray[Any]:
    with path.open("rb") as file:  # names that are no text cannot be given to Arrow
        table, arrays = _arrow().parquet.read_table(file), dict[str, NDArray[Any]]()
    kinds, points = record_type(plan.recipe), point_fields(plan.recipe)
    for name in kinds.names or ():
        column = table["points" if name == "data" else name].combine_chunks()
        ragged = plan.recipe.sample_size is None and name in points
        if ragged:
            arrays[OFFSETS] = column.offsets.to_numpy()
        while hasattr(column, "flatten"):
            column = column.flatten()
        shape = (-1, *points[name][1]) if ragged else (len(table), *kinds[name].shape)
        arrays[name] = column.to_numpy(zero_copy_only=False).reshape(shape)
    return taken(arrays, np.arange(len(table)), plan.recipe)


def _count(path: Path) -> int:
    with path.open("rb") as file:
        return int(_arrow().parquet.read_metadata(file).num_rows)


def _card(plan: Plan, splits: Iterable[str]) -> str:
    recipe = plan.recipe
    kind = record_type(recipe)
    lines = ["---", "configs:", "- config_name: default", "  data_files:"]
    for split in splits:
        lines += [f"  - split: {'validation' if split == 'val' else split}", f"    path: data/{split}-*.parquet"]
    lines += ["dataset_info:", "  features:", "  - name: mesh", "    dtype: string"]
    for name in kind.names or ():
        lines.append(f"  - name: {'points' if name == 'data' else name}")
        if name == "label":
            lines += ["    dtype:", "      class_label:", "        names:"]
            lines += [f"          '{number}': {_quoted(label)}" for number, label in enumerate(plan.classes)]
            continue
        if kind[name].hasobject:
            dtype, row = point_fields(recipe)[name]
            lines += ["    list:", *_listed(np.dtype(dtype).name, row, "      ")]
            continue
        lines += _listed(kind[name].base.name, kind[name].shape, "    ")
    how = "whole surfaces" if recipe.complete else f"what {len(plan.views)} views ({recipe.views}) see of each"
    size = f"{recipe.sample_size:,} points" if recipe.sample_size else "all visible points"
    lines += [
        "---",
        "",
        f"# Occluded point clouds of {len(plan.meshes):,} meshes, {len(plan.classes):,} classes",
        "",
        f"Made by zbuf_occlude: {how}, {size} per cloud, hidden surfaces removed by",
        f"`{recipe.method}`. `manifest.json` has all options, versions, checksums and the measured error.",
        "",
        "`points` are (p - `centre`) * `factor` of the visible points p; `pose` is the view matrix (world to eye",
        "space, the camera looks along -z); `view` is azimuth and elevation in radians and the distance.",
        "",
    ]
    return "\n".join(lines)


def _listed(dtype: str, lengths: tuple[int, ...], indent: str) -> list[str]:
    """Say the type of a column of nested lists; its reader wants the lists before their lengths."""
    if not lengths:
        return [f"{indent}dtype: {dtype}"]
    inner = [f"{indent}list: {dtype}"]
    if len(lengths) > 1:
        inner = [f"{indent}list:", *_listed(dtype, lengths[1:], indent + "  ")]
    return [*inner, f"{indent}length: {lengths[0]}"]


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"
