"""Cameras inside the bounding box of the object give answers and one warning: commands, manifest, Python."""

import json
import warnings
from pathlib import Path

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.cli.conftest import Run, write_off
from tests.scenes import box

SIDE = 36.0
"""Side of a cube with a corner at the origin that contains eyes of `paper100`, 4 units from the origin."""


@pytest.fixture
def cube(tmp_path: Path) -> Path:
    mesh = box((SIDE,) * 3)
    return write_off(tmp_path / "cube.off", mesh.vertices + SIDE / 2, mesh.faces)


def warned(text: str) -> int:
    return sum("warning: " in line and "inside" in line for line in text.splitlines())


@pytest.mark.parametrize(("distance", "expected"), [(0.1, 1), (2, 0)])
def test_visible(run: Run, cube: Path, distance: float, expected: int) -> None:
    outcome = run(f"visible {cube} --azimuth 30 --elevation 20 --distance {distance} --method exact --out a.ply")
    assert warned(outcome.err) == expected


@pytest.mark.parametrize(("distance", "expected"), [("0.3", 2), ("2", 0)])
def test_generate(run: Run, cube: Path, tmp_path: Path, distance: str, expected: int) -> None:
    """Two of four views are inside; they count once, not once per variation."""
    table = "azimuth,elevation,distance\n" + f"0,0,{distance}\n90,0,{distance}\n0,0,2\n90,80,2\n"
    (tmp_path / "views.csv").write_text(table)
    sampled = "--variations 2 --points 500 --sample-size 64 --method exact --workers 1"
    outcome = run(f"generate {cube} --views views.csv {sampled} --out out")
    assert warned(outcome.out + outcome.err) == (expected > 0)
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["counts"]["views_inside_the_bounding_box"] == expected


def test_scans(run: Run, cube: Path, tmp_path: Path) -> None:
    """An eye beside a corner, farther than half the side from the centre, is inside the box."""
    scanned = "--sensor vlp-16 --range 0.6 --size 1 --views grid:1x8@0..0 --sample-size 64 --method exact --workers 1"
    outcome = run(f"generate {cube} {scanned} --out out")
    assert warned(outcome.out + outcome.err) == 1
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["counts"]["views_inside_the_bounding_box"] == 4


def test_compare(run: Run, cube: Path) -> None:
    quick = "--views ring:2@0 --points 200 --method exact --method oracle --judge-points 20 --seconds 0.2"
    outcome = run(f"compare {cube} {quick} --distance 0.1 --out near")
    assert warned(outcome.out + outcome.err) == 1
    assert "UserWarning" not in outcome.err


def test_python(cube: Path) -> None:
    mesh = zo.load_mesh(cube)
    points, views = zo.sample_surface(mesh, n_points=100), zo.views.paper100()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")  # as Python begins
        for _ in range(3):
            with zo.prepare(mesh, "exact") as occluder:
                assert occluder.visible(points, views.eyes).shape == (100, 100)
    assert len(caught) == 1
    assert "inside the mesh's bounding box" in str(caught[0].message)
    assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with zo.prepare(mesh, "exact") as occluder:
            occluder.visible(points, views.around(mesh.centre, mesh.longest_side).eyes)


def test_a_target_seen_from_inside_its_scene(cube: Path) -> None:
    """An eye inside the box of a scene, outside that of the object, gives no warning."""
    mesh = zo.load_mesh(cube)
    small = mesh.normalized()
    scene = zo.Scene.joined([zo.scenes.Placed(small), zo.scenes.Placed(mesh, pose=zo.scenes.moved(to=(-18, -18, -18)))])
    points = zo.sample_surface(small, n_points=100)
    with warnings.catch_warnings(), zo.prepare(scene.mesh, "exact") as occluder:
        warnings.simplefilter("error")
        mask = occluder.visible(points, np.array([[3.0, 0.0, 0.0]]))
    assert 0 < mask.sum() < 100
