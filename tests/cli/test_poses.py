"""Poses at the command line: random views, distances, cameras from files, look-at, field of view."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

import zbuf_occlude as zo
from tests.cli.conftest import Run, write_off
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.sensors import scan
from zbuf_occlude.sensors.poses import pose_of_camera
from zbuf_occlude.views import from_angles

SMALL = "--method oracle --points 400 --sample-size 32 --workers 1"


def records(out: Path) -> np.ndarray:
    source = open_dataset(out)
    return np.concatenate([source.take(numbers) for numbers in source.order.values()])


@pytest.mark.parametrize("spec", ["random-so3:3", "random:3@0..60", "ring:3@20"])
def test_random_views_are_drawn_for_each_object(run: Run, modelnet: Path, tmp_path: Path, spec: str) -> None:
    line = f"generate {modelnet} {SMALL} --views {spec} --distance 2..5"
    run(f"{line} --out a")
    found = records(tmp_path / "a")
    assert len(found) == 8 * 3
    own = [found["view"][found["mesh_id"] == i] for i in range(8)]
    assert len({tuple(view) for views in own for view in views}) == 24, "each object has views of its own"
    if spec.startswith("random:"):
        assert (found["view"][:, 1] >= 0).all()
    run(f"{line} --limit 2 --out b")
    some = records(tmp_path / "b")
    all_keys, some_keys = ((tmp_path / name / "mesh_keys.txt").read_text().split() for name in "ab")
    for record in some:
        mine = found["mesh_id"] == all_keys.index(some_keys[record["mesh_id"]])
        (same,) = found[mine & (found["view_id"] == record["view_id"])]
        assert np.array_equal(same["pose"], record["pose"]), "drawn by the object's key, whatever else is made"


def test_packed_knows_the_views_of_each_object(run: Run, modelnet: Path, tmp_path: Path) -> None:
    line = f"generate {modelnet} {SMALL} --views random-so3:3 --distance 2..5"
    run(f"{line} --out a")
    run(f"{line} --out p --format packed")
    one, two = (np.sort(records(tmp_path / name), order=["mesh_id", "view_id"]) for name in "ap")
    assert np.array_equal(one["pose"], two["pose"])
    assert np.array_equal(one["face_ids"], two["face_ids"])
    run(f"verify p {modelnet}")


@pytest.fixture
def plates(tmp_path: Path) -> Path:
    """Two unit squares side by side in the plane x = 0, facing +x, 4 apart along y."""
    square = np.array([[0, -0.5, -0.5], [0, 0.5, -0.5], [0, 0.5, 0.5], [0, -0.5, 0.5]])
    vertices = np.concatenate([square + np.array([0, y, 0]) for y in (-2, 2)])
    return write_off(tmp_path / "plates.off", vertices, np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]))


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    """A camera at (10, 2, 0) that looks along -x, and sees 1 to either side at distance 10."""
    rotation = np.array([[0, 1, 0], [0, 0, -1], [-1, 0, 0]])  # right is +y, down is -z, forward is -x
    item = {
        "K": [[500, 0, 50], [0, 500, 50], [0, 0, 1]], "width": 100, "height": 100,
        "R": rotation.tolist(), "t": (-rotation @ [10, 2, 0]).tolist(),
    }  # fmt: skip
    (tmp_path / "camera.json").write_text(json.dumps([item]))
    return tmp_path / "camera.json"


def test_generate_from_a_list_of_cameras_keeps_to_their_pictures(
    run: Run, plates: Path, camera: Path, tmp_path: Path
) -> None:
    run(f"generate {plates} {SMALL} --views {camera} --scale mesh --out out")
    with h5py.File(tmp_path / "out" / "ply_data_train0.h5") as h5:
        assert (h5["data"][:, :, 1] > 1.4).all(), "only the plate at y = 2 is in the picture"
        pose = h5["pose"][0]
    assert np.allclose(-pose[:3, :3].T @ pose[:3, 3], [10, 2, 0])


@pytest.mark.parametrize(
    ("options", "plates_seen"),
    [("", 2), ("--look-at 0 2 0 --fov 8", 1), ("--fov 8", 0), ("--cameras camera.json", 1)],
)
@pytest.mark.usefixtures("camera")
def test_visible_sees_what_the_camera_shows(
    run: Run, plates: Path, tmp_path: Path, options: str, plates_seen: int
) -> None:
    run(f"visible {plates} {options} --method oracle --points 500 --out c.npy", code=0 if plates_seen else 1)
    assert (tmp_path / "c.npy").exists() == bool(plates_seen)
    if plates_seen:
        assert len(set(np.sign(np.load(tmp_path / "c.npy")[:, 1]))) == plates_seen


def test_depth_of_a_camera(gl: GlContext, run: Run, plates: Path, camera: Path, tmp_path: Path) -> None:
    run(f"depth {plates} --cameras {camera} --resolution 100 --out d.npy")
    depth = np.load(tmp_path / "d.npy")
    seen = np.isfinite(depth)
    assert np.allclose(depth[seen], 10, rtol=1e-4)
    rows, columns = np.nonzero(seen)
    # a unit square at f / z = 50 pixels
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (25, 74, 25, 74)


def test_depth_of_a_wide_camera_has_its_picture_alone(
    gl: GlContext, run: Run, plates: Path, camera: Path, tmp_path: Path
) -> None:
    document = json.loads(camera.read_text())
    (wide,) = document
    wide["height"] = 20
    wide["K"][1][2] = 10.0
    (tmp_path / "wide.json").write_text(json.dumps([wide]))
    run(f"depth {plates} --cameras wide.json --resolution 100 --out d.npy")
    rows, columns = np.nonzero(np.isfinite(np.load(tmp_path / "d.npy")))
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (40, 59, 25, 74)


def test_a_sensor_is_turned_as_the_camera_is(plates: Path) -> None:
    mesh = zo.load_mesh(plates)

    def shown(sensor: str, roll: float = 0.0, look_at: tuple[float, ...] | None = None) -> np.ndarray:
        view = from_angles(0.0, 0.0, 2.0, roll).around(mesh.centre, mesh.longest_side).looking(look_at, None)
        return scan(mesh, sensor, pose_of_camera(view.poses[0])).positions

    narrow = "pinhole:width=60,height=20,fov=10"
    assert len(shown(narrow)) == 0, "between the plates"
    right = shown(narrow, look_at=(0.0, 2.0, 0.0))
    assert len(right) > 0
    assert (right[:, 1] > 1).all()
    level, upright = (shown("pinhole:width=60,height=6,fov=40", roll) for roll in (0.0, 90.0))
    assert np.ptp(level[:, 1]) > 4 > 1 > len(upright)
