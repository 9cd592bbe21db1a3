"""Crops of labelled sweeps: points counted by an independent box test, layouts, the ground, duplicates, the folder."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import DATA
from tests.studies.paper.hand_made import write_sydney
from zbuf_occlude.datasets.cloud_files import read_points
from zbuf_occlude.datasets.real.crops import FIELDS, check_empty, crop_objects
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.sensors.scenes import moved

KITTI = DATA / "kitti"
needs_kitti = pytest.mark.skipif(not KITTI.is_dir(), reason=f"{KITTI} is not there; set ZBUF_OCCLUDE_DATA")


def counted_by_half_spaces(root: Path, stem: str, above: float, margin: float) -> list[tuple[str, int]]:
    """Count the points in each box of a KITTI sweep: by its eight corners in the camera's frame and six half-spaces."""
    points = np.fromfile(root / f"velodyne/{stem}.bin", np.float32).reshape(-1, 4)[:, :3].astype(float)
    rows = dict(line.split(":", 1) for line in (root / f"calib/{stem}.txt").read_text().splitlines() if ":" in line)
    rectify = np.array(rows["R0_rect"].split(), float).reshape(3, 3)
    to_camera = np.array(rows["Tr_velo_to_cam"].split(), float).reshape(3, 4)
    seen = (points @ to_camera[:, :3].T + to_camera[:, 3]) @ rectify.T
    found = []
    for line in (root / f"label_2/{stem}.txt").read_text().splitlines():
        label, *numbers = line.split()
        if label == "DontCare":
            continue
        height, width, length, x, y, z, turn = map(float, numbers[7:14])
        ahead = np.array([np.cos(turn), 0.0, -np.sin(turn)])
        aside = np.array([np.sin(turn), 0.0, np.cos(turn)])
        local = seen - [x, y, z]
        rise = -local[:, 1]  # the camera's y axis points down
        inside = (np.abs(local @ ahead) <= length / 2 + margin) & (np.abs(local @ aside) <= width / 2 + margin)
        inside &= (rise <= height + margin) & (rise > above if above else rise >= -margin)
        found.append((label, int(inside.sum())))
    return found


@needs_kitti
@pytest.mark.parametrize(("ground", "margin"), [(None, 0.0), (0.15, 0.0), (None, 0.1), (0.2, 0.05)])
def test_points_per_object_are_those_of_an_independent_count(ground: float | None, margin: float) -> None:
    crops = zo.crop_objects(KITTI, ground=ground, margin=margin, least_points=1, distinct=0)
    expected = []
    for file in sorted((KITTI / "training/velodyne").glob("*.bin")):
        expected += counted_by_half_spaces(KITTI / "training", file.stem, ground or 0.0, margin)
    assert [(crop.box.label, len(crop.points)) for crop in crops] == [row for row in expected if row[1]]
    assert len(crops) > 30


def boxes_file(folder: Path, sweeps: dict[str, np.ndarray], rows: list[dict[str, object]], form: str = "csv") -> Path:
    """Write clouds as .npy, and a table of boxes."""
    folder.mkdir(exist_ok=True)
    for name, points in sweeps.items():
        np.save(folder / name, points)
    path = folder / f"boxes.{form}"
    if form == "json":
        path.write_text(json.dumps(rows))
        return path
    with path.open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)
    return path


def scene(x: float = 12.0, yaw: float = 30.0, slope: float = 0.0) -> tuple[np.ndarray, dict[str, object], np.ndarray]:
    """Return a cloud of a sloping ground and of a box on it, the box's row, and which points are the object's."""
    rng = np.random.default_rng(1)
    flat = rng.uniform(-6, 6, (3000, 2))
    ground = np.column_stack([flat, slope * flat[:, 0] - 0.75 + rng.normal(0, 0.01, 3000)])
    body = rng.uniform(-0.5, 0.5, (200, 3)) * [4.2, 1.8, 1.5]
    body = body[body[:, 2] > slope * body[:, 0] - 0.75 + 0.15]
    pose = moved(yaw=yaw, to=(x, 3.0, -0.9))
    local = np.concatenate([ground, body])
    row = {"file": "a.npy", "label": "Car", "x": x, "y": 3.0, "z": -0.9, "length": 4.2, "width": 1.8, "height": 1.5}
    return local @ pose[:3, :3].T + pose[:3, 3], {**row, "yaw": yaw}, local[len(ground) :]


