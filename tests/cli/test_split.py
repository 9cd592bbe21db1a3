"""`generate --split`: splits by shares, stated in the plan and the manifest, the same whatever is added."""

import json
from pathlib import Path

from tests.cli.conftest import Run, write_off
from tests.scenes import box


def split_of(folder: Path) -> dict[str, str]:
    return {key: split for key, _, split, *_ in json.loads((folder / "plan.json").read_text())["meshes"]}


def test_splits_are_stated_and_stay(run: Run, tmp_path: Path) -> None:
    for i in range(24):
        write_off(tmp_path / "meshes" / "chair" / f"{i:02d}.off", box().vertices, box().faces)
    small = "--method oracle --views ring:1@20 --points 60 --sample-size 20 --workers 1 --split 0.5,0.25,0.25"
    outcome = run(f"generate meshes {small} --out one")
    assert "seed 0: train 0.5, val 0.25, test 0.25" in outcome.err
    first, manifest = split_of(tmp_path / "one"), json.loads((tmp_path / "one" / "manifest.json").read_text())
    assert set(first.values()) == {"train", "val", "test"}
    assert manifest["options"]["split"] == [0.5, 0.25, 0.25]
    assert manifest["counts"]["clouds_by_split"] == {s: list(first.values()).count(s) for s in ("train", "val", "test")}
    for i in range(24, 30):
        write_off(tmp_path / "meshes" / "chair" / f"{i:02d}.off", box().vertices, box().faces)
    run(f"generate meshes {small} --out two")
    second = split_of(tmp_path / "two")
    assert len(second) == 30
    assert first.items() <= second.items()
    few = run(f"generate meshes {small} --limit 20 --out few --dry-run").err
    (row,) = (line.split() for line in few.splitlines() if line.startswith("chair"))
    assert sum(map(int, row[1:])) == 20
    assert int(row[1]) >= 7, "the first ones are not as many of each split"
    run(f"generate meshes {small} --splits test --out three")
    assert set(split_of(tmp_path / "three").values()) == {"test"}
    rare = "generate meshes --split 0.999998,0.000001,0.000001 --dry-run --out rare --views ring:1@20"
    assert "30 meshes: no mesh is in val or test" in run(rare).err
    assert "no mesh is in" not in few
    assert "sum 1" in run("generate meshes --split 0.5,0.2 --out four", code=2).err
    assert "0.8,0.1,0.1" in run("generate meshes --split most --out five", code=2).err
