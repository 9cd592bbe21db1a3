"""Real scans: hand-made files, the published counts and folds, and the up direction."""

import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="pyarrow is not installed: pip install 'zbuf-occlude[parquet]'")

import pyarrow
from pyarrow import feather

import zbuf_occlude as zo
from tests.scenes import DATA
from tests.studies.paper.drives import THINGS, write_argoverse, write_kitti
from tests.studies.paper.hand_made import write_bin, write_csv, write_sydney
from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.datasets.real.sweeps import find_sweeps
from zbuf_occlude.datasets.real.sydney import CLASSES, RECORD, VEHICLES, find_frame, find_scans, read_scan
from zbuf_occlude.meshes import shapes
from zbuf_occlude.studies.paper.real_scans import check_scans, find_drive, picture_of_scans, read_objects, read_scans

SYDNEY = DATA / "sydney"
needs_counts = pytest.mark.skipif(not SYDNEY.is_dir(), reason=f"{SYDNEY} is not there; set ZBUF_OCCLUDE_DATA")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Four folds of a car and a tree each, the trees as CSV."""
    rng, sizes = np.random.default_rng(1), {"car.{0}.10{0}": 300, "tree.{0}.20{0}": 13}
    scans = {name.format(i): rng.uniform(0, 4, (n, 3)) for i in range(4) for name, n in sizes.items()}
    return write_sydney(tmp_path, scans)


def test_both_formats_give_the_same_points_with_z_up(tmp_path: Path) -> None:
    points = np.random.default_rng(0).uniform(-20, 20, (37, 3)).astype(np.float32)
    write_bin(tmp_path / "a.bin", points)
    write_csv(tmp_path / "a.csv", points)
    binary, text = (read_scan(tmp_path / name, "-z") for name in ("a.bin", "a.csv"))
    assert binary == pytest.approx(points.astype(float) * [1, -1, -1], abs=0)
    assert (read_scan(tmp_path / "a.bin", "z") == points).all()
    assert text == pytest.approx(binary, abs=1e-6)


def test_clouds(root: Path) -> None:
    clouds = read_scans(root, 64, "-z")
    assert [clouds.classes[i] for i in clouds.labels] == ["car", "tree"] * 4
    assert clouds.positions.shape == (8, 64, 3)
    extents = np.ptp(clouds.positions, axis=1)
    assert extents.max(axis=1) == pytest.approx(1, abs=1e-6)
    assert (clouds.positions.max(axis=1) + clouds.positions.min(axis=1)) == pytest.approx(0, abs=1e-6)
    assert np.isnan(clouds.elevations).all()
    distinct = [len(np.unique(cloud, axis=0)) for cloud in clouds.positions]
    assert distinct == [64, 13] * 4, "points repeat only where there are too few, and then all of them are there"


@needs_counts
def test_the_published_folds_and_counts(tmp_path: Path) -> None:
    """A dataset with all published names and numbers of points has the counts of the paper."""
    rows = [line.split("\t") for line in (SYDNEY / "point_counts.tsv").read_text().splitlines()[1:]]
    counts = {name: int(n) for name, _, n, _ in rows}
    folds = {name: fold for name, _, _, fold in rows}
    (tmp_path / "objects").mkdir()
    (tmp_path / "folds").symlink_to(SYDNEY / "folds")
    rng = np.random.default_rng(0)
    for name, n_points in counts.items():
        np.zeros(n_points, RECORD).tofile(tmp_path / "objects" / f"{name}.bin")
    scans = find_scans(tmp_path)
    assert len(counts) == 631
    assert len(scans) == 588
    assert Counter(scan.fold for scan in scans) == {0: 146, 1: 155, 2: 132, 3: 155}
    assert {scan.class_name for scan in scans} == set(CLASSES)
    assert [scan.fold for scan in scans] == [int(folds[scan.name]) for scan in scans]
    vehicles = [scan for scan in scans if scan.class_name in VEHICLES]
    assert len(vehicles) == 188, "the paper's number (4.4)"
    assert Counter(scan.class_name for scan in vehicles)["car"] == 88
    assert Counter(scan.class_name for scan in vehicles)["4wd"] == 21
    chosen = [scans[i] for i in rng.choice(len(scans), 20, replace=False)]
    assert [len(read_scan(scan.path, "z")) for scan in chosen] == [counts[scan.name] for scan in chosen]


TREE = "objects/tree.0.200.csv"


@pytest.mark.parametrize(
    ("place", "content", "message"),
    [
        ("folds", None, r"Sydney Urban Objects dataset.*has no folds.*acfr\.usyd"),
        ("objects", None, r"it has no objects. It comes from https://www\.acfr"),
        ("folds/fold2.txt", None, r"must have fold0.txt to fold3.txt; fold2.txt is miss"),
        ("objects/car.3.103.bin", None, r"must be in .*objects.*; car\.3\.103 is not"),
        ("folds/fold0.txt", b"tree.0.200.csv x.1.1", "x.1.1 is not"),
        ("folds/fold1.txt", b"boat.1.1.bin", r"boat\.1\.1 is not"),
        ("objects/car.0.100.bin", bytes(35), r"car\.0\.100\.bin must be records of 34 bytes; it has 35 bytes"),
        (TREE, b"1,2,3,x,5,6\n", "one is not .*'x'"),
        (TREE, b"1,2,3\n", "one is not .too few commas"),
        (TREE, b"\n", r"tree.*finite coordinates; it has no po"),
        (TREE, b"1,2,3,nan,5,6,7,8,9\n", "it has a coordinate that is not finite"),
        (TREE, b"1,2,3,1e308,5,6,7,8,9", "it has a coordinate that is not finite"),
    ],
)
def test_what_is_wrong_with_the_archive(root: Path, place: str, content: bytes | None, message: str) -> None:
    damage(root / place, content)
    with pytest.raises(DatasetError, match=message):
        read_scans(root, 8, "-z")


def damage(path: Path, content: bytes | None) -> None:
    """Change the content of a file, or remove a file or folder."""
    if content is None:
        path.rename(path.with_name("elsewhere"))
    else:
        path.write_bytes(content)


def test_scans_are_checked_before_anything_is_trained(root: Path) -> None:
    with pytest.raises(DatasetError, match=r"have scans of 4wd, .*; they have none of 4wd, bus, truck, ute, van\."):
        check_scans(root)
    names = [f"{label}.1.1" for label in VEHICLES]
    for name in names:
        write_bin(root / "objects" / f"{name}.bin", np.ones((3, 3)))
    (root / "folds" / "fold1.txt").write_text("\r\n".join(names), encoding="utf-8-sig")
    check_scans(root)
    (root / "objects" / "ute.1.1.bin").write_bytes(bytes(33))
    with pytest.raises(DatasetError, match=r"ute\.1\.1\.bin must be records of 34 bytes; it has 33 bytes"):
        check_scans(root)
    for fold in range(4):
        (root / "folds" / f"fold{fold}.txt").write_text("")
    with pytest.raises(DatasetError, match="they have none of 4wd, bus, car, truck, ute, van"):
        check_scans(root)


# ---- which way is up -------------------------------------------------------------------------------------------------

N_CARS = 10


@pytest.fixture(scope="module")
def cars() -> list[np.ndarray]:
    """Return scans of cars 4.5 m long at 8 to 26 m, by a scanner 1.9 m above the ground; metres, z up."""
    scans, sensor = [], zo.sensors.make("hdl-64e", columns=900)
    for number in range(N_CARS):
        mesh = shapes.make("car", number).normalized()
        mesh = zo.Mesh(mesh.vertices * 4.5, mesh.faces)
        azimuth, distance = 0.6 * number, 8.0 + 2 * number
        at = distance * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        at[2] = mesh.bounds[0, 2] + 1.9
        scan = zo.scan(mesh, sensor, zo.sensors.look_at(at, [0, 0, at[2]]), seed=number)
        scans.append(scan.positions.astype(np.float64) - at)
    return scans


def signs() -> list[np.ndarray]:
    """Return a plate on a pole, z up."""
    rng = np.random.default_rng(0)
    pole = np.column_stack([rng.normal(0, 0.03, (60, 2)), rng.uniform(0, 2.0, 60)])
    plate = np.column_stack([rng.uniform(-0.5, 0.5, 80), rng.normal(0, 0.02, 80), rng.uniform(2.0, 2.8, 80)])
    return [np.concatenate([pole, plate])] * 6


def write(root: Path, scans: dict[str, list[np.ndarray]]) -> Path:
    return write_sydney(root, {f"{label}.{i}.1": points for label, of in scans.items() for i, points in enumerate(of)})


def test_the_frame_is_found_and_scans_are_turned_by_it(tmp_path: Path, cars: list[np.ndarray]) -> None:
    upright = write(tmp_path / "z", {"car": cars, "traffic_sign": signs()})
    turned = write(tmp_path / "-z", {"car": [p * [1, -1, -1] for p in cars], "traffic_sign": signs()})
    assert find_frame(find_scans(upright)).up == "z"
    assert "z of the files is up, found from the scans" in find_frame(find_scans(upright)).said
    assert "0 trees, signs and lights if -z is up, 6 if z is" in find_frame(find_scans(turned)).said, (
        "they contradict each other"
    )
    down = write(tmp_path / "down", {"car": [p * [1, -1, -1] for p in cars]})
    frame = find_frame(find_scans(down))
    assert frame.up == "-z"
    one, other = (read_scans(root, 64, find_frame(find_scans(root)).up) for root in (upright, down))
    both = one.labels == CLASSES.index("car")
    assert np.abs(one.positions[both] - other.positions).max() < 1e-4
    picture_of_scans(down, frame.up).savefig(tmp_path / "scans.png")
    assert (tmp_path / "scans.png").stat().st_size > 2_000


def test_what_says_nothing_is_assumed(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    frame = find_frame(find_scans(write(tmp_path, {"car": [rng.uniform(0, 2, (100, 3)) for _ in range(8)]})))
    assert frame.up == "-z"
    assert "-z of the files is up, assumed" in frame.said


# ---- real drives -----------------------------------------------------------------------------------------------------

WRITERS = {"KITTI": write_kitti, "Argoverse 2": write_argoverse}


@pytest.fixture(params=WRITERS)
def drive(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, Path]:
    """A drive in one of the layouts: the layout's name, its folder."""
    return request.param, WRITERS[request.param](tmp_path / "drive")