@pytest.mark.parametrize("slope", [0.0, 0.08])
def test_a_fitted_ground_goes_and_the_object_stays(tmp_path: Path, slope: float) -> None:
    points, row, body = scene(slope=slope)
    source = boxes_file(tmp_path, {"a.npy": points}, [row])
    (crop,) = crop_objects(source)
    assert len(crop.points) == len(body)
    assert np.allclose(crop.points, body, atol=1e-9), "in the frame of the box"
    (whole,) = crop_objects(source, ground=None)
    assert len(whole.points) > len(body) + 50
    (cut,) = crop_objects(source, ground=0.15)
    assert (len(cut.points) == len(body)) == (slope == 0.0), "a constant height does not follow a slope"


def test_both_forms_of_a_table_and_both_frames(tmp_path: Path) -> None:
    points, row, body = scene()
    of_csv, of_json = (
        crop_objects(boxes_file(tmp_path / form, {"a.npy": points}, [row], form), frame="sensor")
        for form in ("csv", "json")
    )
    assert (of_csv[0].points == of_json[0].points).all()
    assert np.allclose(of_csv[0].points, points[-len(body) :]), "the sensor is the origin"
    x, y, z = of_csv[0].eye
    heading = np.radians(30.0)
    to_sensor = -np.array([12.0, 3.0, -0.9])
    assert [x, y] == pytest.approx([np.cos(heading) * to_sensor[0] + np.sin(heading) * to_sensor[1],
                                    -np.sin(heading) * to_sensor[0] + np.cos(heading) * to_sensor[1]])  # fmt: skip
    assert z == pytest.approx(0.9)
    assert of_csv[0].range == pytest.approx(np.hypot(12, 3))


def test_near_duplicates_are_left_out(tmp_path: Path) -> None:
    """The sensor stands, creeps by .6 m, and has gone 3 m: the first and the last view of the same car differ."""
    rows, sweeps = [], {}
    for name, x in (("a", 12.0), ("b", 12.0), ("c", 11.4), ("d", 9.0)):
        points, row, _ = scene(x)
        sweeps[f"{name}.npy"] = points
        rows.append({**row, "file": f"{name}.npy"})
    source = boxes_file(tmp_path, sweeps, rows)
    crops = crop_objects(source)
    assert [crop.sweep for crop in crops] == ["a.npy", "d.npy"]
    assert crops.left_out["near duplicates"] == 2
    assert len(crop_objects(source, distinct=0)) == 4
    assert [crop.sweep for crop in crop_objects(source, distinct=0.5)] == ["a.npy", "c.npy", "d.npy"]
    tracked = [{**row, "track": number} for number, row in enumerate(rows)]
    for form in ("csv", "json"):
        of_tracks = crop_objects(boxes_file(tmp_path, sweeps, tracked, form))
        assert [crop.box.track for crop in of_tracks] == ["0", "1", "2", "3"], "other tracks are other objects"


def test_classes_ranges_and_least_points(tmp_path: Path) -> None:
    points, row, _ = scene()
    rows = [row, {**row, "label": "vehicle.van"}, {**row, "label": "Tree"}, {**row, "label": "Car", "x": 40.0}]
    source = boxes_file(tmp_path, {"a.npy": points}, rows)
    crops = crop_objects(source, classes={"car": ["Car", "vehicle.*"]}, range=(5, 30))
    assert [crop.class_name for crop in crops] == ["car", "car"]
    assert crops.left_out == {"of other labels": 1, "out of range": 1}
    assert crops.counts() == (["10-20 m"], {"car": [2]})
    assert crop_objects(source, least_points=10**6).left_out == {"with fewer than 1000000 points": 4}
    for options, words in (
        ({"classes": {"car": "car"}}, "label of .*: Car, Tree, vehicle.van; got car.* mean 'Car'"),
        ({"least_points": 0}, "least_points must be a positive int"),
        ({"margin": -1.0}, "margin must be a number of metres, 0 or more; got -1"),
        ({"ground": "flat"}, "ground must be a number of metres"),
        ({"ground": np.array([1e155, 0.0])}, "ground must be a number of metres"),
        ({"range": (9, 3)}, "range must be metres"),
        ({"range": (1,)}, r"range must be metres.*got \(1,\)"),
        ({"range": "5..50"}, "range must be metres.*got '5..50'"),
        ({"range": ("a", "b")}, r"range must be metres.*got \('a', 'b'\)"),
        ({"classes": "car"}, "classes must be a dict.*it is 'car'"),
        ({"classes": ["car"]}, r"classes must be a dict.*it is \['car'\]"),
        ({"classes": {"car": 5}}, "a class must have a name and labels; 'car' has 5"),
        ({"classes": {5: "Car"}}, "a class must have a name and labels; 5 has 'Car'"),
        ({"out": 5}, "out must be a path; got 5"),
        ({"frame": "world"}, "frame must be one of object, sensor"),
        ({"classes": {"car": []}}, "a class must have a name and labels"),
    ):
        with pytest.raises((zo.ArgumentError, zo.OptionError), match=words):
            crop_objects(source, **options)  # type: ignore[arg-type]
    with pytest.raises(zo.ArgumentError, match="source must be a path; got None"):
        crop_objects(None)  # type: ignore[arg-type]


