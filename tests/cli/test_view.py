"""The command `view`: a page on loopback, Ctrl-C, and what it refuses."""

import re
import signal
import subprocess
import sys
from pathlib import Path
from unittest.mock import patch
from urllib.request import urlopen

import numpy as np
import pytest

from tests.cli.conftest import Run, write_off
from tests.scenes import box
from zbuf_occlude.base.point_files import read_pcd_positions

CUBE = box((1.0, 1.0, 1.0))


@pytest.fixture
def cube(tmp_path: Path) -> Path:
    write_off(tmp_path / "cube.off", CUBE.vertices, CUBE.faces)
    return tmp_path / "cube.off"


def start(*arguments: object, folder: Path) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "zbuf_occlude", "view", *map(str, arguments), "--port", "0"]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.needs("viser")
def test_the_page_is_on_loopback_and_ctrl_c_ends_it_with_one_line(cube: Path, tmp_path: Path) -> None:
    process = start(cube, "--size", 2, "--sensor", "vlp-16", folder=tmp_path)
    assert process.stdout is not None
    try:
        lines = [process.stdout.readline() for _ in range(3)]
        assert lines[0] == "12 faces\n"
        assert "2 m long" in lines[1]
        address = re.match(r"(http://127\.0\.0\.1:\d+) ", lines[2])
        assert address is not None, lines
        with urlopen(address[1], timeout=60) as page:
            assert b"<html" in page.read()
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert out == "viewer ended\n"
    assert "rror" not in err
    assert process.returncode == 0


@pytest.mark.needs("viser")
def test_clouds_of_a_dataset_have_label_view_and_hidden_part(run: Run, tmp_path: Path) -> None:
    """Points and hidden ones lie on the cube; the camera is where its view says; the file is what is stored."""
    from zbuf_occlude.cli.view import stored_cloud
    from zbuf_occlude.datasets.source import open_dataset

    write_off(tmp_path / "meshes" / "dice" / "a.off", CUBE.vertices, CUBE.faces)
    options = "--views ring:4@30 --method exact --points 800 --sample-size 100 --workers 1 --format packed"
    run(f"generate meshes {options} --out out")
    source = open_dataset(tmp_path / "out", to_show=True)
    found = stored_cloud(source, 1)
    assert (found.title, found.facts["split"], found.facts["points"]) == ("dice", "train", "100")
    azimuth, elevation = (float(angle.rstrip("°")) for angle in found.facts["azimuth, elevation"].split(", "))
    assert elevation == 30.0
    assert found.eye is not None
    assert np.degrees(np.arctan2(found.eye[1], found.eye[0])) % 360 == pytest.approx(azimuth % 360, abs=2.0)
    faces = np.concatenate([found.points, found.hidden])
    assert np.allclose(np.abs(faces).max(axis=1), 0.5, atol=0.02)
    assert len(found.hidden) > 100
    found.save(tmp_path / "a.pcd")
    assert np.array_equal(read_pcd_positions(tmp_path / "a.pcd"), source.take(np.array([1]))[0]["data"])


@pytest.mark.needs("viser")
def test_crops_are_viewed_too(tmp_path: Path) -> None:
    from zbuf_occlude.cli.view import stored_cloud
    from zbuf_occlude.datasets.source import open_dataset

    folder = tmp_path / "crops" / "car"
    folder.mkdir(parents=True)
    np.save(folder / "a.npy", np.random.default_rng(0).uniform(-1, 1, (30, 3)))
    (tmp_path / "crops" / "objects.csv").write_text("file,class,range,azimuth,elevation\ncar/a.npy,car,12.5,40,-3\n")
    found = stored_cloud(open_dataset(tmp_path / "crops", to_show=True), 0)
    assert (found.title, found.facts["range"], found.facts["points"]) == ("car", "12.5 m", "30")
    assert found.facts["azimuth, elevation"] == "40.0°, -3.0°"
    assert found.eye is None


@pytest.mark.needs("viser")
def test_what_does_not_apply_is_refused(run: Run, cube: Path) -> None:
    run("view cube.off --size 2 --unit mm", code=2, says="--size is in metres")
    run("view cube.off --set-sensor noise=0", code=2, says="--set-sensor must go with --sensor")
    run("view cube.off --sensor vlp-17", code=2, says="vlp-16")
    run("view cube.off --host 192.0.2.1", code=2, says="--host must be an address of this machine")
    run("view cube.off --out a.txt", code=2, says="--out must end in .ply, .pcd, .csv")
    run("view nothing.off", code=2, says="nothing.off")
    cube.with_name("folder").mkdir()
    run("view folder", code=1, says="must hold a dataset")
    run("view folder --size 2", code=2, says="--size is for a mesh")


def test_without_viser_the_extra_is_named(run: Run, cube: Path) -> None:
    with (
        patch.dict(sys.modules, {"viser": None, "zbuf_occlude.drawing.viewer": None}),
        patch("zbuf_occlude.base.extras.find_spec", return_value=None),
    ):
        run("view cube.off", code=1, says="pip install 'zbuf-occlude[view]'")