def test_boxes_are_where_the_things_are(drive: tuple[str, Path]) -> None:
    name, root = drive
    layout, loaders = find_sweeps(root)
    assert layout.name == name
    sweep = loaders[0]()
    assert [box.label for box in sweep.boxes] == [t.kitti if name == "KITTI" else t.argoverse for t in THINGS]
    for thing, box in zip(THINGS, sweep.boxes, strict=True):
        assert np.allclose(box.centre, thing.middle, atol=1e-5)
        assert np.allclose(box.size, thing.sides, atol=1e-6)
        assert np.allclose(box.rotation @ box.rotation.T, np.eye(3), atol=1e-5)
        assert np.linalg.det(box.rotation) == pytest.approx(1.0, abs=1e-5)
        assert np.allclose(box.rotation[:, 0], [np.cos(thing.yaw), np.sin(thing.yaw), 0.0], atol=1e-5)
        assert np.allclose(box.rotation[:, 2], [0.0, 0.0, 1.0], atol=1e-5)
        assert box.contains(sweep.points).sum() == thing.n_points


def test_clouds_are_what_lies_in_boxes_that_have_points_enough(drive: tuple[str, Path]) -> None:
    clouds = read_objects(drive[1], 128)
    assert clouds.classes == ("car", "other")
    assert clouds.labels.tolist() == [0, 0, 1], "car, van, pedestrian; the truck is neither, the cyclist has too few"
    assert clouds.positions.shape == (3, 128, 3)
    assert np.ptp(clouds.positions, axis=1).max(axis=1) == pytest.approx(1.0, abs=1e-6)
    for positions, thing in zip(clouds.positions, THINGS[:3], strict=True):
        assert len(np.unique(positions, axis=0)) == thing.n_points