def test_without_an_object_nothing_is_written_and_the_reasons_are_said(tmp_path: Path) -> None:
    points, row, _ = scene()
    source = boxes_file(tmp_path / "in", {"a.npy": points}, [row, {**row, "label": "Tree"}])
    out = tmp_path / "out"
    with pytest.raises(zo.DatasetError, match=r"none is left .*1 out of range, 1 of other labels"):
        crop_objects(source, out, classes={"car": "Car"}, range=(100, 200))
    assert not out.exists()
    crop_objects(source).save(str(out))
    assert len(list(out.glob("*/*.ply"))) == 2


def test_a_class_without_boxes_is_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    points, row, _ = scene()
    source = boxes_file(tmp_path, {"a.npy": points}, [row, {**row, "label": "Truck"}])
    crop_objects(source, classes={"car": "Car", "truck": "Truk", "van": "C*"})
    mistyped, taken = (record.getMessage() for record in caplog.records)
    assert "class truck has no box" in mistyped
    assert mistyped.endswith("Did you mean 'Truck'?")
    assert "class van has no box" in taken
    assert "earlier class" in taken
    assert all(record.name.startswith("zbuf_occlude") for record in caplog.records)


def middle(points: np.ndarray) -> np.ndarray:
    """Return the middle of a cloud's box."""
    return (points.min(axis=0) + points.max(axis=0)) / 2.0


def test_a_georeferenced_cloud_keeps_its_shape(tmp_path: Path) -> None:
    _, _, body = scene()
    shapes = []
    for name, shift in (("here", 0.0), ("far", np.array([5e5, 5.4e6, 100.0]))):
        (tmp_path / name / "Car").mkdir(parents=True)
        np.save(tmp_path / name / "Car" / "a.npy", body + shift)
        source = open_dataset(tmp_path / name)
        (record,) = source.take(source.order["test"])
        shapes.append(record["data"])
        assert np.allclose(record["centre"], middle(body) + shift, rtol=0.0, atol=1e-8)
    assert np.allclose(*shapes, rtol=0.0, atol=1e-6)


def test_a_row_without_its_cloud_is_named(tmp_path: Path) -> None:
    points, row, _ = scene()
    crop_objects(boxes_file(tmp_path / "in", {"a.npy": points}, [row, {**row, "label": "Bus"}]), tmp_path / "out")
    np.save(tmp_path / "out/Car/mine.npy", points)
    assert len(open_dataset(tmp_path / "out").order["test"]) == 3, "a cloud without a row has the class of its folder"
    (tmp_path / "out/Bus/a.npy-0.ply").unlink()
    with pytest.raises(zo.DatasetError, match=r"objects\.csv must list .*'Bus/a\.npy-0\.ply' is not there"):
        open_dataset(tmp_path / "out")


