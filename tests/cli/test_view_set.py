"""`views` and `visible --union`: a ball's closed form, files that are read again."""

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
    outcome = run(f"views {ball} --views rig.csv --coverage")
    rows = np.array([line.split() for line in outcome.out.splitlines()[1:4]], dtype=float)
    assert rows[:, 1].tolist() == [0, 180, 0]
    assert rows[:, 4] == pytest.approx([ALONE] * 3, abs=0.015)
    assert rows[:, 5] == pytest.approx([ALONE, 2 * ALONE, 2 * ALONE], abs=0.015)
    assert f"{rows[-1, 5]:.1%}" in outcome.out.splitlines()[-1]
    run(f"views {ball} --views paper100 --coverage --out coverage.png")
    assert (tmp_path / "coverage.png").read_bytes().startswith(b"\x89PNG")


def test_a_list_of_views_is_read_again(run: Run, ball: Path, tmp_path: Path) -> None:
    run(f"views {ball} --views random:5 --distance 2..3 --seed 4 --out a.csv")
    run(f"views {ball} --views a.csv --out b.csv")
    a, b = (np.loadtxt(tmp_path / name, delimiter=",", skiprows=1) for name in ("a.csv", "b.csv"))
    assert np.allclose(a, b)
    assert len(a) == 5
    assert ((a[:, 2] >= 2) & (a[:, 2] <= 3)).all()


def test_what_any_of_a_files_cameras_sees(run: Run, ball: Path, tmp_path: Path) -> None:
    (tmp_path / "rig.csv").write_text("azimuth,elevation\n0,0\n180,0\n")
    line = f"visible {ball} --cameras rig.csv --method exact --out c.csv --with normals"

    def points(option: str) -> np.ndarray:
        outcome = run(f"{line} {option}")
        found: np.ndarray = np.loadtxt(tmp_path / "c.csv", delimiter=",", skiprows=1)
        assert int(re.findall(r"\d+", outcome.out)[0]) == len(found)
        return found

    first, second, both = points("--index 0"), points("--index 1"), points("--union")
    assert len(both) == len(first) + len(second)
    assert (np.einsum("na,na->n", both[:, :3], both[:, 3:]) > 0).all(), "normals look outwards, to an eye that sees"
