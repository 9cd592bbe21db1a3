"""A folder for Hugging Face's datasets: Parquet shards of 2,048 clouds, and a card that says what is in them.

data/train-000000.parquet ...    points, label, mesh (its key), face_ids, view, pose, centre, factor, ...
README.md                        the card: splits, types of the columns, names of the classes

datasets.load_dataset("FOLDER")  reads it; nothing is uploaded.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base import atomic
from zbuf_occlude.base.extras import importing
from zbuf_occlude.datasets.export import Exported
from zbuf_occlude.datasets.plan import Plan
from zbuf_occlude.datasets.records import OFFSETS, Records, point_fields, record_type, to_arrays
from zbuf_occlude.datasets.source import CloudReader

_ROWS_PER_GROUP = 128


def check(plan: Plan) -> None:
    """Raise UnavailableError where the package pyarrow is missing or broken."""
    _arrow()


def export(source: CloudReader, out: Path) -> Exported:
    """Write a shard for each file's clouds, and the card."""
    (out / "data").mkdir()
    files = dict[str, list[str]]()
    for split in source.order:
        files[split] = []
        for number, numbers in source.files(split):
            files[split].append(f"data/{split}-{number:06d}.parquet")
            _write_shard(out / files[split][-1], source.take(numbers), source.plan)
    (out / "README.md").write_text(_card(source.plan, source.n_clouds), encoding="utf-8")
    return Exported(files, source.n_clouds)


def _arrow() -> Any:
    with importing("pyarrow", "format huggingface"):
        import pyarrow.parquet
    return pyarrow


def _write_shard(path: Path, records: Records, plan: Plan) -> None:
    arrow = _arrow()
    columns = {"mesh": arrow.array([plan.meshes[int(i)].key for i in records["mesh_id"]])}
    arrays = to_arrays(records, plan.config)
    offsets = arrays.pop(OFFSETS, None)
    for name, values in arrays.items():
        column = _column(arrow, values[:, 0] if name == "label" else values)
        if offsets is not None and name in point_fields(plan.config):
            column = arrow.ListArray.from_arrays(arrow.array(offsets, arrow.int32()), column)
        columns["points" if name == "data" else name] = column
    table = arrow.table(columns)
    # to an open file: Arrow takes no names that are no text
    atomic.write(
        path, lambda file: arrow.parquet.write_table(table, file, row_group_size=_ROWS_PER_GROUP), synced=False
    )


def _column(arrow: Any, values: NDArray[Any]) -> Any:
    """Nest an array (n, a, b) into lists of known lengths."""
    column = arrow.array(np.ascontiguousarray(values).reshape(-1))
    for length in reversed(values.shape[1:]):
        column = arrow.FixedSizeListArray.from_arrays(column, length)
    return column


def _card(plan: Plan, splits: Iterable[str]) -> str:
    config = plan.config
    kind = record_type(config)
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
            dtype, row = point_fields(config)[name]
            lines += ["    list:", *_listed(np.dtype(dtype).name, row, "      ")]
            continue
        lines += _listed(kind[name].base.name, kind[name].shape, "    ")
    how = "whole surfaces" if config.complete else f"what {len(plan.views)} views ({config.views}) see of each"
    size = f"{config.sample_size:,} points" if config.sample_size else "all visible points"
    lines += [
        "---",
        "",
        f"# Occluded point clouds of {len(plan.meshes):,} meshes, {len(plan.classes):,} classes",
        "",
        f"Made by zbuf_occlude: {how}, {size} per cloud, hidden surfaces removed by",
        f"`{config.method}`. `manifest.json` has all options, versions, checksums and the measured error.",
        "",
        "`points` are (p - `centre`) * `factor` of the visible points p; `pose` is the view matrix (world to eye",
        "space, the camera looks along -z); `view` is azimuth and elevation in radians and the distance.",
        "",
    ]
    return "\n".join(lines)


def _listed(dtype: str, lengths: tuple[int, ...], indent: str) -> list[str]:
    """Return the type of a column of nested lists; its reader wants the lists before their lengths."""
    if not lengths:
        return [f"{indent}dtype: {dtype}"]
    inner = [f"{indent}list: {dtype}"]
    if len(lengths) > 1:
        inner = [f"{indent}list:", *_listed(dtype, lengths[1:], indent + "  ")]
    return [*inner, f"{indent}length: {lengths[0]}"]


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "''") + "'"
