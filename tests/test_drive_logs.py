"""benchmarks/drive_logs.py: simulated drives in the forms of KITTI and nuScenes are read back."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

import zbuf_occlude as zo
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.returns import Scan
from zbuf_occlude.sensors.scenes import Placed, Scene, moved
from zbuf_occlude.sensors.scenes.kinds import box_mesh

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

drive_logs = pytest.importorskip("drive_logs", reason="SciPy is not installed")
real_lidar = pytest.importorskip("real_lidar")

PLACES = ((12.0, 3.0, 0.4), (-9.0, 7.0, -1.2), (20.0, -6.0, 2.0))
SIDES = np.array([4.2, 1.8, 1.5])
FLOOR = -1.7


@pytest.fixture(scope="module", params=["hdl-64e", "hdl-32e", "vlp-32c"])
def drive(request: pytest.FixtureRequest) -> tuple[str, Scan]:
    """A turn of a sensor among three boxes on a ground, in its own frame; of each box the instance."""
    ground = zo.Mesh([[-80, -80, FLOOR], [80, -80, FLOOR], [80, 80, FLOOR], [-80, 80, FLOOR]], [[0, 1, 2], [0, 2, 3]])
    boxes = [
        Placed(box_mesh(*(SIDES - 2e-3)), "car", moved(yaw=np.degrees(yaw), to=(x, y, FLOOR + 1e-3)))
        for x, y, yaw in PLACES
    ]
    scene = Scene.joined([*boxes, Placed(ground, "ground")])
    return request.param, zo.scan(scene, make(request.param, noise=0, columns=900))


def held_to(log: "drive_logs.Log", drive: tuple[str, Scan]) -> None:
    name, scan = drive
    (sweep,) = log.sweeps
    assert (log.sensor.name, log.sensor.pattern["columns"]) == (name, pytest.approx(900, abs=3))
    for number, (box, (x, y, yaw)) in enumerate(zip(sweep.boxes, PLACES, strict=True)):
        to_sensor = sweep.mounts[0]
        middle = to_sensor[:3, :3] @ [x, y, FLOOR + SIDES[2] / 2] + to_sensor[:3, 3]
        assert np.allclose(box.centre, middle, atol=1e-3)
        ahead = to_sensor[:3, :3] @ [np.cos(yaw), np.sin(yaw), 0.0]
        assert np.allclose([np.cos(box.yaw), np.sin(box.yaw)], ahead[:2], atol=1e-3)
        assert np.allclose(box.sides, SIDES)
        is_own = (scan.instances == number) & (scan.points[:, 2] > FLOOR + drive_logs.SLACK)
        assert box.n_points == pytest.approx(is_own.sum(), abs=1)


def test_what_nobody_labelled_hides(tmp_path: Path) -> None:
    """A sweep of a car half behind a wall that has no box: simulated returns are left out where the wall returned."""
    wall = Placed(box_mesh(0.2, 3.0, 4.0), "wall", moved(to=(8.0, 1.5, FLOOR)))
    car = Placed(box_mesh(*SIDES), "car", moved(yaw=90.0, to=(12.0, 0.0, FLOOR)))
    sensor = make("hdl-64e", noise=0, columns=900)
    alone, among = (zo.scan(Scene.joined(placed), sensor) for placed in ([car], [car, wall]))
    cloud = tmp_path / "000001.bin"
    np.column_stack([among.points, np.zeros(len(among))]).astype(np.float32).tofile(cloud)
    box = drive_logs.Box("Car", SIDES, np.array([12.0, 0.0, FLOOR + SIDES[2] / 2]), np.pi / 2, 0, 1)
    hidden = real_lidar.hidden_by_others(alone, box, sensor, cloud)
    seen = (among.instances == 0).sum()
    assert 0.3 * len(alone) < seen < 0.7 * len(alone)
    assert (~hidden).sum() == pytest.approx(seen, rel=0.02)
    assert (alone.points[hidden, 1] > -0.1).all()


def test_kitti(tmp_path: Path, drive: tuple[str, Scan]) -> None:
    """Objects and tracking: the camera is 0.3 m before the LiDAR and 0.1 m below it: x right, y down, z ahead."""
    points = drive[1].points
    lines = ["DontCare -1 -1 -10 0 0 0 0 -1 -1 -1 -1000 -1000 -1000 -10"]
    for x, y, yaw in PLACES:
        at = f"{-y:.4f} {-FLOOR - 0.1:.4f} {x - 0.3:.4f} {-yaw - np.pi / 2:.5f}"
        lines.append(f"Car 0 0 0 0 0 0 0 {SIDES[2]} {SIDES[1]} {SIDES[0]} {at}")
    tracks = [f"{frame} {number} {line}" for frame in (6, 7) for number, line in enumerate(lines, -1)]
    for form, cloud, labels, stem, said in (
        ("objects", "000007.bin", "label_2", "000007", lines),
        ("tracking", "0003/000007.bin", "label_02", "0003", tracks),
    ):
        root = tmp_path / form / "training"
        files = [root / "velodyne" / cloud, *(root / folder / f"{stem}.txt" for folder in (labels, "calib"))]
        for file in files:
            file.parent.mkdir(parents=True)
        np.column_stack([points, np.zeros(len(points))]).astype("<f4").tofile(files[0])
        files[1].write_text("\n".join(said))
        files[2].write_text("R0_rect: 1 0 0 0 1 0 0 0 1\nTr_velo_to_cam: 0 -1 0 0 0 0 -1 -0.1 1 0 0 -0.3\n\n")
        held_to(drive_logs.read_log(tmp_path / form), drive)


def test_kittis_raw_data(tmp_path: Path, drive: tuple[str, Scan]) -> None:
    points, items = drive[1].points, ""
    for x, y, yaw in PLACES:
        pose = f"<item><tx>{x}</tx><ty>{y}</ty><tz>{FLOOR}</tz><rx>0</rx><ry>0</ry><rz>{yaw}</rz></item>"
        sides = "".join(f"<{name}>{side}</{name}>" for name, side in zip("lwh", SIDES, strict=True))
        track = f"<objectType>Car</objectType>{sides}<first_frame>6</first_frame><poses>{pose * 2}</poses>"
        items += f"<item>{track}</item>"
    (tmp_path / "velodyne_points" / "data").mkdir(parents=True)
    (tmp_path / "tracklet_labels.xml").write_text(f"<boost><tracklets>{items}</tracklets></boost>")
    cloud = np.column_stack([points, np.zeros(len(points))]).astype("<f4")
    cloud.tofile(tmp_path / "velodyne_points" / "data" / "0000000007.bin")
    held_to(drive_logs.read_log(tmp_path), drive)


def test_nuscenes(tmp_path: Path, drive: tuple[str, Scan]) -> None:
    """The sensor turned by a quarter on its car, the car turned and moved in the world."""
    quarter, world = moved(yaw=-90.0, to=(0.9, 0.0, 1.8)), moved(yaw=40.0, to=(400.0, 1100.0, 0.0))

    def spoken(yaw: float) -> list[float]:
        return [float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2))]

    rows = []
    for number, (x, y, yaw) in enumerate(PLACES):
        centre = (world @ quarter @ [x, y, FLOOR + SIDES[2] / 2, 1.0])[:3].tolist()
        size, rotation = SIDES[[1, 0, 2]].tolist(), spoken(yaw - np.pi / 2 + np.radians(40.0))
        row = {"token": f"a{number}", "sample_token": "s", "instance_token": "i", "translation": centre, "size": size}
        rows.append({**row, "rotation": rotation, "num_lidar_pts": int((drive[1].instances == number).sum())})
    frame = {"token": "d", "sample_token": "s", "ego_pose_token": "e", "calibrated_sensor_token": "c",
             "is_key_frame": True, "filename": "samples/LIDAR_TOP/1.pcd.bin"}  # fmt: skip
    mounted = {"token": "c", "sensor_token": "t", "translation": [0.9, 0.0, 1.8], "rotation": spoken(-np.pi / 2)}
    tables = {
        "sample_annotation": rows,
        "sample_data": [frame, {**frame, "token": "sweep", "is_key_frame": False}],
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
    points = drive[1].points
    np.column_stack([points, np.zeros((len(points), 2))]).astype("<f4").tofile(tmp_path / frame["filename"])
    held_to(drive_logs.read_log(tmp_path), drive)


def test_a_box_scanned_by_its_own_sensor_has_as_many_returns(tmp_path: Path) -> None:
    """A log that is simulated itself, by the models that the benchmark takes, without dropout: every count is met."""
    boxes = [drive_logs.Box("TRUCK", np.array([8.0, 2.5, 3.2]), np.array([15.0, 4.0, 0.0]), 0.3, 0, 1),
             drive_logs.Box("CYCLIST", np.array([1.8, 0.6, 1.75]), np.array([9.0, -4.0, -0.8]), 2.0, 0, 2)]  # fmt: skip
    sensor = make("hdl-64e", noise=0, columns=900)
    scan = zo.scan(Scene.joined([real_lidar.filled(box, 0) for box in boxes]), sensor)
    found = real_lidar.sightings_in(drive_logs.DriveSweep(boxes, [np.eye(4)]), sensor)
    assert [len(one.returns[0]) for one in found] == [(scan.instances == i).sum() for i in range(2)]
    assert [one.group for one in found] == ["trucks and buses", "cyclists"]
    rows = [[box.category, *box.sides, *box.centre, np.degrees(box.yaw), 7] for box in reversed(boxes)]
    table = [drive_logs.COLUMNS, *rows]
    (tmp_path / "boxes.csv").write_text("\n".join(",".join(map(str, row)) for row in table))
    with pytest.raises(SystemExit, match="--sensor NAME"):
        drive_logs.read_log(tmp_path / "boxes.csv")
    (sweep,) = drive_logs.read_log(tmp_path / "boxes.csv", "hdl-64e").sweeps
    assert [(box.category, box.n_points) for box in sweep.boxes] == [("CYCLIST", 7), ("TRUCK", 7)]
    with pytest.raises(SystemExit, match="must be a log of drives"):
        drive_logs.read_log(tmp_path)


def test_real_and_simulated_returns_are_counted_in_the_same_way(tmp_path: Path) -> None:
    """Noise and rounded labels put returns out of boxes, and the ground puts some in at their feet."""
    floor = zo.Mesh([[-30, -30, FLOOR], [30, -30, FLOOR], [0, 40, FLOOR]], [[0, 1, 2]])
    box = drive_logs.Box("TRUCK", np.array([8.0, 2.5, 3.2]), np.array([12.0, 4.0, FLOOR + 1.6]), 0.3, 0, 1)
    sensor = make("hdl-64e", columns=900, detection_range=0.0, sigma=0.02, step=0.0)
    scan = zo.scan(Scene.joined([real_lidar.filled(box, 0), Placed(floor, "ground")]), sensor, seed=0)
    shrunk = drive_logs.replace(box, sides=box.sides - 1e-4)
    assert drive_logs.within(shrunk, scan.points).sum() < 0.9 * (scan.instances == 0).sum(), "what must not be compared"
    real = drive_logs.count_in(shrunk, scan.points).n_points
    cloud = tmp_path / "000001.bin"
    np.column_stack([scan.points, np.zeros(len(scan))]).astype("<f4").tofile(cloud)
    sweep = drive_logs.DriveSweep([shrunk], [np.eye(4)], cloud)
    (found,) = real_lidar.sightings_in(sweep, sensor.with_numbers(sigma=0.0))
    assert real == pytest.approx(len(found.returns[0]), rel=0.02)


CALIBRATION = "R0_rect: 1 0 0 0 1 0 0 0 1\nTr_velo_to_cam: 0 -1 0 0 0 0 -1 -0.1 1 0 0 -0.3\n"
LABEL = "Car 0 0 0 0 0 0 0 1.5 1.8 4.2 3 1.6 12 0"


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("velodyne/1.bin", b"", "must have points"),
        ("velodyne/1.bin", bytes(1001), "it has 1001 bytes"),
        ("velodyne/1.bin", np.ones((9, 4), "<f4").tobytes(), "it has 0. Name it: --sensor NAME"),
        ("calib/1.txt", b"", "must have the rows Tr_velo_to_cam"),
        ("calib/1.txt", b"R0_rect: 1\nTr_velo_to_cam: 1 2", "cannot reshape"),
        ("label_2/1.txt", b"\xff\xfe", "can't decode"),
        ("label_2/1.txt", LABEL.replace("4.2", "long").encode(), "could not convert"),
        ("label_2/1.txt", LABEL[:-5].encode(), "must have 15 fields; one has 13"),
        ("label_2/1.txt", LABEL.replace("12", "nan").encode(), "7 finite numbers"),
        ("label_2/1.txt", LABEL.replace("4.2", "0").encode(), "sides above 0"),
        ("boxes.csv", ",".join(drive_logs.COLUMNS).encode(), "must have boxes"),
        ("boxes.csv", f"{','.join(drive_logs.COLUMNS)}\ncar,1,2,3,4,5".encode(), "NoneType"),
        ("boxes.csv", f"{','.join(drive_logs.COLUMNS)}\ncar,1,2,x,4,5,6,7,8".encode(), "could not convert"),
        ("sample_annotation.json", b"[]", "sensor.json"),
        ("tracklet_labels.xml", b"<boost>", "ParseError"),
        ("infos.pkl", b"cos\nsystem\n.", "os.system is not read"),
        ("annotations.feather", b"none", "error: "),
    ],
)
def test_a_broken_file_is_named_in_one_line(tmp_path: Path, file: str, content: bytes, message: str) -> None:
    whole = {"velodyne/1.bin": np.ones((9, 4), "<f4").tobytes(), "calib/1.txt": CALIBRATION.encode()}
    files = whole | {"label_2/1.txt": LABEL.encode()} if "1." in file else {}
    for name, data in (files | {file: content}).items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(data)
    with pytest.raises(SystemExit) as caught:
        drive_logs.read_log(tmp_path / file if file.endswith("csv") else tmp_path)
    said = str(caught.value)
    assert said.startswith(f"error: {tmp_path / file}: ")
    assert message in said
    assert "\n" not in said


def test_what_categories_are_filled_with() -> None:
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
    for kind, categories in names.items():
        assert {real_lidar.kind_of(name) for name in categories.split()} == {kind}
