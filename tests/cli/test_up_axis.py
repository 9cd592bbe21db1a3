"""What docs/datasets.md says of the up axis: how clouds are turned back, and where cameras are with `--up z`."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run

LOW, HIGH = np.array([-1.0, -2.0, -3.0]), np.array([1.0, 2.0, 3.0])
"""A box in the axes of its file, whose y is up."""


@pytest.fixture
def tall(tmp_path: Path) -> Path:
    from trimesh.creation import box

    mesh = box(HIGH - LOW)
    lines = [f"v {x} {y} {z}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    path = tmp_path / "tall.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


def sides(positions: np.ndarray) -> set[str]:
    """Which sides of the box some points lie on."""
    assert (np.isclose(positions, LOW) | np.isclose(positions, HIGH)).any(axis=1).all()
    found = {f"+{axis}" for axis, on in zip("xyz", np.isclose(positions, HIGH).T, strict=True) if on.any()}
    return found | {f"-{axis}" for axis, on in zip("xyz", np.isclose(positions, LOW).T, strict=True) if on.any()}


@pytest.mark.parametrize(
    ("azimuth", "elevation", "turned", "untouched"),
    [(90, 0, "-z", "+y"), (270, 0, "+z", "-y"), (0, 90, "+y", "+z"), (0, -90, "-y", "-z"), (0, 0, "+x", "+x")],
)
def test_what_a_camera_sees_in_the_axes_of_the_file(
    run: Run, tall: Path, tmp_path: Path, azimuth: int, elevation: int, turned: str, untouched: str
) -> None:
    out, given = tmp_path / "cloud.npy", ("--azimuth", azimuth, "--elevation", elevation, "--points", 500)
    assert run("visible", tall, *given, "--method", "exact", "--up", "z", "--out", out).code == 0
    assert sides(np.load(out)) == {untouched}
    assert run("visible", tall, *given, "--method", "exact", "--up", "y", "--out", out).code == 0
    x, y, z = np.load(out).T
    assert sides(np.stack([x, z, -y], axis=1)) == {turned}


def test_cameras_in_the_axes_of_the_file_go_with_up_z(run: Run, tall: Path, tmp_path: Path) -> None:
    """One that stands above the object, along the file's y, and looks down."""
    down = {"R": [[1, 0, 0], [0, 0, 1], [0, -1, 0]], "t": [0, 0, 20]}
    (tmp_path / "cameras.json").write_text(json.dumps([down]))
    out, given = tmp_path / "cloud.npy", ("--cameras", tmp_path / "cameras.json", "--points", 500, "--method", "exact")
    outcome = run("visible", tall, *given, "--up", "z", "--out", out)
    assert outcome.code == 0, outcome.err
    assert sides(np.load(out)) == {"+y"}
