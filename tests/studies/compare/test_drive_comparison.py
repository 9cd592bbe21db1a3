"""Comparison of drives: simulated logs in the layouts of KITTI, nuScenes and Argoverse 2, whose counts are known."""

import json
from pathlib import Path

import numpy as np
import pytest

import zbuf_occlude as zo
from zbuf_occlude.datasets.real.sweeps import LabelledBox, Sweep
from zbuf_occlude.sensors import Sensor, make
from zbuf_occlude.sensors.returns import Scan
from zbuf_occlude.sensors.scenes import Placed, Scene, moved
from zbuf_occlude.sensors.scenes.kinds import box_mesh
from zbuf_occlude.studies.compare.drive_comparison import (
    SLACK,
    DriveComparison,
    RealRays,
    compare_drive,
    found_sensor,
    sightings_in,
)
from zbuf_occlude.studies.compare.drive_models import filled, kind_of, upright
from zbuf_occlude.studies.compare.drive_report import drive_report

PLACES = ((12.0, 3.0, 0.4), (-9.0, 7.0, -1.2), (20.0, -6.0, 2.0))
SIDES = np.array([4.2, 1.8, 1.5])
FLOOR = -1.7


def labelled(label: str, sides: list[float], centre: list[float], yaw: float, n: int | None = None) -> LabelledBox:
    return LabelledBox(label, np.array(centre), moved(yaw=np.degrees(yaw))[:3, :3], np.array(sides), "", n)


def turn(sensor: Sensor) -> Scan:
    """A turn of a sensor among three boxes on a ground, in its own frame; of each box the instance."""
    ground = zo.Mesh([[-80, -80, FLOOR], [80, -80, FLOOR], [80, 80, FLOOR], [-80, 80, FLOOR]], [[0, 1, 2], [0, 2, 3]])
    boxes = [
        Placed(box_mesh(*(SIDES - 2e-3)), "car", moved(yaw=np.degrees(yaw), to=(x, y, FLOOR + 1e-3)))
        for x, y, yaw in PLACES
    ]
    return zo.scan(Scene.joined([*boxes, Placed(ground, "ground")]), sensor)


@pytest.fixture(scope="module")
def drive() -> Scan:
    return turn(make("hdl-64e", noise=0, columns=900))


def held_to(found: DriveComparison, drive: Scan) -> None:
    assert found.sensor.name == "hdl-64e"
    assert found.sensor.pattern["columns"] == pytest.approx(900, abs=3)
    assert len(found.sightings) == 3
    for number, (one, (x, y, _)) in enumerate(zip(found.sightings, PLACES, strict=True)):
        assert one.distance == pytest.approx(np.hypot(x, y), abs=1e-3)
        is_own = (drive.instances == number) & (drive.points[:, 2] > FLOOR + SLACK)
        assert one.real == pytest.approx(is_own.sum(), abs=1)
        assert 0.2 * one.real < one.n_without_dropout < 1.5 * one.real  # a car in its box


def write_kitti(root: Path, points: np.ndarray) -> None:
    """The camera is 0.3 m before the LiDAR and 0.1 m below it: x right, y down, z ahead."""
    lines = ["DontCare -1 -1 -10 0 0 0 0 -1 -1 -1 -1000 -1000 -1000 -10"]
    for x, y, yaw in PLACES:
        at = f"{-y:.4f} {-FLOOR - 0.1:.4f} {x - 0.3:.4f} {-yaw - np.pi / 2:.5f}"
        lines.append(f"Car 0 0 0 0 0 0 0 {SIDES[2]} {SIDES[1]} {SIDES[0]} {at}")
    for folder in ("velodyne", "label_2", "calib"):
        (root / "training" / folder).mkdir(parents=True, exist_ok=True)
    np.column_stack([points, np.zeros(len(points))]).astype("<f4").tofile(root / "training/velodyne/000007.bin")
    (root / "training/label_2/000007.txt").write_text("\n".join(lines))
    (root / "training/calib/000007.txt").write_text(
        "R0_rect: 1 0 0 0 1 0 0 0 1\nTr_velo_to_cam: 0 -1 0 0 0 0 -1 -0.1 1 0 0 -0.3\n"
    )


def test_kitti(tmp_path: Path, drive: Scan) -> None:
    write_kitti(tmp_path, drive.points)
    found = compare_drive(tmp_path)
    held_to(found, drive)
    assert compare_drive(tmp_path, parity=0).sightings == []
    report = "\n".join(drive_report(found))
    assert "KITTI, 3 sightings in 1 of 1 sweeps. Sensor: hdl-64e (by elevations, e^" in report
    assert f"| Car | 21 | {found.sightings[2].real} |" in report
    assert "| cars | 10-20 | 2, 2 |" in report


