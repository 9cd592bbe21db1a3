"""`--format kitti` against boxes whose places are known: projections, shares and points by hand-written formulas."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

pytest.importorskip("PIL", reason="Pillow is not installed: pip install 'zbuf-occlude[report]'")

from PIL import Image
from scipy.spatial import ConvexHull

from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.datasets.export import convert
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.sensors.boxes import as_label
from zbuf_occlude.sensors.catalog import make
from zbuf_occlude.sensors.motion import Motion
from zbuf_occlude.sensors.scan_config import ScanConfig
from zbuf_occlude.sensors.scenes.kinds import box_mesh

CAR, PILLAR = (4.0, 1.8, 1.5), (1.0, 1.0, 2.0)
RANGE, HEIGHT = 12.0, 1.73
# x and y in the LiDAR's frame, from which the world is seen along -x: the world's are RANGE - x and -y
THINGS = {
    "pedestrian": (8.0, 0.9, 0.3),  # before the car
    "truck": (6.0, 5.0, 0.0),  # cut by the picture's left border
    "van": (-8.0, 2.0, 0.0),  # behind the car with the LiDAR
    "cyclist": (9.0, 0.9, 0.3),  # behind the pedestrian, which hides it
}
SCAN = ScanConfig(make("hdl-64e", columns=900, noise=0), range=(RANGE, RANGE), size="file", scene="ground", keep="all")
"""With a ground alone."""
Line = tuple[str, list[float]]


def plan(scan: ScanConfig, format: str = "kitti", splits: tuple[str, ...] = ("train",)) -> Plan:
    config = DatasetConfig(
        method="exact", views="ring:1@0", sample_size=None, scale="mesh", attributes=("boxes",), scan=scan
    )
    entries = [MeshEntry(f"{split}/box", "car", split, lambda: box_mesh(*CAR)) for split in splits]
    return Plan(MeshCollection(entries), config, format)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    objects = [
        {"class": name, "position": [RANGE - x, -y, 0.0], "yaw": 180 + np.degrees(turn)}
        for name, (x, y, turn) in THINGS.items()
    ]
    return scene_of(tmp_path_factory.mktemp("kitti"), PILLAR, objects).parent


def labels(path: Path) -> list[Line]:
    lines = [line.split() for line in path.read_text().splitlines()]
    return [(words[0], [float(word) for word in words[1:]]) for words in lines]


def calibration(path: Path) -> dict[str, np.ndarray]:
    rows = (line.split(":") for line in path.read_text().splitlines())
    return {name: np.array(numbers.split(), float) for name, numbers in rows}


def corners(sides: tuple[float, float, float], x: float, y: float, turn: float) -> np.ndarray:
    """Of a box on the ground, in the camera's frame: 0.27 m before the LiDAR and 0.08 m below."""
    local = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (0.0, 1.0)]) * sides
    ahead = x + local[:, 0] * np.cos(turn) - local[:, 1] * np.sin(turn)
    left = y + local[:, 0] * np.sin(turn) + local[:, 1] * np.cos(turn)
    return np.stack([-left, HEIGHT - local[:, 2] - 0.08, ahead - 0.27], axis=1)


def silhouette(points: np.ndarray) -> np.ndarray:
    """Pixels of three by three pictures whose centres lie in the hull of a box's projected corners."""
    places = 721.5377 * points[:, :2] / points[:, 2:] + [609.5593, 172.854]
    hull, found = ConvexHull(places), np.zeros((3 * 375, 3 * 1242), bool)
    left, top = np.maximum(np.floor(places.min(axis=0)), [-1242, -375]).astype(int)
    right, bottom = np.minimum(np.ceil(places.max(axis=0)), [2483, 749]).astype(int)
    rows, columns = np.mgrid[top : bottom + 1, left : right + 1]
    within = [a * columns + b * rows + c <= 0 for a, b, c in hull.equations]
    found[top + 375 : bottom + 376, left + 1242 : right + 1243] = np.all(within, axis=0)
    return found


def test_boxes_are_where_the_objects_are(made: Path) -> None:
    found = dict(labels(made / "training/label_2/000000.txt"))
    assert set(found) == {"Car", "Pedestrian", "Truck", "Cyclist"}, "what is behind the camera has no label"
    # the car's +x is its front; the world's +x points at the LiDAR, and in its frame backwards
    for name, sides, (x, y, turn) in (
        ("Car", CAR, (RANGE, 0.0, np.pi)),
        *((each.capitalize(), PILLAR, THINGS[each]) for each in ("pedestrian", "truck")),
    ):
        alpha, *rest = found[name][2:]
        assert np.allclose(rest[4:10], [sides[2], sides[1], sides[0], -y, HEIGHT - 0.08, x - 0.27], atol=1e-4)
        turned = (-turn - np.pi / 2 + np.pi) % (2 * np.pi) - np.pi
        assert rest[10] == pytest.approx(turned, abs=1e-4)
        away = alpha - turned + np.arctan2(-y, x - 0.27)
        assert np.sin(away) == pytest.approx(0.0, abs=1e-3)
        assert np.cos(away) == pytest.approx(1.0)


