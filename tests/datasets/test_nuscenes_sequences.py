"""nuScenes's layout of drives, read back by the reader of real ones: clouds, boxes, links, further sequences."""

import json
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
MOTION = Motion(velocity=(12.0, 0.0, 0.0), turn=40.0, deskew=True)


def written(out: Path, sequence: int = 0, n: int = 7) -> list[DriveSweep]:
    drive = scan_drive(Scene.joined([GROUND, CAR, BUS, HOUSE]), RIG, MOTION, n)
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
        assert bus.contains(real.points[scan.instances == 2], 0.91).all()  # 9 m/s for a tenth of a second
        assert (scan.instances == 2).sum() > 20
        behind = car.to_box(real.points[scan.instances == 1])
        assert np.abs(np.abs(behind) - car.size / 2).min(axis=1).max() < 1e-3


def test_links_and_counts(tmp_path: Path) -> None:
    sweeps = written(tmp_path)
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
    for row in table(tmp_path, "sample_annotation"):
        sweep = sweeps[5 * (row["sample_token"] != table(tmp_path, "sample")[0]["token"])]
        number = 1 if row["size"][2] == 1.5 else 2
        assert row["num_lidar_pts"] == sum((scan.instances == number).sum() for scan in sweep.scans.values())
        assert bool(row["prev"]) != bool(row["next"])
    assert [row["nbr_annotations"] for row in table(tmp_path, "instance")] == [2, 2]


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