def test_a_sweep_that_cannot_be_read_is_skipped_and_named(tmp_path: Path, drive: Scan) -> None:
    write_kitti(tmp_path, drive.points)
    (tmp_path / "training/velodyne/000008.bin").write_bytes(bytes(32))
    found = compare_drive(tmp_path, "hdl-64e:columns=900")
    assert len(found.sightings) == 3
    assert ["label_2/000008.txt" in each for each in found.skipped] == [True]
    (tmp_path / "training/label_2/000007.txt").write_text("Car 0 0 0 0 0 0 0 1.5 1.8 0 3 1.6 12 0")
    with pytest.raises(zo.DatasetError, match=r"no sweep of .* can be read\. sides of a box must be above 0"):
        compare_drive(tmp_path)
    write_kitti(tmp_path, np.ones((9, 3)))
    with pytest.raises(zo.DatasetError, match=r"found from 1000 points; there are 0\. Give --sensor"):
        compare_drive(tmp_path)


def test_nuscenes(tmp_path: Path, drive: Scan) -> None:
    """The sensor turned by a quarter on its car, the car turned and moved in the world."""
    quarter, world = moved(yaw=-90.0, to=(0.9, 0.0, 1.8)), moved(yaw=40.0, to=(400.0, 1100.0, 0.0))

    def spoken(yaw: float) -> list[float]:
        return [float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2))]

    rows = []
    for number, (x, y, yaw) in enumerate(PLACES):
        centre = (world @ quarter @ [x, y, FLOOR + SIDES[2] / 2, 1.0])[:3].tolist()
        size, rotation = SIDES[[1, 0, 2]].tolist(), spoken(yaw - np.pi / 2 + np.radians(40.0))
        row = {"token": f"a{number}", "sample_token": "s", "instance_token": "i", "translation": centre, "size": size}
        rows.append({**row, "rotation": rotation})
    frame = {"token": "d", "sample_token": "s", "ego_pose_token": "e", "calibrated_sensor_token": "c",
             "is_key_frame": True, "filename": "samples/LIDAR_TOP/1.pcd.bin"}  # fmt: skip
    mounted = {"token": "c", "sensor_token": "t", "translation": [0.9, 0.0, 1.8], "rotation": spoken(-np.pi / 2)}
    tables = {
        "sample_annotation": rows,
        "sample_data": [frame],
        "sensor": [{"token": "t", "channel": "LIDAR_TOP"}],
        "calibrated_sensor": [mounted],
        "ego_pose": [{"token": "e", "translation": [400.0, 1100.0, 0.0], "rotation": spoken(np.radians(40.0))}],
        "instance": [{"token": "i", "category_token": "k"}],
        "category": [{"token": "k", "name": "vehicle.car"}],
    }
    (tmp_path / "v1.0-mini").mkdir()
    for name, table in tables.items():
        (tmp_path / "v1.0-mini" / f"{name}.json").write_text(json.dumps(table))
    (tmp_path / "samples" / "LIDAR_TOP").mkdir(parents=True)
    points = drive.points
    np.column_stack([points, np.zeros((len(points), 2))]).astype("<f4").tofile(tmp_path / str(frame["filename"]))
    held_to(compare_drive(tmp_path), drive)


def test_annotations_of_argoverse_alone(tmp_path: Path) -> None:
    """Two LiDARs, one upside down, see a box as often as both alone; the real number is the makers'."""
    pytest.importorskip("pyarrow", reason="pyarrow is not installed: pip install 'zbuf-occlude[parquet]'")
    import pyarrow
    from pyarrow import feather

    row = {"timestamp_ns": 5, "track_uuid": "t", "category": "BOX_TRUCK", "length_m": 8.0, "width_m": 2.5,
           "height_m": 3.2, "qw": np.cos(0.15), "qx": 0.0, "qy": 0.0, "qz": np.sin(0.15),
           "tx_m": 21.35, "ty_m": 2.0, "tz_m": 1.6, "num_interior_pts": 321}  # fmt: skip
    rows = [row, {**row, "timestamp_ns": 6, "tx_m": 20.0, "num_interior_pts": 300}]
    feather.write_feather(pyarrow.Table.from_pylist(rows), tmp_path / "annotations.feather")
    found = compare_drive(tmp_path)
    assert (found.layout, found.sensor.name, found.how) == ("Argoverse 2", "vlp-32c", "named by Argoverse 2")
    assert [one.real for one in found.sightings] == [321, 300]
    assert len({one.identity for one in found.sightings}) == 1
    model = filled(upright(labelled("BOX_TRUCK", [8.0, 2.5, 3.2], [21.35, 2.0, 1.6], 0.3), "", 0), 0)
    flipped = moved(to=(1.35, 0.0, 1.53)) @ np.diag([1.0, -1.0, -1.0, 1.0])
    alone = [
        len(zo.scan(Scene.joined([model]), make("vlp-32c", noise=0), pose))
        for pose in (moved(to=(1.35, 0.0, 1.64)), flipped)
    ]
    assert len(found.sightings[0].returns[0]) == pytest.approx(sum(alone), rel=0.02)


