"""Objects of real drives: read back out of files in KITTI's and Argoverse 2's layouts, and what is wrong in a line."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")
pytest.importorskip("pyarrow", reason="pyarrow is not installed: pip install 'zbuf-occlude[parquet]'")

import pyarrow
from pyarrow import feather

from tests.paper.drives import THINGS, points_in, write_argoverse, write_kitti
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.paper import drives as crops
from zbuf_occlude.paper.drives import Box, layout_of, read_clouds

WRITERS = {"KITTI": write_kitti, "Argoverse 2": write_argoverse}


@pytest.fixture(params=WRITERS)
def drive(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, Path]:
    """A drive in one of the layouts: the layout's name, its folder."""
    return request.param, WRITERS[request.param](tmp_path / "drive")


def test_boxes_are_where_the_things_are(drive: tuple[str, Path]) -> None:
    name, root = drive
    layout = layout_of(root)
    assert layout.name == name
    sweep = layout.read(layout.find(root)[0])
    assert [box.label for box in sweep.boxes] == [t.kitti if name == "KITTI" else t.argoverse for t in THINGS]
    for thing, box in zip(THINGS, sweep.boxes, strict=True):
        assert np.allclose(box.centre, thing.middle, atol=1e-5)
        assert np.allclose(box.size, thing.sides, atol=1e-6)
        assert np.allclose(box.rotation @ box.rotation.T, np.eye(3), atol=1e-5)
        assert np.linalg.det(box.rotation) == pytest.approx(1.0, abs=1e-5)
        assert np.allclose(box.rotation[:, 0], [np.cos(thing.yaw), np.sin(thing.yaw), 0.0], atol=1e-5)
        assert np.allclose(box.rotation[:, 2], [0.0, 0.0, 1.0], atol=1e-5)
        assert box.holds(sweep.points).sum() == thing.n_points


def test_clouds_are_what_lies_in_boxes_that_have_points_enough(drive: tuple[str, Path]) -> None:
    clouds = read_clouds(drive[1], 128)
    assert clouds.classes == ("car", "other")
    assert clouds.labels.tolist() == [0, 0, 1], "car, van, pedestrian; the truck is neither, the cyclist has too few"
    assert clouds.positions.shape == (3, 128, 3)
    assert np.ptp(clouds.positions, axis=1).max(axis=1) == pytest.approx(1.0, abs=1e-6)
    for positions, thing in zip(clouds.positions, THINGS[:3], strict=True):
        assert len(np.unique(positions, axis=0)) == thing.n_points
    again = read_clouds(drive[1], 128)
    assert (again.positions == clouds.positions).all(), "seeded"


def test_a_long_drive_is_read_evenly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = write_kitti(tmp_path / "drive")
    for number in range(8, 17):
        for folder, suffix in (("velodyne", "bin"), ("label_2", "txt"), ("calib", "txt")):
            first = root / "training" / folder / f"000007.{suffix}"
            first.with_stem(f"{number:06d}").write_bytes(first.read_bytes())
    assert len(read_clouds(root, 16)) == 30
    monkeypatch.setattr(crops, "MOST_SWEEPS", 4)
    assert len(read_clouds(root, 16)) == 12


def test_a_box_holds_its_sides_and_no_more() -> None:
    box = Box("Car", np.array([1.0, 2.0, 3.0]), np.eye(3), np.array([4.0, 2.0, 1.0]))
    points = np.array([[3.0, 2.0, 3.0], [3.001, 2.0, 3.0], [1.0, 1.0, 3.5], [1.0, 0.99, 3.0], [np.nan, 2.0, 3.0]])
    assert box.holds(points).tolist() == [True, False, True, False, False]
    assert box.holds(points_in(THINGS[0])).sum() == 0


def damage_label(root: Path) -> None:
    (root / "training/label_2/000007.txt").write_text("Car 0 0 0 1 2 3 4 five 1 1 0 0 0 0\n")


def cut_points(root: Path) -> None:
    path = root / "training/velodyne/000007.bin"
    path.write_bytes(path.read_bytes()[:-3])


def no_rotation(root: Path) -> None:
    path = root / "training/calib/000007.txt"
    path.write_text("\n".join(line for line in path.read_text().splitlines() if not line.startswith("R0_rect")))


def short_matrix(root: Path) -> None:
    (root / "training/calib/000007.txt").write_text("R0_rect: 1 0 0\n")