def test_the_folder_is_read_as_a_dataset(tmp_path: Path) -> None:
    points, row, body = scene()
    rows = [row, {**row, "label": "Bus"}]
    crop_objects(boxes_file(tmp_path / "in", {"a.npy": points}, rows), tmp_path / "out")
    table = list(csv.DictReader((tmp_path / "out/objects.csv").open()))
    assert list(table[0]) == list(FIELDS)
    assert [line["file"] for line in table] == ["Car/a.npy-0.ply", "Bus/a.npy-0.ply"]
    assert float(table[0]["range"]) == pytest.approx(np.hypot(12, 3), rel=1e-5)
    assert float(table[0]["yaw"]) == pytest.approx(30.0)
    assert int(table[0]["n_points"]) == len(body)
    source = open_dataset(tmp_path / "out")
    records = source.take(source.order["test"])
    assert [source.plan.classes[i] for i in records["label"][:, 0]] == ["Bus", "Car"]
    for cloud in records["data"]:
        assert np.allclose(np.sort(cloud, axis=0), np.sort(body - middle(body), axis=0), atol=1e-6)
        assert not np.allclose(cloud, body - middle(body), atol=1e-3), "in random order: loaders take the first n"
    assert np.allclose(records["centre"], middle(body), atol=1e-6)
    assert records["view"][:, 2] == pytest.approx(np.hypot(12, 3), rel=1e-5)
    assert source.origins == ["a.npy", "a.npy"]
    with pytest.raises(zo.DatasetError, match="must be an empty folder"):
        check_empty(tmp_path / "out")


def test_pytorch_reads_crops(tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")
    points, row, body = scene()
    crop_objects(boxes_file(tmp_path / "in", {"a.npy": points}, [row, {**row, "label": "Bus"}]), tmp_path / "out")
    clouds = zo.torch.CloudDataset(tmp_path / "out", "train", n_points=64)
    cloud, label = clouds[1]
    assert (len(clouds), clouds.classes, int(label)) == (2, ["Bus", "Car"], 1)
    away = np.linalg.norm(cloud.numpy()[:, None] - (body - middle(body))[None], axis=2).min(axis=1)
    assert away.max() < 1e-6


def write_nuscenes(root: Path, points: np.ndarray, row: dict[str, Any]) -> None:
    """Write a key frame of a turned sensor on a turned and moved car, with one box, as the schema says."""
    quarter, world = moved(yaw=-90.0, to=(0.9, 0.0, 1.8)), moved(yaw=np.degrees(0.7), to=(400.0, 1100.0, 0.0))

    def quaternion(yaw: float) -> list[float]:
        return [float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2))]

    centre = (world @ quarter @ [row["x"], row["y"], row["z"], 1.0])[:3].tolist()
    yaw = np.radians(30.0) - np.pi / 2 + 0.7
    box = {"token": "a", "sample_token": "s", "instance_token": "i", "translation": centre, "size": [1.8, 4.2, 1.5]}
    frame = {"token": "d", "sample_token": "s", "ego_pose_token": "e", "calibrated_sensor_token": "c",
             "is_key_frame": True, "filename": "samples/LIDAR_TOP/1.pcd.bin"}  # fmt: skip
    tables = {
        "sample_annotation": [{**box, "rotation": quaternion(yaw)}],
        "sample_data": [frame, {**frame, "token": "sweep", "is_key_frame": False}],
        "sensor": [{"token": "t", "channel": "LIDAR_TOP"}],
        "calibrated_sensor": [
            {"token": "c", "sensor_token": "t", "translation": [0.9, 0.0, 1.8], "rotation": quaternion(-np.pi / 2)}
        ],
        "ego_pose": [{"token": "e", "translation": [400.0, 1100.0, 0.0], "rotation": quaternion(0.7)}],
        "instance": [{"token": "i", "category_token": "k"}],
        "category": [{"token": "k", "name": "vehicle.car"}],
    }
    (root / "v1.0-mini").mkdir()
    for name, rows in tables.items():
        (root / "v1.0-mini" / f"{name}.json").write_text(json.dumps(rows))
    (root / "samples" / "LIDAR_TOP").mkdir(parents=True)
    np.column_stack([points, np.zeros((len(points), 2))]).astype("<f4").tofile(root / str(frame["filename"]))


def test_nuscenes(tmp_path: Path) -> None:
    points, row, body = scene()
    write_nuscenes(tmp_path, points, row)
    (crop,) = crop_objects(tmp_path)
    assert (crop.class_name, crop.box.track, crop.sweep) == ("vehicle.car", "i", "1")
    assert np.allclose(crop.points, body, atol=1e-4)