def test_what_nobody_labelled_hides() -> None:
    """A sweep of a car half behind a wall that has no box: simulated returns are left out where the wall returned."""
    wall = Placed(box_mesh(0.2, 3.0, 4.0), "wall", moved(to=(8.0, 1.5, FLOOR)))
    car = Placed(box_mesh(*SIDES), "car", moved(yaw=90.0, to=(12.0, 0.0, FLOOR)))
    sensor = make("hdl-64e", noise=0, columns=900)
    alone, among = (zo.scan(Scene.joined(placed), sensor) for placed in ([car], [car, wall]))
    box = upright(labelled("Car", list(SIDES), [12.0, 0.0, FLOOR + SIDES[2] / 2], np.pi / 2), "", 0)
    hidden = RealRays(among.points, sensor).end_before(alone, box)
    seen = (among.instances == 0).sum()
    assert 0.3 * len(alone) < seen < 0.7 * len(alone)
    assert (~hidden).sum() == pytest.approx(seen, rel=0.02)
    assert (alone.points[hidden, 1] > -0.1).all()


def test_a_box_scanned_by_its_own_sensor_has_as_many_returns() -> None:
    """A log that is simulated itself, by the models of the comparison, without dropout: every count is met."""
    boxes = [labelled("TRUCK", [8.0, 2.5, 3.2], [15.0, 4.0, 0.0], 0.3, 7),
             labelled("CYCLIST", [1.8, 0.6, 1.75], [9.0, -4.0, -0.8], 2.0, 9)]  # fmt: skip
    sensor = make("hdl-64e", noise=0, columns=900)
    models = [filled(upright(box, "s", number), 0) for number, box in enumerate(boxes)]
    scan = zo.scan(Scene.joined(models), sensor)
    found = sightings_in(Sweep("s", np.empty((0, 3)), boxes), sensor)
    assert [len(one.returns[0]) for one in found] == [(scan.instances == i).sum() for i in range(2)]
    assert [(one.group, one.real) for one in found] == [("trucks and buses", 7), ("cyclists", 9)]


def test_real_and_simulated_returns_are_counted_in_the_same_way() -> None:
    """Noise and rounded labels put returns out of boxes, and the ground puts some in at their feet."""
    floor = zo.Mesh([[-30, -30, FLOOR], [30, -30, FLOOR], [0, 40, FLOOR]], [[0, 1, 2]])
    whole = upright(labelled("TRUCK", [8.0, 2.5, 3.2], [12.0, 4.0, FLOOR + 1.6], 0.3), "s", 0)
    sensor = make("hdl-64e", columns=900, detection_range=0.0, sigma=0.02, step=0.0)
    scan = zo.scan(Scene.joined([filled(whole, 0), Placed(floor, "ground")]), sensor, seed=0)
    shrunk = labelled("TRUCK", list(whole.sides - 1e-4), list(whole.centre), 0.3)
    strictly = upright(shrunk, "s", 0).is_inside(scan.points).sum()
    assert strictly < 0.9 * (scan.instances == 0).sum(), "what must not be compared"
    (found,) = sightings_in(Sweep("s", scan.points, [shrunk]), sensor.with_numbers(sigma=0.0))
    assert found.real == pytest.approx(len(found.returns[0]), rel=0.02)


@pytest.mark.parametrize("name", ["hdl-64e", "hdl-32e", "vlp-32c", "xt32", "os1-128"])
def test_a_sensor_is_found_from_its_points(name: str) -> None:
    sensor, words = found_sensor(turn(make(name, noise=0, columns=720)).points)
    assert sensor.name == name
    assert sensor.pattern["columns"] == pytest.approx(720, abs=3)
    assert words.startswith("by elevations, e^")


def test_what_labels_are_filled_with() -> None:
    """As Argoverse 2, KITTI and nuScenes call them."""
    names = {
        "car": "REGULAR_VEHICLE Car Van vehicle.car vehicle.emergency.police",
        "pedestrian": "PEDESTRIAN Person_sitting human.pedestrian.adult OFFICIAL_SIGNALER",
        "bicycle": "BICYCLE BICYCLIST Cyclist vehicle.bicycle",
        "motorcycle": "MOTORCYCLE MOTORCYCLIST vehicle.motorcycle",
        "truck": "BOX_TRUCK TRUCK Truck vehicle.truck construction_vehicle vehicle.construction",
        "tractor": "TRUCK_CAB",
        "trailer": "VEHICULAR_TRAILER vehicle.trailer",
        "bus": "BUS SCHOOL_BUS Tram vehicle.bus.bendy LARGE_VEHICLE RAILED_VEHICLE",
        "pole": "SIGN STOP_SIGN MOBILE_PEDESTRIAN_CROSSING_SIGN BOLLARD movable_object.trafficcone",
        "box": "Misc static_object.bicycle_rack movable_object.barrier STROLLER",
    }
    for kind, labels in names.items():
        assert {kind_of(label) for label in labels.split()} == {kind}