def test_shares_and_windows_are_those_of_the_silhouettes(made: Path) -> None:
    found = dict(labels(made / "training/label_2/000000.txt"))
    whole = {name: silhouette(corners(PILLAR, *place)) for name, place in THINGS.items() if name != "van"}
    whole["car"] = silhouette(corners(CAR, RANGE, 0.0, np.pi))
    inside = {name: pixels[375:750, 1242:2484] for name, pixels in whole.items()}
    assert 0.1 < (inside["car"] & inside["pedestrian"]).sum() / inside["car"].sum() < 0.5
    assert (inside["cyclist"] & inside["pedestrian"]).sum() / inside["cyclist"].sum() > 0.9
    assert {name: found[name][1] for name in found} == {"Car": 1, "Pedestrian": 0, "Truck": 0, "Cyclist": 3}
    for name, pixels in whole.items():
        truncated = 1 - inside[name].sum() / pixels.sum()
        assert found[name.capitalize()][0] == pytest.approx(truncated, abs=0.01)
        rows, columns = (np.flatnonzero(inside[name].any(axis=axis)) for axis in (1, 0))
        assert np.abs(found[name.capitalize()][3:7] - np.array([columns[0], rows[0], columns[-1], rows[-1]])).max() <= 1
    assert found["Truck"][0] > 0.2
    picture = np.asarray(Image.open(made / "training/image_2/000000.png"))
    assert picture.shape == (375, 1242, 3)
    assert (picture[np.any(list(inside.values()), axis=0)] > 0).all()


def test_points_lie_in_the_boxes_or_on_the_ground(made: Path) -> None:
    points = np.fromfile(made / "training/velodyne/000000.bin", "<f4").reshape(-1, 4).astype(float)
    assert ((points[:, 3] >= 0) & (points[:, 3] <= 1)).all()
    read = calibration(made / "training/calib/000000.txt")
    assert list(read) == ["P0", "P1", "P2", "P3", "R0_rect", "Tr_velo_to_cam", "Tr_imu_to_velo"]
    seen = np.column_stack([points[:, :3], np.ones(len(points))]) @ read["Tr_velo_to_cam"].reshape(3, 4).T
    above = points[:, 2] > 1e-4 - HEIGHT
    assert np.allclose(points[~above, 2], -HEIGHT, atol=1e-4)
    boxed = np.zeros(len(points), bool)
    for _, numbers in labels(made / "training/label_2/000000.txt"):
        height, width, length, x, y, z, turn = numbers[7:]
        cos, sin = np.cos(turn), np.sin(turn)
        along = (seen[:, 0] - x) * cos - (seen[:, 2] - z) * sin
        across = (seen[:, 0] - x) * sin + (seen[:, 2] - z) * cos
        mine = (abs(along) <= length / 2 + 2e-3) & (abs(across) <= width / 2 + 2e-3)
        mine &= (seen[:, 1] <= y + 1e-3) & (seen[:, 1] >= y - height - 1e-3)
        assert (mine & above).sum() > 10
        boxed |= mine
    behind = points[:, 0] < 0  # the van, which has no label
    assert (boxed | behind)[above].all()
    assert (above & behind).sum() > 20


def test_the_nose_of_a_mesh_that_is_longer_along_y_is_at_its_lower_end(tmp_path: Path) -> None:
    turned = Mesh(box_mesh(*CAR).vertices[:, [1, 0, 2]] * [-1, 1, 1], box_mesh(*CAR).faces)
    one = plan(SCAN)
    generate(replace(one, meshes=MeshCollection([replace(one.meshes[0], load=lambda: turned)])), tmp_path / "out")
    ((kind, numbers),) = labels(tmp_path / "out/training/label_2/000000.txt")
    assert (kind, numbers[7:10]) == ("Car", [1.5, 1.8, 4.0])
    assert numbers[13] == pytest.approx(np.pi, abs=1e-4)  # -y of the world is to the left: -x of the camera


def scene_of(tmp_path: Path, sides: tuple[float, float, float], objects: list[dict[str, Any]]) -> Path:
    """Return the label and velodyne files' folder of a scene of boxes, the LiDAR at RANGE along +x."""
    trimesh.Trimesh(box_mesh(*sides).vertices, box_mesh(*sides).faces, process=False).export(tmp_path / "box.off")
    found = [{"mesh": str(tmp_path / "box.off"), **each} for each in objects]
    generate(plan(replace(SCAN, scene="file", objects=found)), tmp_path / "out")
    return tmp_path / "out/training"