@pytest.mark.parametrize(
    ("table", "change", "words"),
    [
        ("ego_pose", {"rotation": [0, 0, 0, 0]}, r"ego_pose\.json must be .*it cannot be read \("),
        ("ego_pose", {"translation": "here"}, r"ego_pose\.json must be .*it cannot be read \("),
        ("ego_pose", {"token": None}, r"ego_pose\.json must have the row 'e' that sample_data\.json names"),
        ("calibrated_sensor", {"rotation": [1, 0, 0]}, r"calibrated_sensor\.json must be .*four of a rotation"),
        ("calibrated_sensor", {"token": "x"}, r"calibrated_sensor\.json must have the row 'c' that sample_data\.json"),
        ("sensor", {"token": "x"}, r"sensor\.json must have the row 't' that calibrated_sensor\.json names"),
        ("sensor", {"channel": ...}, r"/sensor\.json must be .*no 'channel'"),
        ("instance", {"token": "x"}, r"instance\.json must have the row 'i' that sample_annotation\.json names"),
        ("instance", {"category_token": ...}, r"instance\.json must be .*no 'category_token'"),
        ("category", {"token": "x"}, r"category\.json must have the row 'k' that instance\.json names"),
        ("category", {"name": ...}, r"category\.json must be .*no 'name'"),
        (
            "sample_annotation",
            {"size": [1, -2, 3]},
            r"sample_annotation\.json must be .*sides of a box must be 0 or more",
        ),
        ("sample_data", {"is_key_frame": False}, r"sample_data\.json must have a key frame of LIDAR_TOP; it has none"),
        ("sample_annotation", {"size": [1, 2]}, r"sample_annotation\.json must be .*cannot be read"),
        ("sample_annotation", {"rotation": [0, 0, 0, 0]}, r"sample_annotation\.json must be .*cannot be read"),
        ("sample_data", {"ego_pose_token": ...}, r"sample_data\.json must be .*no 'ego_pose_token'"),
        ("sample_data", {"filename": "gone.bin"}, r"gone\.bin must be there, as .*sample_data\.json says"),
        ("sample_data", {"token": ...}, r"sample_data\.json must be .*no 'token'"),
    ],
)
def test_what_is_wrong_with_a_table_of_nuscenes_names_that_table(
    tmp_path: Path, table: str, change: dict[str, Any], words: str
) -> None:
    points, row, _ = scene()
    write_nuscenes(tmp_path, points, row)
    path = tmp_path / "v1.0-mini" / f"{table}.json"
    rows = json.loads(path.read_text())
    rows[0] = {key: value for key, value in (rows[0] | change).items() if value is not ...}
    path.write_text(json.dumps(rows))
    with pytest.raises(zo.DatasetError, match=words):
        crop_objects(tmp_path)


def test_argoverse(tmp_path: Path) -> None:
    """Boxes of the sweep's own time; the sensor is on the roof, ahead of the vehicle's origin."""
    pytest.importorskip("pyarrow", reason="pyarrow is not installed: pip install 'zbuf-occlude[parquet]'")
    import pyarrow
    from pyarrow import feather

    from tests.studies.paper.drives import THINGS, write_argoverse

    crops = crop_objects(write_argoverse(tmp_path), ground=None)
    things = [thing for thing in THINGS if thing.n_points >= 16]
    assert [(crop.box.label, len(crop.points)) for crop in crops] == [(t.argoverse, t.n_points) for t in things]
    assert [crop.box.track for crop in crops] == [f"track-{number}" for number in range(4)]
    assert crops[0].range == pytest.approx(np.hypot(12.0 - 1.35, 3.0), abs=1e-6)
    assert crops[0].sweep == "log-1/315966265259836000"
    annotations = tmp_path / "val/log-1/annotations.feather"
    table = feather.read_table(annotations).to_pydict()
    table["category"] = ["BUS"] * len(table["category"])
    feather.write_feather(pyarrow.table(table), annotations)
    assert {crop.box.label for crop in crop_objects(tmp_path, ground=None)} == {"BUS"}, "read anew"
    crops.save(tmp_path / "out")
    assert (tmp_path / "out/PEDESTRIAN/log-1_315966265259836000-0.ply").exists()