LABEL, CALIB = "training/label_2/000007.txt", "training/calib/000007.txt"
SWEEP = "val/log-1/sensors/lidar/315966265259836000.feather"


@pytest.mark.parametrize(
    ("place", "content", "message"),
    [
        (LABEL, b"Car 0 0 0 1 2 3 4 five 1 1 0 0 0 0\n", "must have 15 fields per line, .* line 1 is 'Car 0 0 0"),
        (LABEL, b"Car 0 0 0 1 2 3 4 inf 1 1 0 0 0 inf\n", "from the 9th on numbers; line 1 is 'Car 0 0 0 1 2 3 4 inf"),
        (LABEL, b"Car 0 0 0 1 2 3 4 -1.5 1 1 0 0 0 0\n", r"sides of a box must be 0 or more.* \[1\.0, 1\.0, -1\.5\]"),
        (LABEL, None, "must have its label_2/000007.txt; it is missing"),
        ("training/velodyne/000007.bin", bytes(1001), "must hold 4 float32 numbers per point; it has 1001 bytes"),
        ("training/velodyne/000007.bin", b"", "must have points; it has none"),
        (CALIB, b"Tr_velo_to_cam: " + b"0 " * 12, "must have R0_rect; it does not"),
        (CALIB, b"R0_rect: 1 0 0\n", "R0_rect in .* must be 9 numbers; it is '1 0 0'"),
        (CALIB, b"R0_rect: " + b"0 " * 9 + b"\nTr_velo_to_cam: " + b"0 " * 12, "must be rotations"),
        (SWEEP, b"ARROW1", "must be a feather file; it cannot be read"),
        (SWEEP, {"x": [1.0]}, "must have the columns x, y, z; it lacks one"),
        (SWEEP, {"x": ["far"], "y": ["far"], "z": ["far"]}, "cannot be read .could not convert string to float: 'far'"),
        (SWEEP, None, "must have a car with 16 points; it has none"),
    ],
)
def test_what_is_wrong_with_a_drive(place: str, content: object, message: str, tmp_path: Path) -> None:
    root = (write_argoverse if place == SWEEP else write_kitti)(tmp_path / "drive")
    if isinstance(content, dict):
        feather.write_feather(pyarrow.table(content), root / place)
    elif content is None:
        (root / place).unlink()
    else:
        (root / place).write_bytes(content)
    with pytest.raises(DatasetError, match=message):
        read_objects(root, 1)


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("training/label_2", "training must have KITTI's folders velodyne, label_2, calib; it lacks label_2"),
        ("training/calib", "it lacks calib"),
        ("training/velodyne/*", "velodyne must hold a .bin file per sweep; it has none"),
    ],
)
def test_what_a_drive_of_kitti_lacks_is_named(place: str, message: str, tmp_path: Path) -> None:
    root = write_kitti(tmp_path / "drive")
    for path in root.glob(place):
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    with pytest.raises(DatasetError, match=message):
        read_objects(root, 1)