def test_a_box_is_where_its_moving_object_is_when_it_is_met(tmp_path: Path) -> None:
    """At 30 m/s an object goes 1.5 m until the beam, in the middle of its turn, points ahead.

    The lasers look up to 8 degrees aside: they meet it within 6 ms, in which it goes 0.2 m.
    """
    drive = {"class": "van", "position": [4.0, 2.0, 0.0], "velocity": [0.0, -30.0, 0.0]}
    folder = scene_of(tmp_path, PILLAR, [drive])
    points = np.fromfile(folder / "velodyne/000000.bin", "<f4").reshape(-1, 4)
    height, width, length, x, _, z, _ = dict(labels(folder / "label_2/000000.txt"))["Van"][7:]
    mine = (points[:, 2] > 0.05 - HEIGHT) & (points[:, 0] < 9.0) & (points[:, 0] > 6.0)
    assert (height, width, length) == (2.0, 1.0, 1.0)
    assert mine.sum() > 50
    assert abs(x + 2.0) > 0.5  # not where it is at time 0, 2 m to the right
    assert np.abs(-points[mine, 1] - x).max() < 0.5 + 0.15
    assert np.abs(points[mine, 0] - 0.27 - z).max() < 0.5 + 0.01


def test_classes_named_as_background_and_riders_have_labels(tmp_path: Path) -> None:
    names = ["wall", "ground", "room", "pole", "bicycle"]
    objects = [{"class": name, "position": [2.0, 3.0 * i - 6.0, 0.0]} for i, name in enumerate(names)]
    found = labels(scene_of(tmp_path, (0.5, 0.5, 1.8), objects) / "label_2/000000.txt")
    assert sorted(kind for kind, _ in found) == ["Car", "Cyclist", "Misc", "Misc", "Misc", "Misc"]


def test_a_class_is_cut_at_a_character() -> None:
    assert as_label("a" + "\u00e9" * 20).decode() == "a" + "\u00e9" * 15


def test_splits_and_frames_without_objects(tmp_path: Path) -> None:
    """By `convert`, of a brick so near that it is below the picture; it is scanned all the same."""
    one = plan(replace(SCAN, range=(4.0, 4.0)), "hdf5", ("train", "val", "test"))
    bricks = [replace(entry, load=lambda: box_mesh(0.3, 0.2, 0.2)) for entry in one.meshes]
    generate(replace(one, meshes=MeshCollection(bricks)), tmp_path / "stored")
    out = tmp_path / "out"
    convert(tmp_path / "stored", out, "kitti")
    lists = {path.stem: path.read_text().split() for path in (out / "ImageSets").iterdir()}
    assert lists == {"train": ["000000"], "val": ["000001"], "trainval": ["000000", "000001"], "test": ["000000"]}
    for name in ("training/label_2/000000.txt", "training/label_2/000001.txt", "testing/label_2/000000.txt"):
        ((kind, numbers),) = labels(out / name)
        assert (kind, len(numbers)) == ("DontCare", 14)
    points = np.fromfile(out / "training/velodyne/000001.bin", "<f4").reshape(-1, 4)
    assert (points[:, 2] > 0.1 - HEIGHT).any()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda plan: replace(plan.config, attributes=()), "kitti must have boxes"),
        (lambda plan: replace(plan.config, sample_size=100), "got --sample-size 100. Give --sample-size all"),
        (lambda plan: replace(plan.config, scale="cloud"), "got --scale cloud. Give --scale mesh"),
        (
            lambda plan: replace(plan.config, scan=replace(SCAN, keep="target")),
            "boxes must be of a spinning .* --keep target. Give",
        ),
        (
            lambda plan: replace(plan.config, scan=replace(SCAN, scene="none")),
            "boxes must be of a spinning .* --scene none --keep all. Give",
        ),
        (lambda plan: replace(plan.config, scan=None), "boxes must be of a spinning .* got no --sensor"),
        (lambda plan: replace(plan.config, scan=replace(SCAN, motion=Motion(turn=9.0))), "Give --deskew"),
    ],
)
def test_what_cannot_be_written(change: Callable[[Plan], DatasetConfig], words: str) -> None:
    one = plan(SCAN)
    with pytest.raises(OptionError, match=words):
        find_format("kitti").check(replace(one, config=change(one)))


def test_boxes_go_with_two_formats_alone() -> None:
    with pytest.raises(OptionError, match="boxes must go with --format hdf5 or kitti; got npz"):
        find_format("npz").check(plan(SCAN, "npz"))