def test_sydney(tmp_path: Path) -> None:
    """Its objects are cut out: every point stays, with or without --ground; two of one sweep share its name."""
    rng = np.random.default_rng(4)
    scans = {"car.0.7": rng.uniform(4, 6, (40, 3)), "car.1.7": rng.uniform(8, 9, (30, 3)), "tree.2.9": np.ones((17, 3))}
    root = write_sydney(tmp_path, scans)
    for ground in ("fit", None):
        crops = crop_objects(root, ground=ground)  # type: ignore[arg-type]
        found = [(crop.class_name, crop.sweep, len(crop.points)) for crop in crops]
        assert found == [("car", "7", 40), ("car", "7", 30), ("tree", "9", 17)]
    assert crops.layout == "Sydney Urban Objects"
    crops.save(tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out/car").iterdir()) == ["7-0.ply", "7-1.ply"]


def test_files_of_clouds(tmp_path: Path) -> None:
    """Every format has the same points; those not finite and at the origin are no returns."""
    rng = np.random.default_rng(0)
    points = rng.normal(size=(20, 3)).astype(np.float32)
    odd = np.concatenate([points, [[np.nan, 0, 0], [0, 0, 0]]]).astype(np.float32)
    np.save(tmp_path / "a.npy", odd)
    np.savez(tmp_path / "a.npz", points=odd)
    np.column_stack([odd, np.ones(22)]).astype("<f4").tofile(tmp_path / "a.bin")
    np.column_stack([odd, np.ones((22, 2))]).astype("<f4").tofile(tmp_path / "a.pcd.bin")
    structured = np.empty(22, [(axis, "<f8") for axis in "zyx"])
    for axis, column in zip("xyz", odd.T, strict=True):
        structured[axis] = column
    np.save(tmp_path / "b.npy", structured)
    for name in ("a.npy", "a.npz", "a.bin", "a.pcd.bin", "b.npy"):
        assert (read_points(tmp_path / name) == points).all(), name
    (tmp_path / "mesh.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 1\n3 0 0 0\n"
    )
    np.savez(tmp_path / "other.npz", xyz=points, time=points)
    (tmp_path / "array.npz").write_bytes((tmp_path / "a.npy").read_bytes())
    assert (read_points(tmp_path / "array.npz") == points).all()
    for name, words in (
        ("mesh.ply", "has faces"),
        ("none.npy", "No such file"),
        ("a.xyz", "must end in one of"),
        ("other.npz", "other.npz: cannot read the points: it must have an array `points`; it has xyz, time"),
    ):
        with pytest.raises(zo.DatasetError, match=words):
            read_points(tmp_path / name)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("file,label,x,y,z,length,width,height\na.npy,Car,1,2,far,4,2,1.5\n", "z in row 1 of .* must be a number"),
        ("file,label,x,y,z,length,width,height\na.npy,Car,1,2,3,-4,2,1.5\n", "length in row 1 .* from 0"),
        ("label,x,y,z,length,width,height\nCar,1,2,3,4,2,1.5\n", "file in row 1 of .* must be a line"),
        ("file,label,x,y,z,length,width,height\n ,Car,1,2,3,4,2,1.5\n", "file in row 1 of .* must not be blank"),
        (
            "file,label,x,y,z,length,width,height,heading\na.npy,Car,1,2,3,4,2,1.5,0\n",
            "has heading.* mean 'yaw'",
        ),
        ("file,label,x,y,z,length,width,high\na.npy,Car,1,2,3,4,2,1.5\n", "it has high.* mean 'height'"),
        ("file,label,x,y,z,length,width,height\nno.npy,Car,1,2,3,4,2,1.5\n", r"no\.npy: cannot read the points"),
    ],
)
def test_what_is_wrong_with_a_table(tmp_path: Path, table: str, words: str) -> None:
    (tmp_path / "boxes.csv").write_text(table)
    with pytest.raises(zo.DatasetError, match=words):
        crop_objects(tmp_path / "boxes.csv")


def test_a_sweep_that_cannot_be_read_is_named_and_the_rest_goes_on(tmp_path: Path) -> None:
    points, row, _ = scene()
    (tmp_path / "b.npy").write_bytes(b"no")
    crops = crop_objects(boxes_file(tmp_path, {"a.npy": points}, [row, {**row, "file": "b.npy"}]))
    assert (len(crops), crops.n_sweeps) == (1, 1)
    assert "b.npy: cannot read" in crops.failures[0]
