"""Scans in a scene of a JSON file: the share of the target that others hide, beside rays counted by Embree alone."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.cli.conftest import Run, write_off
from tests.scenes import box

embreex = pytest.importorskip("embreex.rtcore_scene", reason="embreex is not installed: zbuf-occlude[embree]")
SIZE, RANGE = 4.0, 12.0


def distances(meshes: list[tuple[np.ndarray, np.ndarray]], eye: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return the distance of the first face along lines from an eye, by Embree, in lengths of the lines."""
    from embreex.mesh_construction import TriangleMesh

    scene = embreex.EmbreeScene()
    corners = np.concatenate([vertices[faces] for vertices, faces in meshes]).astype(np.float32)
    TriangleMesh(scene, corners)
    lines = (ends - eye).astype(np.float32)
    return np.asarray(scene.run(np.tile(eye.astype(np.float32), (len(lines), 1)), lines, query="DISTANCE"))


@pytest.mark.parametrize("keep", ["target", "all"])
@pytest.mark.parametrize("method", ["exact", "embree"])
def test_hidden_is_measured(run: Run, tmp_path: Path, keep: str, method: str) -> None:
    from trimesh import Trimesh
    from trimesh.creation import icosphere
    from trimesh.sample import sample_surface

    target, crate = icosphere(subdivisions=3, radius=SIZE / 2), box((1.5, 2.5, 2.2))
    write_off(tmp_path / "meshes" / "ball.off", target.vertices, target.faces)
    write_off(tmp_path / "crate.off", crate.vertices, crate.faces)
    places = [[5, 0, 0], [5, 2, 0], [-5, -1.5, 0]]
    scene = {"objects": [{"mesh": "crate.off", "position": place, "size": 2.5} for place in places]}
    (tmp_path / "scene.json").write_text(json.dumps(scene))
    scanned = f"--sensor vlp-32c --range {RANGE} --size {SIZE} --views ring:4@0 --scale mesh --workers 1"
    run(f"generate meshes {scanned} --scene scene.json --keep {keep} --method {method} --out out")
    floor = -SIZE / 2
    others = [(crate.vertices + place + [0, 0, floor + 1.1], crate.faces) for place in places]
    points = sample_surface(Trimesh(target.vertices, target.faces), 200_000, seed=1)[0]
    with h5py.File(tmp_path / "out" / "ply_data_train0.h5") as file:
        order = np.argsort(file["view_id"][:])
        hidden, reached, shares = (file[name][:][order] for name in ("hidden", "hidden_reached", "visible_fraction"))
        poses = file["pose"][:][order]
    expected = []
    for pose in poses:
        eye = -pose[:3, :3].T @ pose[:3, 3]
        alone = [(target.vertices, target.faces)]
        shown = distances(alone, eye, points) > 1 - 1e-4
        expected.append((distances([*alone, *others], eye, points[shown]) < 1 - 1e-4).mean())
    assert expected[0] > 0.5, "two crates stand before the first view"
    assert expected[2] > 0.1
    assert expected[1] == expected[3] == 0.0
    assert hidden == pytest.approx(expected, abs=0.015)
    assert shares == pytest.approx(1 - hidden, abs=1e-6)
    assert reached.tolist() == [1] * 4, "no share was asked for, so none was missed"


def test_scan_says_what_is_hidden(run: Run, tmp_path: Path) -> None:
    write_off(tmp_path / "cube.off", box().vertices, box().faces)
    wall = {"objects": [{"mesh": "cube.off", "position": [4, 0, 0], "size": 6}]}
    (tmp_path / "wall.json").write_text(json.dumps(wall))
    outcome = run("scan cube.off --size 1 --range 12 --scene wall.json --azimuth 90 --out scan.ply")
    assert "0% of the object hidden by others" in outcome.out


def test_velocities_of_a_scene_file(run: Run, tmp_path: Path) -> None:
    """A wall behind the target moves away: the positions of its points follow from their times."""
    write_off(tmp_path / "cube.off", box().vertices, box().faces)
    write_off(tmp_path / "wall.off", box((0.02, 1.0, 1.0)).vertices, box().faces)
    wall = {"mesh": "wall.off", "position": [-9, 0, 0], "size": 6, "velocity": [-20, 0, 0]}
    (tmp_path / "scene.json").write_text(json.dumps({"objects": [wall]}))
    line = "scan cube.off --size 1 --range 12 --scene scene.json --keep all --out scan.npz --set-sensor noise=0"
    run(f"{line} --sensor vlp-16")
    with np.load(tmp_path / "scan.npz") as found:
        mine = (found["instances"] == 2) & (np.abs(found["normals"][:, 0]) > 0.9)
        assert mine.sum() > 100
        assert found["points"][mine, 0] == pytest.approx(-8.94 - 20.0 * found["times"][mine], rel=1e-9)
    run(f"{line} --sensor pinhole:width=20,height=10,fov=60", says="stand still")
    (tmp_path / "scene.json").write_text(json.dumps({"objects": [wall | {"velocity": [1, 2]}]}))
    run(f"{line} --sensor vlp-16", code=2, says="velocity")
    for name in ("Truck", "car"):
        (tmp_path / "scene.json").write_text(json.dumps({"objects": [{"class": name, "position": [1, 2, 0]}]}))
        run(f"{line} --sensor vlp-16", code=2, says=f"small letters); got the class '{name}'")


def test_a_depth_camera_keeps_its_places_and_a_lidar_says_which_it_has(run: Run, tmp_path: Path) -> None:
    """Thirty views from 15 to 75 degrees at 0.4 m; a LiDAR has ten positions, and a message says so."""
    cube = box((0.2, 0.2, 0.2))
    write_off(tmp_path / "meshes" / "cube.off", cube.vertices, cube.faces)
    (tmp_path / "scene.json").write_text(json.dumps({"objects": [{"class": "pedestrian", "position": [0, 30, 0]}]}))
    asked = "generate meshes --views grid:3x10@15..75 --scene scene.json --size file --scale mesh --workers 1"
    camera = run(f"{asked} --range 0.4 --sensor azure-kinect-nfov:range_min=0.1,width=64,height=58 --out camera")
    with h5py.File(tmp_path / "camera" / "ply_data_train0.h5") as file:
        views = file["view"][:][np.argsort(file["view_id"][:])]
    assert np.allclose(views[:, 2], 0.4)
    assert np.allclose(np.degrees(views[:, 1]), np.repeat([15.0, 45.0, 75.0], 10))
    assert "elevation" not in camera.err
    lidar = run(f"{asked.replace('--size file', '--size 1')} --range 10 --sensor vlp-32c --out lidar")
    assert "vlp-32c is mounted 1.73 m above the ground: elevations of --views do not count" in lidar.err
    assert "30 views look from 10 sides" in lidar.err
    below = run(f"{asked.replace('15..75', '-60..60')} --range 0.4 --sensor pinhole:width=64,height=64 --out below")
    assert "warning: 10 cameras would be below the ground or table, and stand on it" in below.out
    run(f"{asked} --range 0.4 --sensor pinhole --sensor-height 1.5 --out none", code=2, says="is for a LiDAR")
    run(
        f"{asked} --range 0.4 --sensor pinhole:width=64,height=64 --distance 3 --dry-run --out both",
        says="--distance does not count",
    )
