"""nuScenes's layout of drives, read back by the reader of real ones: clouds, boxes, links, further sequences."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import box
from zbuf_occlude.datasets.real.sweeps import find_sweeps
from zbuf_occlude.datasets.sequences import nuscenes
from zbuf_occlude.sensors import DriveSweep, Motion, Mounted, Rig, make, mount_pose, scan_drive
from zbuf_occlude.sensors.scenes import Placed, Scene, moved

pytest.importorskip("PIL", reason="Pillow is not installed: pip install 'zbuf-occlude[report]'")

LIDAR = make("vlp-16", noise=0, range_min=0, columns=180)
RIG = Rig([
    Mounted("front", LIDAR, mount_pose((0.3, 0.0, 1.8), yaw=5.0, pitch=3.0)),
    Mounted("left side", LIDAR, mount_pose((0.0, 0.9, 0.7), yaw=90.0, roll=4.0)),
])  # fmt: skip
GROUND = Placed(box((200.0, 200.0, 2.0)), "ground", moved(to=(0.0, 0.0, -1.0)), is_background=True)
CAR = Placed(box((1.8, 4.0, 1.5)), "van", moved(yaw=30.0, to=(10.0, 3.0, 0.75)))
BUS = Placed(box((10.0, 2.5, 3.0)), "bus", moved(to=(14.0, -6.0, 1.5)), velocity=(-9.0, 0.0, 0.0))
HOUSE = Placed(box((5.0, 5.0, 5.0)), "building", moved(to=(0.0, 15.0, 2.5)))
PLACED = (GROUND, CAR, BUS, HOUSE)
MOTION = Motion(velocity=(12.0, 0.0, 0.0), turn=40.0, deskew=True)


def written(out: Path, sequence: int = 0, n: int = 7, placed: tuple[Placed, ...] = PLACED) -> list[DriveSweep]:
    drive = scan_drive(Scene.joined(placed), RIG, MOTION, n)
    return list(nuscenes.write(out, sequence, RIG, drive))


def table(out: Path, name: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = json.loads((out / f"v1.0-mini/{name}.json").read_text())
    return rows


def test_key_frames_are_read_back_as_real_ones(tmp_path: Path) -> None:
    sweeps = written(tmp_path)
    layout, loaders = find_sweeps(tmp_path)
    assert (layout.name, len(loaders)) == ("nuScenes", 2)
    for loader, sweep in zip(loaders, (sweeps[0], sweeps[5]), strict=True):
        real, scan = loader(), sweep.scans["front"]
        pose = sweep.pose @ RIG[0].pose
        local = (scan.points - pose[:3, 3]) @ pose[:3, :3]
        assert real.points == pytest.approx(np.stack([-local[:, 1], local[:, 0], local[:, 2]], axis=1), abs=1e-4)
        assert [each.label for each in real.boxes] == ["vehicle.car", "vehicle.bus.rigid"]
        car, bus = real.boxes
        assert car.size == pytest.approx([4.0, 1.8, 1.5])
        assert car.contains(real.points[scan.instances == 1], 1e-3).all()
        mine = scan.instances == 2
        moved_by = 9.0 * np.ptp(scan.times[mine])
        assert mine.sum() > 20
        assert moved_by < 0.3
        assert bus.contains(real.points[mine], moved_by).all()  # at a time within those of its points
        behind = car.to_box(real.points[scan.instances == 1])
        assert np.abs(np.abs(behind) - car.size / 2).min(axis=1).max() < 1e-3


def test_links(tmp_path: Path) -> None:
    written(tmp_path)
    data = table(tmp_path, "sample_data")
    assert len(data) == 2 * 7
    assert sum(row["is_key_frame"] for row in data) == 4
    by_token = {row["token"]: row for row in data}
    (first, *_) = [row for row in data if not row["prev"] and "LIDAR_LEFT_SIDE" in row["filename"]]
    chain = [first]
    while chain[-1]["next"]:
        chain.append(by_token[chain[-1]["next"]])
    assert [row["timestamp"] for row in chain] == [100_000 * i for i in range(7)]
    assert {row["filename"].split("/")[0] for row in chain} == {"samples", "sweeps"}
    assert all((tmp_path / row["filename"]).exists() for row in data)
    assert all(bool(row["prev"]) != bool(row["next"]) for row in table(tmp_path, "sample_annotation"))
    assert [row["nbr_annotations"] for row in table(tmp_path, "instance")] == [2, 2]


def test_boxes_count_points_as_the_devkit_does(tmp_path: Path) -> None:
    """All points of the key frame between the three pairs of planes of a box, as `points_in_box` has it."""
    mesh = box((2.0, 2.0, 1.5))
    diamond = replace(CAR, mesh=replace(mesh, vertices=mesh.vertices @ moved(yaw=45.0)[:3, :3].T))  # half fills its box
    ground = replace(GROUND, pose=moved(to=(0.0, 0.0, -0.7)))  # above the feet
    sweeps = written(tmp_path, placed=(ground, diamond, BUS, HOUSE))
    samples = [row["token"] for row in table(tmp_path, "sample")]
    rows = table(tmp_path, "sample_annotation")
    for row in rows:
        scans = sweeps[5 * samples.index(row["sample_token"])].scans.values()
        w, x, y, z = row["rotation"]
        ahead = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
        left, up = np.array([-ahead[1], ahead[0], 0.0]), np.array([0.0, 0.0, 1.0])
        width, length, height = row["size"]
        points = np.concatenate([scan.points for scan in scans])
        inside = np.ones(len(points), dtype=bool)
        for axis, side in ((ahead, length), (left, width), (up, height)):
            along = (points - (row["translation"] - axis * side / 2)) @ axis
            inside &= (along >= -1e-6) & (along <= side + 1e-6)
        assert row["num_lidar_pts"] == inside.sum()
        is_ground = np.concatenate([scan.instances for scan in scans]) == 0
        assert (inside & is_ground).any() or height == 3.0  # of a bus
    assert len(rows) == 4


def test_after_an_interruption_the_same_sequence_is_as_from_a_run_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, whole = tmp_path / "out", tmp_path / "whole"
    write_json, n_written = nuscenes.atomic.write_json, list[Path]()

    def stopped(path: Path, rows: Any) -> None:
        if len(n_written) == len(nuscenes.TABLES) - 1:
            raise KeyboardInterrupt
        n_written.append(path)
        write_json(path, rows)

    monkeypatch.setattr(nuscenes.atomic, "write_json", stopped)
    with pytest.raises(KeyboardInterrupt):
        written(out, n=7)
    monkeypatch.undo()
    nuscenes.check(out, 0, RIG)
    for folder in (out, whole):
        written(folder, n=2)
    assert table(out, "scene") == table(whole, "scene")
    clouds = [sorted(path.relative_to(folder) for path in folder.rglob("*.bin")) for folder in (out, whole)]
    assert clouds[0] == clouds[1]


def test_a_further_sequence_joins_the_tables(tmp_path: Path) -> None:
    written(tmp_path, 0, 1)
    with pytest.raises(zo.DatasetError, match="has scene-0000 already"):
        nuscenes.check(tmp_path, 0, RIG)
    nuscenes.check(tmp_path, 3, RIG)
    written(tmp_path, 3, 1)
    assert [row["name"] for row in table(tmp_path, "scene")] == ["scene-0000", "scene-0003"]
    for name in nuscenes.TABLES:
        tokens = [row["token"] for row in table(tmp_path, name)]
        assert len(set(tokens)) == len(tokens), name
    assert len(find_sweeps(tmp_path)[1]) == 2
    same = Rig([*RIG, Mounted("top", LIDAR, np.eye(4))])
    with pytest.raises(zo.OptionError, match="two have LIDAR_TOP"):
        nuscenes.check(tmp_path, 5, same)
    (tmp_path / "v1.0-mini/scene.json").write_text("[{")
    with pytest.raises(zo.DatasetError, match=r"scene\.json must be as it was written"):
        nuscenes.check(tmp_path, 5, RIG)
