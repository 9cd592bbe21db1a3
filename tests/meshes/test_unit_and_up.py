"""Unit and up axis of files, wherever a mesh is taken; and whether meshes seem to lie on their side."""

from pathlib import Path

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import DATA, box, together
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.meshes.conversion import as_mesh
from zbuf_occlude.meshes.stance import Stances, contact, stances, stands_on

SIDES = np.array([0.5, 0.25, 1.0])
"""Metres of a box that stands on z = 0."""
PER_METRE = {"mm": 1000.0, "cm": 100.0, "m": 1.0, "in": 1 / 0.0254}
BOUNDS = [[-0.25, -0.125, 0.0], [0.25, 0.125, 1.0]]


def arrays(up: str, unit: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the box as a file would have it."""
    mesh = box(SIDES)
    x, y, z = ((mesh.vertices - mesh.bounds.mean(axis=0)) + [0.0, 0.0, 0.5]).T
    turned = np.stack([x, y, z] if up == "z" else [x, z, -y], axis=1)
    return turned * PER_METRE[unit], mesh.faces


@pytest.mark.parametrize("unit", PER_METRE)
@pytest.mark.parametrize("up", ["z", "y"])
@pytest.mark.parametrize("ending", ["obj", "stl", "ply", "off", "glb", "arrays"])
def test_a_mesh_is_upright_and_in_metres(tmp_path: Path, ending: str, up: str, unit: str) -> None:
    given = arrays(up, unit)
    place = tmp_path / f"box.{ending}"
    if ending != "arrays":
        zo.Mesh(*given).to_trimesh().export(place)
        np.testing.assert_allclose(zo.load_mesh(place, up=up, unit=unit).bounds, BOUNDS, atol=1e-6)
        (entry,) = MeshCollection.from_paths(place, up=up, unit=unit)
        np.testing.assert_allclose(entry.load().bounds, BOUNDS, atol=1e-6)
        assert (entry.up, entry.unit) == (up, unit)
    mesh = given if ending == "arrays" else place
    np.testing.assert_allclose(as_mesh(mesh, up=up, unit=unit).bounds, BOUNDS, atol=1e-6)
    cloud = zo.occlude(mesh, up=up, unit=unit, eye=(0.0, 0.0, 9.0), n_points=100)
    np.testing.assert_allclose(cloud.points[:, 2], 1.0, atol=1e-6)
    depth = zo.depth_image(mesh, up=up, unit=unit, eye=(0.0, 0.0, 9.0), resolution=9)
    assert depth.min() == pytest.approx(8.0)
    found = zo.scan(mesh, "pinhole:width=9,height=9,fov=9,noise=0", range=4.5, up=up, unit=unit, azimuth=0)
    assert found.ranges.min() == pytest.approx(4.25, abs=1e-6)  # half of x before the middle


def test_what_no_file_can_be_in_is_refused(tmp_path: Path) -> None:
    place = tmp_path / "box.off"
    zo.Mesh(*arrays("z", "m")).to_trimesh().export(place)
    for take in (zo.load_mesh, MeshCollection.from_paths, as_mesh):
        with pytest.raises(zo.OptionError, match="unit must be one of mm, cm, m, in; got 'ft'"):
            take(place, unit="ft")
        with pytest.raises(zo.OptionError, match="up must be one of z, y; got 'x'"):
            take(place, up="x")
    with pytest.raises(zo.ArgumentError, match="give size or unit, not both"):
        zo.scan(place, "vlp-16", range=3, size=1, unit="mm")
    with pytest.raises(zo.ArgumentError, match="up, unit and transparent are for a mesh"):
        zo.scan(zo.Scene.from_mesh(zo.load_mesh(place)), "vlp-16", unit="mm")


def test_a_range_within_a_file_in_millimetres_shows_both_lengths(tmp_path: Path) -> None:
    place = tmp_path / "box.stl"
    zo.Mesh(*arrays("z", "mm")).to_trimesh().export(place)
    with pytest.warns(UserWarning, match=r"range is 3 m, the mesh's longest side 1000 m.*unit="):
        zo.scan(place, "vlp-16", range=3)


TABLE = together(
    box((1.2, 0.8, 0.05)).transformed(1, (0, 0, 0.7)),
    *(box((0.05, 0.05, 0.7)).transformed(1, (x, y, 0.35)) for x in (-0.5, 0.5) for y in (-0.3, 0.3)),
)


def test_a_table_touches_the_ground_with_its_legs() -> None:
    assert contact(TABLE, 2) == pytest.approx(1.05 * 0.65 / (1.2 * 0.8))
    assert contact(TABLE, 1) == pytest.approx(1.2 * 0.05 / (1.2 * np.ptp(TABLE.bounds[:, 2])))  # the top's edge
    assert stands_on(TABLE) == "z"
    assert stands_on(TABLE.rotated([[1, 0, 0], [0, 0, 1], [0, -1, 0]])) == "y"
    assert stands_on(box((1, 1, 1))) == ""  # on both


def turned(label: str, index: int) -> zo.Mesh:
    return shapes.make(label, index).rotated([[1, 0, 0], [0, 0, 1], [0, -1, 0]])


@pytest.mark.parametrize("label", shapes.CLASSES)
def test_no_class_of_built_in_shapes_is_said_to_lie(label: str) -> None:
    assert not stances([e for e in shapes.collection() if e.label == label]).suggest_y_up


def test_built_in_shapes_with_y_up_lie() -> None:
    entries = [
        MeshEntry(f"{label}{i}", label, "train", lambda label=label, i=i: turned(label, i))  # type: ignore[misc]
        for label in ("car", "chair", "table")
        for i in range(4)
    ]
    found = stances(entries)
    assert found.suggest_y_up
    assert found.n == 12


def test_a_few_that_stand_on_y_are_no_most() -> None:
    assert not Stances(12, 0, 2).suggest_y_up
    assert not Stances(12, 3, 5).suggest_y_up
    assert not Stances(0, 0, 0).suggest_y_up


FURNITURE = DATA / "furniture"


@pytest.mark.skipif(not FURNITURE.is_dir(), reason=f"{FURNITURE} is not there; set ZBUF_OCCLUDE_DATA")
def test_real_furniture_with_y_up_lies_and_turned_it_stands() -> None:
    assert stances(MeshCollection.from_paths(FURNITURE)).suggest_y_up
    assert not stances(MeshCollection.from_paths(FURNITURE, up="y")).suggest_y_up
