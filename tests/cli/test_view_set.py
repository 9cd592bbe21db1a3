"""`views` and `visible --union`: a ball's closed form, files that are read again, and options that need each other."""

import re
from pathlib import Path

import numpy as np
import pytest
from trimesh.creation import icosphere

from tests.cli.conftest import Run, write_off

ALONE = (1 - 1 / 8) / 2
"""Of a ball's surface an eye sees this share from eight radii away, the default distance."""


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    mesh = icosphere(subdivisions=4)
    return write_off(tmp_path / "ball.off", mesh.vertices, mesh.faces)


def test_coverage_of_a_ball(run: Run, ball: Path, tmp_path: Path) -> None:
    (tmp_path / "rig.csv").write_text("azimuth,elevation\n0,0\n180,0\n0,0\n")
    outcome = run("views", ball, "--views", "rig.csv", "--coverage")
    assert outcome.code == 0, outcome.err
    rows = np.array([line.split() for line in outcome.out.splitlines()[1:4]], dtype=float)
    assert rows[:, 1].tolist() == [0, 180, 0]
    assert rows[:, 4] == pytest.approx([ALONE] * 3, abs=0.015)
    assert rows[:, 5] == pytest.approx([ALONE, 2 * ALONE, 2 * ALONE], abs=0.015)
    assert f"{rows[-1, 5]:.1%}" in outcome.out.splitlines()[-1]
    outcome = run("views", ball, "--views", "paper100", "--coverage", "--out", "coverage.png")
    assert outcome.code == 0, outcome.err
    assert (tmp_path / "coverage.png").read_bytes().startswith(b"\x89PNG")


def test_a_list_of_views_is_read_again(run: Run, ball: Path, tmp_path: Path) -> None:
    assert run("views", ball, "--views", "random:5", "--distance", "2..3", "--seed", 4, "--out", "a.csv").code == 0
    assert run("views", ball, "--views", "a.csv", "--out", "b.csv").code == 0
    a, b = (np.loadtxt(tmp_path / name, delimiter=",", skiprows=1) for name in ("a.csv", "b.csv"))
    assert np.allclose(a, b)
    assert len(a) == 5
    assert ((a[:, 2] >= 2) & (a[:, 2] <= 3)).all()
    outcome = run("views", ball, "--views", "random-so3:3", "--out", "c.csv")
    assert outcome.code == 2
    assert "upright" in outcome.err, "a roll would be lost"


def test_what_any_of_a_files_cameras_sees(run: Run, ball: Path, tmp_path: Path) -> None:
    (tmp_path / "rig.csv").write_text("azimuth,elevation\n0,0\n180,0\n")
    given = ("visible", ball, "--cameras", "rig.csv", "--method", "exact", "--out", "c.csv", "--with", "normals")

    def points(*more: object) -> np.ndarray:
        outcome = run(*given, *more)
        assert outcome.code == 0, outcome.err
        found: np.ndarray = np.loadtxt(tmp_path / "c.csv", delimiter=",", skiprows=1)
        assert int(re.findall(r"\d+", outcome.out)[0]) == len(found)
        return found

    first, second, both = points("--index", 0), points("--index", 1), points("--union")
    assert len(both) == len(first) + len(second)
    assert (np.einsum("na,na->n", both[:, :3], both[:, 3:]) > 0).all(), "normals look outwards, to an eye that sees"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("views", "BALL", "--out", "a.png"), "--coverage"),
        (("views", "BALL", "--out", "a.txt", "--coverage"), ".csv"),
        (("views", "BALL", "--views", "rng:3@2"), "Did you mean 'ring'?"),
        (("views", "BALL", "--distance", "3..2"), "3..2"),
        (("visible", "BALL", "--union", "--out", "a.ply"), "--union must go with --cameras"),
        (("visible", "BALL", "--cameras", "rig.csv", "--union", "--index", 1, "--out", "a.ply"), "Leave one out"),
    ],
)
def test_options_that_need_each_other(
    run: Run, ball: Path, tmp_path: Path, arguments: tuple[object, ...], words: str
) -> None:
    (tmp_path / "rig.csv").write_text("azimuth,elevation\n0,0\n180,0\n")
    outcome = run(*(ball if word == "BALL" else word for word in arguments))
    assert outcome.code == 2
    assert words in outcome.err
    assert len(outcome.err.strip().splitlines()) == 1
