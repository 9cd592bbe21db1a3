"""First use: Git LFS pointers, unset variables, full disks, missing files."""

import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.cli.conftest import Run
from zbuf_occlude import load_mesh
from zbuf_occlude.base.errors import MeshError

SMALL = "--method oracle --views ring:2@30 --points 100 --sample-size 8 --workers 1"


@contextmanager
def room_for(n_bytes: int) -> Iterator[None]:
    """Limit the size of files, as on a full disk."""
    before, writes = resource.getrlimit(resource.RLIMIT_FSIZE), sys.dont_write_bytecode
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, before[1]))
    sys.dont_write_bytecode = True  # Python keeps what it could write of it, and fails at the next import
    try:
        yield
    finally:
        sys.dont_write_bytecode = writes
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def check_that_nothing_is_left(run: Run, line: str, out: Path) -> None:
    """Run a command with room on the disk (which compiles), then without."""
    run(f"{line} --out {out}")
    assert out.stat().st_size > 500
    out.unlink()
    with room_for(500):
        outcome = run(f"{line} --out {out}", code=1)
    assert outcome.err.startswith("error: ")
    assert len(outcome.err.splitlines()) == 1
    assert [path for path in out.parent.iterdir() if path.is_file()] == []


@pytest.mark.parametrize("suffix", [".glb", ".obj", ".off", ".ply", ".stl"])
@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0f\nsize 123\n", "run `git lfs pull`"),
        (b"\n<!DOCTYPE html>\n<html><body>404</body></html>", "It is a web page: download the file again."),
    ],
)
def test_what_was_fetched_instead_of_a_mesh(tmp_path: Path, suffix: str, content: bytes, said: str) -> None:
    path = tmp_path / f"chair{suffix}"
    path.write_bytes(content)
    with pytest.raises(MeshError) as caught:
        load_mesh(path)
    assert said in str(caught.value)


def test_a_finished_dataset_that_lost_a_file_is_not_called_done(run: Run, modelnet: Path, tmp_path: Path) -> None:
    line, out = f"generate {modelnet} --out out {SMALL}", tmp_path / "out"
    run(line)
    whole = {path.name: path.read_bytes() for path in out.glob("*.h5")}
    (out / "ply_data_test0.h5").unlink()
    assert "faults found. Copy those files from where" in run("verify out", code=1).out
    run(line, says="out/ply_data_test0.h5 is missing or damaged, and is made again")
    assert {path.name: path.read_bytes() for path in out.glob("*.h5")} == whole


EXR = pytest.param("depth.exr", marks=pytest.mark.needs("OpenEXR"))


@pytest.mark.parametrize("name", ["cloud.npy", "cloud.csv", "cloud.ply"])
@pytest.mark.parametrize("command", ["visible MESH --method oracle", "scan MESH --range 3 --size 1"])
def test_a_cloud_that_does_not_fit_leaves_no_file(
    run: Run, modelnet: Path, tmp_path: Path, command: str, name: str
) -> None:
    check_that_nothing_is_left(run, command.replace("MESH", f"{modelnet}/ball/test/ball_0.off"), tmp_path / name)


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize("name", ["depth.npy", "depth.png", EXR])
def test_a_picture_that_does_not_fit_leaves_no_file(run: Run, modelnet: Path, tmp_path: Path, name: str) -> None:
    check_that_nothing_is_left(run, f"depth {modelnet}/ball/test/ball_0.off --resolution 64", tmp_path / name)


@pytest.mark.needs("open3d")
def test_a_report_that_does_not_fit_leaves_no_part_of_a_file(run: Run, modelnet: Path, tmp_path: Path) -> None:
    line = f"{modelnet}/ball/test/ball_0.off"
    run(f"scan {line} --range 8 --size file --out scan.ply")
    report = f"compare-scans {line} scan.ply --out"
    run(f"{report} whole")
    whole = {path.name: path.read_bytes() for path in (tmp_path / "whole").iterdir()}
    for n_bytes in (500, len(whole["scan_0.png"]) - 1):
        with room_for(n_bytes):
            outcome = run(f"{report} part", code=1)
        assert outcome.err.startswith("error: ")
        assert len(outcome.err.splitlines()) == 1
        for path in (tmp_path / "part").iterdir():
            assert path.read_bytes() == whole[path.name]


@pytest.mark.parametrize("shapes", ["classes", "formulas"])
def test_of_built_in_shapes_nobody_is_asked_for_labels(run: Run, shapes: str) -> None:
    outcome = run(f"generate --shapes {shapes} --limit 8 --dry-run")
    assert "one object per class" not in outcome.err