def test_sweeps_and_boxes_that_say_nothing(tmp_path: Path) -> None:
    root = write_argoverse(tmp_path / "drive")
    (root / SWEEP).rename((root / SWEEP).with_stem("first"))
    with pytest.raises(DatasetError, match="must be named TIMESTAMP"):
        read_objects(root, 1)
    root = write_argoverse(tmp_path / "other")
    boxes = root / "val/log-1/annotations.feather"
    table = feather.read_table(boxes)
    nothing = pyarrow.array([None] * len(table), pyarrow.float64())
    feather.write_feather(table.set_column(table.column_names.index("length_m"), "length_m", nothing), boxes)
    with pytest.raises(DatasetError, match=r"annotations.feather must be finite numbers; that of row 0 is not"):
        read_objects(root, 1)
    negative = pyarrow.array([-1.0] * len(table))
    feather.write_feather(table.set_column(table.column_names.index("length_m"), "length_m", negative), boxes)
    with pytest.raises(DatasetError, match=r"row 0 of .*sides of a box must be 0 or more"):
        read_objects(root, 1)


def test_folders_that_are_no_drive_or_have_no_car(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"one of these layouts: KITTI \(velodyne.*Argoverse 2 \(.*none of them"):
        find_drive(tmp_path)
    with pytest.raises(DatasetError, match="does not exist"):
        find_drive(tmp_path / "no")
    (tmp_path / "objects").mkdir()
    write_bin(tmp_path / "objects" / "car.0.1.bin", np.ones((3, 3)))
    with pytest.raises(DatasetError, match=r"layout of KITTI or Argoverse 2; .* is Sydney Urban Objects"):
        find_drive(tmp_path)
    root = write_kitti(tmp_path / "drive")
    lines = (root / LABEL).read_text().splitlines()
    (root / LABEL).write_text("\n".join(line for line in lines if line.startswith("Pedestrian")))
    with pytest.raises(DatasetError, match="must have a car with 16 points; it has none"):
        read_objects(root, 32)
