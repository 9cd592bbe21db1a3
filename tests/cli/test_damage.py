"""The commands that read datasets, on damaged ones: one line that says which file, and what to do."""

import json
import re
from pathlib import Path

import pytest

from tests.cli.conftest import Run

SMALL = "--method oracle --views ring:2@30 --points 100 --sample-size 8 --workers 1"
READING = ("verify clouds", "show clouds", "convert clouds --format npz --out other")
COMMANDS = (*READING, "paper table2 clouds", "status clouds", "merge clouds")
SUFFIXES = (".h5", ".zip", ".tar", ".npz")


@pytest.mark.parametrize(
    ("name", "lacking", "cure"),
    [
        ("manifest.json", "clouds_by_split", ", or make the dataset again, with --overwrite."),
        ("plan.json", "fingerprint", "; or delete the folder yourself, and make the dataset again."),
    ],
)
def test_a_document_that_is_none(run: Run, modelnet: Path, tmp_path: Path, name: str, lacking: str, cure: str) -> None:
    make, path = f"generate {modelnet} --out clouds {SMALL}", tmp_path / "clouds" / name
    run(make)
    without = path.read_text().replace(lacking, "another")
    for text in ("{}", "[]", "no JSON", "", without):
        path.write_text(text)
        if name == "plan.json":
            run(f"{make} --overwrite", code=1, says=cure)
        for command in COMMANDS if name == "manifest.json" else COMMANDS[:-1]:  # merge needs no plan
            error = run(command, code=1).err
            assert error.startswith(f"error: clouds/{name} must be as it was written; it cannot be read")
            assert error.endswith(f". Copy it again from where it was made{cure}\n")
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize("format", ["hdf5", "packed", "webdataset", "npz"])
def test_data_that_was_cut(run: Run, modelnet: Path, tmp_path: Path, format: str) -> None:
    run(f"generate {modelnet} --out clouds {SMALL} --format {format}")
    path = next(path for path in sorted((tmp_path / "clouds").rglob("*")) if path.suffix in SUFFIXES)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    for command in READING:
        last = run(command, code=1).err.splitlines()[-1]
        assert ("checksum" if command == "verify clouds" else f"clouds/{path.name} must be as it was written; ") in last


@pytest.mark.parametrize("damage", ["cut", "missing", "sidecar"])
@pytest.mark.parametrize("format", ["hdf5", "packed"])
def test_a_damaged_shard_is_reported_and_made_again(
    run: Run, modelnet: Path, tmp_path: Path, format: str, damage: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zbuf_occlude.datasets.plan.MIN_PER_SHARD", 8)
    dataset, line = tmp_path / "clouds", f"generate {modelnet} {SMALL} --format {format}"
    run(f"{line} --out whole")
    run(f"{line} --out clouds --shard 0/2")
    sidecar = dataset / "shards" / "000000.json"
    (((name, *_), *_),) = json.loads(sidecar.read_text())["files"].values()
    file = dataset / name
    if damage == "cut":
        file.write_bytes(file.read_bytes()[:-600])
    elif damage == "missing":
        file.unlink()
    else:
        sidecar.write_bytes(sidecar.read_bytes()[:-10])
    name = sidecar.name if damage == "sidecar" else file.name
    status = run("status clouds").out
    assert re.search(f"again +shard 0: {name}", status), status
    run(f"{line} --out clouds --shard 1/2")
    run("merge clouds", code=1, says=f"shard 0 is not done: {name}")
    run(f"{line} --out clouds", says=f"shard 0 is made again: {name}")
    for path in (tmp_path / "whole").glob("*[0-9].[hz]*"):
        assert (dataset / path.name).read_bytes() == path.read_bytes()
