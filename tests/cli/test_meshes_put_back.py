"""Meshes that are away while `generate` runs, and are put back: `--retry-failed` makes them too."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from trimesh.creation import icosphere

from tests.cli.conftest import Run, write_off

N = 48
OPTIONS = {
    "hdf5": "--points 2048 --views ring:8@20 --sample-size 16",
    "pcn": "--points 16384",  # files of whole objects
    "modelnet40-c": "--points 2048 --views ring:8@20",  # a file holds a split whole
    "packed": "--points 2048 --views ring:8@20",
}


@pytest.mark.parametrize("layout", OPTIONS)
def test_meshes_that_were_put_back_are_made(run: Run, tmp_path: Path, layout: str) -> None:
    meshes, away, out = tmp_path / "meshes", tmp_path / "away", tmp_path / "out"
    for number in range(N):
        ball = icosphere(subdivisions=3, radius=1 + number)
        write_off(meshes / "chair" / "train" / f"chair_{number}.off", ball.vertices, ball.faces)
    line = f"generate {meshes} --method oracle --format {layout} --workers 1 {OPTIONS[layout]} --out {out}"
    command = [sys.executable, "-m", "zbuf_occlude", *line.split()]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL) as process:
        assert process.stderr is not None
        said = b""
        while not re.search(rb" [1-9]\d*/\d+ \[", said):  # clouds on the bar
            piece = process.stderr.read1()
            assert piece, said
            said += piece
        meshes.rename(away)
        said += process.stderr.read()
    assert process.returncode == 3, said
    away.rename(meshes)

    run(f"{line} --retry-failed")
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["failures"] == {}
    assert manifest["counts"]["meshes"] == N
    run(f"verify {out}")
    run(line)
