"""Classes whose names are paths: files lie in the dataset's folder, and are known for the dataset's."""

import csv
from pathlib import Path

import pytest
from trimesh.creation import box

from tests.cli.conftest import Run, write_off

CLASSES = ("..", ".", "../../..", "/etc", "a/b", "~", "...", "-x", "CON", "a\\b")
FORMATS = {
    "ply": "--sample-size 16",
    "webdataset": "--sample-size 16",
    "completion3d": "",
}


@pytest.mark.parametrize("layout", FORMATS)
def test_classes_that_are_paths(run: Run, tmp_path: Path, layout: str) -> None:
    inside = tmp_path / "above" / "further" / "above"
    out, labels = inside / "out", tmp_path / "labels.csv"
    brick = box((1, 2, 3))
    with labels.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["key", "class"])
        for number, label in enumerate(CLASSES):
            write_off(tmp_path / "meshes" / f"m{number}.off", brick.vertices, brick.faces)
            rows.writerow([f"m{number}", label])
    command = ["generate", tmp_path / "meshes", "--labels", labels, "--method", "exact", "--views", "ring:1@20"]
    command += ["--points", "2048", "--format", layout, *FORMATS[layout].split(), "--workers", "1", "--out", out]
    outcome = run(*command)
    assert outcome.code == 0, outcome.err
    assert list(inside.iterdir()) == [out]
    assert run("verify", out).code == 0
    if layout == "ply":
        files = list(out.rglob("*.ply"))
        assert len(files) == len(CLASSES)
        assert {path.parents[1] for path in files} == {out / "ply" / "train"}
    again = run(*command, "--seed", "1", "--overwrite")
    assert again.code == 0, again.err
    assert list(inside.iterdir()) == [out]
