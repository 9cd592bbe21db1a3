"""The commands that read datasets, on damaged ones: one line that says which file, and what to do."""

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Run
from zbuf_occlude.dataset.formats import FORMATS

SMALL = ("--method", "oracle", "--views", "ring:2@30", "--points", 100, "--sample-size", 8, "--workers", 1)
SUFFIXES = (".h5", ".zip", ".tar", ".npz", ".ply")


def commands(dataset: Path, other: Path) -> list[tuple[object, ...]]:
    reading = [("verify", dataset), ("show", dataset), ("convert", dataset, "--format", "npz", "--out", other)]
    return [*reading, ("show", dataset, "--table2"), ("status", dataset), ("merge", dataset)]


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
        for command in commands(dataset, tmp_path / "other")[:-1]:  # merge has nothing to do
            outcome = run(*command)
            assert outcome.code == 1, command
            assert outcome.err.startswith(
                f"error: {dataset / 'plan.json'} must be as it was written; it cannot be read"
            )


@pytest.mark.parametrize("format", [row.name for row in FORMATS])
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


def test_a_shard_that_was_cut(run: Run, modelnet: Path, tmp_path: Path) -> None:
    dataset = tmp_path / "clouds"
    common = ("generate", modelnet, "--out", dataset, *SMALL)
    assert run(*common, "--shard", "0/2").code == 0
    shard = dataset / "shards" / "000000.npy"
    shard.write_bytes(shard.read_bytes()[:-600])
    outcome = run("merge", dataset)
    assert outcome.code == 1
    assert f"error: {shard} must be as it was written; " in outcome.err
    assert outcome.err.endswith(" Delete it and 000000.json; the same command makes them again.\n")
    sidecar = shard.with_suffix(".json")
    sidecar.write_text("{}")
    for command in (("merge", dataset), ("status", dataset)):
        outcome = run(*command)
        assert (outcome.code, f"error: {sidecar} must be as it was written" in outcome.err) == (1, True)
    shard.unlink()
    sidecar.unlink()
    assert run(*common).code == 0, "what it says helps"
