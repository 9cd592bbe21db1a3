"""What every format and export holds: the same as ever (exports.json), wherever clouds lie in their files.

`python -m tests.net.test_exports > tests/net/exports.json` writes the digests. A digest is of rows of files, sorted;
numbers in names that count clouds or files are left out.
"""

import hashlib
import json
import re
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from tests.datasets.test_export import config_for
from tests.datasets.test_generate import broken, tetrahedron
from tests.net.digests import STEP
from zbuf_occlude import MeshCollection
from zbuf_occlude.datasets.formats import FORMATS, Format
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import Plan
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.meshes.collection import MeshEntry

STORED = Path(__file__).with_name("exports.json")
OF_THE_RUN = re.compile(r"(manifest\.json|plan\.json|contact_sheet\.png|(groups|shards)/.*|README\.md|.*_files\.txt)$")
NEEDS = {"voxels": "open3d", "huggingface": "pyarrow", "mcap": "mcap_ros2"}


def plan_of(row: Format) -> Plan:
    n_points = 16_384 if row.keeps_points and row.exported_from else 8_192 if row.complete else 64
    loads = [broken if i == 4 else partial(tetrahedron, i) for i in range(6)]
    entries = [
        MeshEntry(f"m{i}", ("bed", "table")[i % 2], "test" if i % 3 == 0 else "train", load)
        for i, load in enumerate(loads)
    ]
    return Plan(MeshCollection(entries), config_for(row, n_points, 32), row.name)


def plain(value: Any) -> bytes:
    """Return a value as bytes that are the same on all processors."""
    values = np.asarray(value)
    if values.dtype.names:
        return b"".join(name.encode() + plain(values[name]) for name in values.dtype.names)
    if values.dtype.hasobject:
        return repr(values.tolist()).encode()
    if values.dtype.kind == "f" and values.dtype.itemsize == 8:
        values = np.rint(values / STEP).astype(np.int64)
    return f"{values.dtype} {values.shape}".encode() + np.ascontiguousarray(values).tobytes()


def numbers_rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: numbers_rounded(each) for name, each in value.items()}
    if isinstance(value, list):
        return [numbers_rounded(each) for each in value]
    return round(value, 6) + 0.0 if isinstance(value, float) else value


def rows(path: Path) -> Iterator[bytes]:
    """Yield what a file holds, piece by piece."""
    if path.suffix == ".npy":
        yield from map(plain, np.load(path))
    elif path.suffix == ".npz":
        with np.load(path) as file:
            yield from (name.encode() + plain(values) for name, values in file.items())
    elif path.suffix == ".h5":
        with h5py.File(path) as file:
            for name, values in file.items():
                if isinstance(values, h5py.Dataset):
                    yield from (name.encode() + plain(row) for row in np.atleast_1d(values[()]))
    elif path.suffix == ".parquet":
        import pyarrow.parquet

        yield from (repr(numbers_rounded(row)).encode() for row in pyarrow.parquet.read_table(path).to_pylist())
    elif path.suffix == ".mcap":
        from mcap.reader import make_reader

        with path.open("rb") as file:
            yield from (
                channel.topic.encode() + message.data for _, channel, message in make_reader(file).iter_messages()
            )
    elif path.suffix == ".json":
        yield json.dumps(numbers_rounded(json.loads(path.read_text())), sort_keys=True).encode()
    elif path.suffix in (".txt", ".list", ".csv", ".xyz"):
        yield from path.read_bytes().splitlines()
    else:
        yield re.sub(rb"comment .*\n", b"", path.read_bytes(), count=1)  # of PLY: float64 to the last digit


def digest(row: Format, out: Path) -> str:
    """Return the number of pieces of a dataset, and their digest."""
    generate(plan_of(row), out)
    found = list[tuple[str, bytes]]()
    if row.exported_from:
        for path in out.rglob("*"):
            name = path.relative_to(out).as_posix()
            if path.is_file() and not OF_THE_RUN.match(name):
                kind = re.sub(r"\d", "", name) if row.name in ("kitti", "huggingface") else name
                found += [(kind, hashlib.sha256(piece).digest()) for piece in rows(path)]
    else:
        source = open_dataset(out)
        for split in source.order:
            found += [(split, plain(record)) for records in source.batches(split) for record in records]
    whole = hashlib.sha256()
    for name, piece in sorted(found):
        whole.update(name.encode() + hashlib.sha256(piece).digest())
    return f"{len(found)} {whole.hexdigest()[:16]}"


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize(
    "row",
    [pytest.param(row, marks=[pytest.mark.needs(NEEDS[row.name])] if row.name in NEEDS else []) for row in FORMATS],
    ids=lambda row: row.name,
)
def test_what_a_format_holds_is_what_it_ever_held(row: Format, tmp_path: Path) -> None:
    assert digest(row, tmp_path / "out") == json.loads(STORED.read_text())[row.name]


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps({row.name: digest(row, Path(folder, row.name)) for row in FORMATS}, indent=1))  # noqa: T201
        sys.stderr.write("done\n")
