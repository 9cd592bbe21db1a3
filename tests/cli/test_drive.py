"""`drive`: a SemanticKITTI sequence of a LiDAR of one's own along a trajectory, of a rig, and wrong arguments."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Run
from zbuf_occlude.cli.drive import drive_command

MINE = "kind: spinning\nelevations: {from: -25, to: 5, n: 6}\ncolumns: 90\nrange_max: 60\nsigma: 0.01\n"


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A folder with a LiDAR, a trajectory of half a second, and a scene."""
    (tmp_path / "mine.yaml").write_text(MINE)
    rows = [[0.5 * i, 4.0 * i, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] for i in range(2)]
    np.savetxt(tmp_path / "path.txt", rows)
    np.savetxt(tmp_path / "short.txt", rows[:1])
    objects = [{"class": "truck", "position": [12, 4, 0], "yaw": 90}, {"class": "bus", "position": [-9, -4, 0]}]
    (tmp_path / "town.json").write_text(json.dumps({"objects": objects}))
    return tmp_path


def test_a_lidar_of_ones_own_along_a_trajectory(run: Run, own: Path) -> None:
    said = run("drive --sensor mine.yaml --trajectory path.txt --scene town.json --out kitti").out
    assert "5 sweeps of mine in 0.5 s and 4.0 m: kitti" in said
    folder = own / "kitti/sequences/00"
    assert len(list((folder / "velodyne").glob("*.bin"))) == len(list((folder / "labels").glob("*.label"))) == 5
    poses = np.loadtxt(folder / "poses.txt")
    assert poses[:, 11] == pytest.approx([0.0, 0.8, 1.6, 2.4, 3.2])  # z of the camera is ahead
    labels = np.fromfile(folder / "labels/000000.label", "<u4") & 0xFFFF
    assert set(labels.tolist()) == {40, 18, 13}
    cloud = np.fromfile(folder / "velodyne/000000.bin", "<f4").reshape(-1, 4)
    assert np.median(cloud[labels == 40, 2]) == pytest.approx(-1.73, abs=0.02)
    again = "drive --sensor mine.yaml --trajectory path.txt --scene town.json --sweeps 2 --out kitti"
    run(again, code=1, says="is there already. Give another --sequence")
    assert "2 sweeps" in run(f"{again} --sequence 3 --no-deskew").out
    assert {path.name for path in (own / "kitti/sequences").iterdir()} == {"00", "03"}


def test_a_rig_on_a_street_that_is_drawn(run: Run, own: Path) -> None:
    (own / "rig.yaml").write_text(
        "sensors:\n  - {name: top, sensor: mine.yaml}\n"
        "  - {name: left, sensor: mine.yaml, position: [0, 1, 1], yaw: 90}\n"
    )
    said = run("drive --rig rig.yaml --velocity 5,0,0 --turn 10 --sweeps 2 --out kitti").out
    assert "2 sweeps of mine, mine in 0.2 s and 1.0 m" in said
    labels = np.fromfile(own / "kitti/sequences/00/labels/000000.label", "<u4") & 0xFFFF
    assert {40, 50} < set(labels.tolist())


def test_nuscenes(run: Run, own: Path) -> None:
    run("drive --sensor mine.yaml --trajectory path.txt --scene town.json --format nuscenes --out mini")
    assert "2 crops of 1 sweep (nuScenes)" in run("crop mini --out crops --ground none --least-points 1").out


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("--trajectory path.txt --sweeps 6", "holds 5 whole sweeps of 0.1 s; 6 were asked for"),
        ("--trajectory path.txt --velocity 1,0,0", "--trajectory must go without --velocity"),
        ("--trajectory short.txt", "must last a sweep of 0.1 s; it is shorter"),
        ("--sweeps 1000000000", "at most 1,000,000 sweeps; it has 1,000,000,000"),
        ("--rig path.txt --sensor vlp-16", "must go without --rig"),
        ("--scene room", "--scene must be street or a JSON file; got 'room'"),
        ("--sensor surface", "one of vlp-16"),
        ("--set-sensor columns=0", "columns"),
        ("--sensor-height nan", "--sensor-height"),
        ("--velocity 10,0,0 --sweeps 6000", "at most 5000 m long; it is 6000 m. Give fewer --sweeps"),
    ],
)
def test_wrong_arguments(run: Run, own: Path, options: str, says: str) -> None:
    run(f"drive {options} --out kitti", code=2, says=says)
    assert not (own / "kitti/sequences").exists()


def test_vehicles_of_the_examples_drive_ahead() -> None:
    page = (Path(__file__).parents[2] / "docs/drives.md").read_text()
    for text in (page, str(drive_command.help)):
        words = " ".join(text.split())
        document, _ = json.JSONDecoder().raw_decode(words, words.index('{"objects":'))
        moving = [each for each in document["objects"] if "velocity" in each]
        assert moving
        for each in moving:
            yaw = np.radians(each.get("yaw", 0.0))
            front = np.array([np.sin(yaw), -np.cos(yaw)])  # -y of the mesh
            assert front @ each["velocity"][:2] == pytest.approx(np.linalg.norm(each["velocity"]))


def test_scan_says_how_many_sweeps_a_trajectory_holds(run: Run, own: Path) -> None:
    from zbuf_occlude.meshes import shapes

    shapes.make("car", 1).to_trimesh().export(own / "car.ply")
    said = run("scan car.ply --sensor mine.yaml --range 8 --trajectory path.txt --out a.ply").err
    assert "`zbuf-occlude drive` makes all 5" in said
