"""`shapes`: the list, and a shape as a file that loads as the same surface; road users as a dataset."""

import json
from pathlib import Path

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.cli.conftest import Run
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.shapes import formulas, traffic
from zbuf_occlude.meshes.shapes.built_in import BUILT_IN


def test_all_are_listed(run: Run) -> None:
    out = run("shapes").out
    assert all(label in out for label in (*shapes.CLASSES, *traffic.CLASSES, *formulas.FORMULAS))
    assert all(f"--shapes {row.name}" in out for row in BUILT_IN)


@pytest.mark.parametrize("ending", ["off", "obj", "ply", "stl", "glb"])
@pytest.mark.parametrize("up", ["", "--up y", "--up z"])
def test_a_shape_loads_as_itself(run: Run, tmp_path: Path, ending: str, up: str) -> None:
    """The size is that of the class and the mesh stands on z = 0 for any up axis of the file."""
    said = run(f"shapes truck --number 3 {up} --out t.{ending}").out
    found = zo.load_mesh(tmp_path / f"t.{ending}", up=up[-1:] or None)
    np.testing.assert_allclose(found.bounds, traffic.make("truck", 3).bounds, atol=1e-5)
    assert f"{up[-1:] or ('y' if ending == 'glb' else 'z')} up" in said


def test_members_of_the_families_are_metres(run: Run, tmp_path: Path) -> None:
    assert "0.95 m" in run("shapes chair --out chair.off").out
    run("shapes chair --number 5 --seed 1 --out other.off")
    first, other = zo.load_mesh(tmp_path / "chair.off"), zo.load_mesh(tmp_path / "other.off")
    assert (first.longest_side, other.longest_side) == (pytest.approx(0.95), pytest.approx(0.95))
    np.testing.assert_allclose(other.normalized().vertices, shapes.make("chair", 5, 1).normalized().vertices, atol=1e-9)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("chiar", "Did you mean 'chair'"),
        ("torus --number 1", "a formula has one surface"),
        ("chair --out chair.xyz", "--out must end in .off"),
        ("chair --number -1", "--number"),
    ],
)
def test_what_there_is_not_is_one_line(run: Run, tmp_path: Path, line: str, says: str) -> None:
    run(f"shapes {line}", code=2, says=says)
    assert not list(tmp_path.glob("chair*"))


def test_road_users_as_a_dataset_of_scans_in_metres(run: Run, tmp_path: Path) -> None:
    line = "generate --shapes road-users --limit 6 --views ring:1@0 --sensor hdl-64e --set-sensor noise=0 --range 15"
    run(f"{line} --scale mesh --frame camera --sample-size 64 --workers 1 --out roads")
    manifest = json.loads((tmp_path / "roads" / "manifest.json").read_text())
    assert sorted(manifest["classes"]) == sorted(traffic.CLASSES)
    assert manifest["options"]["scan"]["size"] == "file"
    assert "scanned again: the same" in run("verify roads --workers 1").out