def zero_matrix(root: Path) -> None:
    lines = ["R0_rect: " + "0 " * 9, "Tr_velo_to_cam: " + "0 " * 12]
    (root / "training/calib/000007.txt").write_text("\n".join(lines))


def no_label(root: Path) -> None:
    (root / "training/label_2/000007.txt").unlink()


def cut_feather(root: Path) -> None:
    path = next((root / "val/log-1/sensors/lidar").iterdir())
    path.write_bytes(path.read_bytes()[:100])


def odd_name(root: Path) -> None:
    path = next((root / "val/log-1/sensors/lidar").iterdir())
    path.rename(path.with_stem("first"))


def other_columns(root: Path) -> None:
    path = next((root / "val/log-1/sensors/lidar").iterdir())
    path.write_bytes((root / "val/log-1/annotations.feather").read_bytes())


def endless_label(root: Path) -> None:
    (root / "training/label_2/000007.txt").write_text("Car 0 0 0 1 2 3 4 inf 1 1 0 0 0 inf\n")


def words_for_numbers(root: Path) -> None:
    path = next((root / "val/log-1/sensors/lidar").iterdir())
    feather.write_feather(pyarrow.table({name: ["far"] for name in "xyz"}), path)


def box_of_no_numbers(root: Path) -> None:
    path = root / "val/log-1/annotations.feather"
    table = feather.read_table(path)
    nothing = pyarrow.array([None] * len(table), pyarrow.float64())
    feather.write_feather(table.set_column(table.column_names.index("length_m"), "length_m", nothing), path)


def no_sweep(root: Path) -> None:
    next((root / "val/log-1/sensors/lidar").iterdir()).unlink()


@pytest.mark.parametrize(
    ("write", "damage", "message"),
    [
        (write_kitti, damage_label, "must have 15 fields per line, from the 9th on numbers; line 1 is 'Car 0 0 0"),
        (write_kitti, cut_points, "must be records of four float32"),
        (write_kitti, no_rotation, "must have R0_rect; it has not"),
        (write_kitti, short_matrix, "R0_rect in .* must be \\(3, 3\\) numbers; it is ' 1 0 0'"),
        (write_kitti, zero_matrix, "must be rotations"),
        (write_kitti, no_label, "must have its label_2/000007.txt; it is missing"),
        (write_argoverse, cut_feather, "must be a feather file; it cannot be read"),
        (write_argoverse, odd_name, "must be called TIMESTAMP.feather"),
        (write_argoverse, other_columns, "must have the columns x, y, z; it lacks one"),
        (write_argoverse, no_sweep, "or has no sweep"),
        (write_kitti, endless_label, "from the 9th on numbers; line 1 is 'Car 0 0 0 1 2 3 4 inf"),
        (write_argoverse, words_for_numbers, "cannot be read .could not convert string to float: 'far'"),
        (write_argoverse, box_of_no_numbers, "annotations.feather must be numbers; that of row 0 has others"),
    ],
)
def test_what_is_wrong_is_said(
    write: Callable[[Path], Path], damage: Callable[[Path], None], message: str, tmp_path: Path
) -> None:
    root = write(tmp_path / "drive")
    damage(root)
    with pytest.raises(DatasetError, match=message):
        read_clouds(root, 1)


def test_damage_in_a_later_sweep_is_known_too(tmp_path: Path) -> None:
    root = write_kitti(tmp_path / "drive")
    for folder, ending in (("velodyne", "bin"), ("label_2", "txt"), ("calib", "txt")):
        shutil.copy(root / f"training/{folder}/000007.{ending}", root / f"training/{folder}/000008.{ending}")
    read_clouds(root, 1)
    os.truncate(root / "training/velodyne" / "000008.bin", 1_001)
    with pytest.raises(DatasetError, match=r"000008\.bin must be records of four float32"):
        read_clouds(root, 1)


def test_a_folder_in_no_layout(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"in KITTI's layout \(velodyne.*Argoverse 2's.*is neither"):
        layout_of(tmp_path)
    with pytest.raises(DatasetError, match="is not there"):
        layout_of(tmp_path / "no")


def test_a_drive_without_cars(tmp_path: Path) -> None:
    root = write_kitti(tmp_path / "drive")
    label = root / "training/label_2/000007.txt"
    label.write_text("\n".join(line for line in label.read_text().splitlines() if line.startswith("Pedestrian")))
    with pytest.raises(DatasetError, match="must have a car with 16 points; it has none"):
        read_clouds(root, 32)
