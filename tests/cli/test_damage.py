"""The commands that read datasets, on damaged ones: one line that says which file, and what to do."""

import json
import re
from pathlib import Path

import pytest

from tests.cli.conftest import Run

SMALL = ("--method", "oracle", "--views", "ring:2@30", "--points", 100, "--sample-size", 8, "--workers", 1)
SUFFIXES = (".h5", ".zip", ".tar", ".npz")


def commands(dataset: Path, other: Path) -> list[tuple[object, ...]]:
    reading = [("verify", dataset), ("show", dataset), ("convert", dataset, "--format", "npz", "--out", other)]
    return [*reading, ("paper", "table2", dataset), ("status", dataset), ("merge", dataset)]


def test_a_manifest_that_is_none(run: Run, modelnet: Path, tmp_path: Path) -> None:
    dataset = tmp_path / "clouds"
    assert run("generate", modelnet, "--out", dataset, *SMALL).code == 0
    good = json.loads((dataset / "manifest.json").read_text())
    del good["counts"]["clouds_by_split"]
    for text in ("{}", "[]", "no JSON", "", json.dumps(good)):
        (dataset / "manifest.json").write_text(text)
        for command in commands(dataset, tmp_path / "other"):
            outcome = run(*command)
            assert outcome.code == 1, command
            assert outcome.err.startswith(f"error: {dataset / 'manifest.json'} must be as it was written; it cannot")
            assert outcome.err.endswith(
                ". Copy it again from where it was made, or make the dataset again, with --overwrite.\n"
            )
    assert not (tmp_path / "other").exists()


def test_a_plan_that_is_none(run: Run, modelnet: Path, tmp_path: Path) -> None:
    dataset = tmp_path / "clouds"
    assert run("generate", modelnet, "--out", dataset, *SMALL).code == 0
    good = json.loads((dataset / "plan.json").read_text())
    del good["fingerprint"]
    for text in ("{}", "[]", "no JSON", json.dumps(good)):
        (dataset / "plan.json").write_text(text)
        outcome = run("generate", modelnet, "--out", dataset, *SMALL, "--overwrite")
        assert (outcome.code, "Copy it again from where it was made; or delete" in outcome.err) == (1, True)
        for command in commands(dataset, tmp_path / "other")[:-1]:  # merge has nothing to do
            outcome = run(*command)
            assert outcome.code == 1, command
            assert outcome.err.startswith(
                f"error: {dataset / 'plan.json'} must be as it was written; it cannot be read"
            )


@pytest.mark.parametrize("format", ["hdf5", "packed", "webdataset", "npz"])
def test_data_that_was_cut(run: Run, modelnet: Path, tmp_path: Path, format: str) -> None:
    dataset = tmp_path / "clouds"
    assert run("generate", modelnet, "--out", dataset, *SMALL, "--format", format).code == 0
    path = next(path for path in sorted(dataset.rglob("*")) if path.suffix in SUFFIXES)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    for command in commands(dataset, tmp_path / "other")[:3]:
        outcome = run(*command)
        assert outcome.code == 1, command
        last = outcome.err.splitlines()[-1]
        assert ("checksum" if command[0] == "verify" else f"{path} must be as it was written; ") in last
        assert "Traceback" not in outcome.err


@pytest.mark.parametrize("damage", ["cut", "missing", "record"])
@pytest.mark.parametrize("format", ["hdf5", "packed"])
def test_a_damaged_group_is_reported_and_made_again(
    run: Run, modelnet: Path, tmp_path: Path, format: str, damage: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zbuf_occlude.dataset.plan.CLOUDS_PER_GROUP", 8)  # four meshes a group
    dataset, common = tmp_path / "clouds", ("generate", modelnet, *SMALL, "--format", format)
    assert run(*common, "--out", tmp_path / "whole").code == 0
    assert run(*common, "--out", dataset, "--shard", "0/2").code == 0
    record = dataset / "groups" / "000000.json"
    file = dataset / json.loads(record.read_text())["names"][0]
    if damage == "cut":
        file.write_bytes(file.read_bytes()[:-600])
    elif damage == "missing":
        file.unlink()
    else:
        record.write_text(re.sub(r'"n_checked": \d', '"n_checked": 0', record.read_text(), count=1))
    name = record.name if damage == "record" else file.name
    status = run("status", dataset)
    assert status.code == 0
    assert re.search(f"again +group 0: {name}", status.out), status.out
    assert run(*common, "--out", dataset, "--shard", "1/2").code == 0
    merged = run("merge", dataset)
    assert (merged.code, f"group 0 is not done: {name}" in merged.err) == (1, True), merged.err
    again = run(*common, "--out", dataset)
    assert (again.code, f"group 0 is made again: {name}" in again.err) == (0, True), again.err
    for path in (tmp_path / "whole").glob("*[0-9].[hz]*"):
        assert (dataset / path.name).read_bytes() == path.read_bytes()
