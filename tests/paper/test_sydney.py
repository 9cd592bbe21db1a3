"""The Sydney reader: files written here by struct and by hand, and the published counts and folds."""

import os
import struct
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from zbuf_occlude.errors import DatasetError
from zbuf_occlude.paper import sydney

DATA = Path(os.environ.get("ZBUF_OCCLUDE_DATA", Path(__file__).parents[3] / "shared" / "data")) / "sydney"
needs_counts = pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not there; set ZBUF_OCCLUDE_DATA")


def write_bin(path: Path, points: np.ndarray) -> None:
    """Written by struct, field by field, as the dataset's description has it."""
    rows = [
        struct.pack("<qBBfffffi", 1320370833971539 + i, 52, 7, *point, 0.5, 9.25, i) for i, point in enumerate(points)
    ]
    path.write_bytes(b"".join(rows))


def write_csv(path: Path, points: np.ndarray) -> None:
    lines = [f"20111104T010203.{i:06d},52,7,{x:.6f},{y:.6f},{z:.6f},0.5,9.25,{i}" for i, (x, y, z) in enumerate(points)]
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture
def points() -> np.ndarray:
    return np.random.default_rng(0).uniform(-20, 20, (37, 3)).astype(np.float32)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Four folds of a car and a tree each, one of each pair as CSV."""
    rng = np.random.default_rng(1)
    (tmp_path / "objects").mkdir()
    (tmp_path / "folds").mkdir()
    for fold in range(4):
        names = [f"car.{fold}.10{fold}", f"tree.{fold}.20{fold}"]
        write_bin(tmp_path / "objects" / f"{names[0]}.bin", rng.uniform(0, 4, (300, 3)))
        write_csv(tmp_path / "objects" / f"{names[1]}.csv", rng.uniform(0, 4, (13, 3)))
        (tmp_path / "folds" / f"fold{fold}.txt").write_text("".join(f"{name}.bin\n" for name in names))
    return tmp_path


def test_a_record_is_34_bytes(tmp_path: Path, points: np.ndarray) -> None:
    write_bin(tmp_path / "a.bin", points)
    assert (tmp_path / "a.bin").stat().st_size == 34 * 37
    assert sydney.RECORD.itemsize == 34


def test_both_formats_give_the_same_points_with_z_up(tmp_path: Path, points: np.ndarray) -> None:
    write_bin(tmp_path / "a.bin", points)
    write_csv(tmp_path / "a.csv", points)
    binary, text = (sydney.read_scan(tmp_path / name, "-z") for name in ("a.bin", "a.csv"))
    assert binary == pytest.approx(points.astype(float) * [1, -1, -1], abs=0)
    assert (sydney.read_scan(tmp_path / "a.bin", "z") == points).all()
    assert text == pytest.approx(binary, abs=1e-6)


def test_clouds(root: Path) -> None:
    clouds = sydney.read_clouds(root, 64, "-z")
    assert [clouds.classes[i] for i in clouds.labels] == ["car", "tree"] * 4
    assert clouds.positions.shape == (8, 64, 3)
    extents = np.ptp(clouds.positions, axis=1)
    assert extents.max(axis=1) == pytest.approx(1, abs=1e-6)
    assert (clouds.positions.max(axis=1) + clouds.positions.min(axis=1)) == pytest.approx(0, abs=1e-6)
    assert np.isnan(clouds.elevations).all()
    distinct = [len(np.unique(cloud, axis=0)) for cloud in clouds.positions]
    assert distinct == [64, 13] * 4, "points repeat only where there are too few, and then all of them are there"


def test_the_archives_own_folder_is_found(root: Path, tmp_path: Path) -> None:
    above = tmp_path / "downloads"
    above.mkdir()
    (above / sydney.ARCHIVE).symlink_to(root)
    assert len(sydney.find_scans(above)) == 8


@needs_counts
def test_the_published_folds_and_counts(tmp_path: Path) -> None:
    """A dataset with every published name and number of points: what the paper counts comes out."""
    rows = [line.split("\t") for line in (DATA / "point_counts.tsv").read_text().splitlines()[1:]]
    counts = {name: int(n) for name, _, n, _ in rows}
    folds = {name: fold for name, _, _, fold in rows}
    (tmp_path / "objects").mkdir()
    (tmp_path / "folds").symlink_to(DATA / "folds")
    rng = np.random.default_rng(0)
    for name, n_points in counts.items():
        np.zeros(n_points, sydney.RECORD).tofile(tmp_path / "objects" / f"{name}.bin")
    scans = sydney.find_scans(tmp_path)
    assert len(counts) == 631
    assert len(scans) == 588
    assert Counter(scan.fold for scan in scans) == {0: 146, 1: 155, 2: 132, 3: 155}
    assert {scan.label for scan in scans} == set(sydney.CLASSES)
    assert [scan.fold for scan in scans] == [int(folds[scan.name]) for scan in scans]
    vehicles = [scan for scan in scans if scan.label in sydney.VEHICLES]
    assert len(vehicles) == 188, "the paper's number (4.4)"
    assert Counter(scan.label for scan in vehicles)["car"] == 88
    assert Counter(scan.label for scan in vehicles)["4wd"] == 21
    chosen = [scans[i] for i in rng.choice(len(scans), 20, replace=False)]
    assert [len(sydney.read_scan(scan.path, "z")) for scan in chosen] == [counts[scan.name] for scan in chosen]


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda root: (root / "folds").rename(root / "f"), r"Sydney Urban Objects dataset.*has no folds.*acfr\.usyd"),
        (lambda root: (root / "objects").rename(root / "o"), r"it has no objects. It comes from https://www\.acfr"),
        (lambda root: (root / "folds" / "fold2.txt").unlink(), r"must have fold0.txt to fold3.txt; fold2.txt is miss"),
        (lambda root: (root / "objects" / "car.3.103.bin").unlink(), r"must be in .*objects.*; car\.3\.103 is not"),
        (lambda root: (root / "folds" / "fold0.txt").write_text("tree.0.200.csv x.1.1"), "x.1.1 is not"),
        (
            lambda root: (root / "objects" / "car.0.100.bin").write_bytes(bytes(35)),
            r"car\.0\.100\.bin must be records of 34 bytes; it has 35 bytes",
        ),
        (lambda root: (root / "objects" / "tree.0.200.csv").write_text("1,2,3,x,5,6\n"), "one is not .*'x'"),
        (
            lambda root: (root / "objects" / "tree.0.200.csv").write_text("1,2,3\n"),
            "one is not .too few commas",
        ),
        (
            lambda root: (root / "objects" / "tree.0.200.csv").write_text("\n"),
            r"tree.*finite coordinates; it has no po",
        ),
        (
            lambda root: (root / "objects" / "tree.0.200.csv").write_text("1,2,3,nan,5,6,7,8,9\n"),
            "it has a coordinate that is not finite",
        ),
        (
            lambda root: (root / "objects" / "tree.0.200.csv").write_text("1,2,3,1e308,5,6,7,8,9"),
            "it has a coordinate that is not finite",
        ),
    ],
)
def test_errors(root: Path, damage, message: str) -> None:
    damage(root)
    with pytest.raises(DatasetError, match=message):
        sydney.read_clouds(root, 8, "-z")


def test_scans_are_checked_before_anything_is_trained(root: Path) -> None:
    with pytest.raises(DatasetError, match=r"have scans of 4wd, .*; they have none of 4wd, bus, truck, ute, van\."):
        sydney.check_scans(root)
    names = [f"{label}.1.1" for label in sydney.VEHICLES]
    for name in names:
        write_bin(root / "objects" / f"{name}.bin", np.ones((3, 3)))
    (root / "folds" / "fold1.txt").write_text("\r\n".join(names), encoding="utf-8-sig")
    sydney.check_scans(root)
    (root / "objects" / "ute.1.1.bin").write_bytes(bytes(33))
    with pytest.raises(DatasetError, match=r"ute\.1\.1\.bin must be records of 34 bytes; it has 33 bytes"):
        sydney.check_scans(root)
    for fold in range(4):
        (root / "folds" / f"fold{fold}.txt").write_text("")
    with pytest.raises(DatasetError, match="they have none of 4wd, bus, car, truck, ute, van"):
        sydney.check_scans(root)


def test_a_class_that_is_none(root: Path) -> None:
    write_bin(root / "objects" / "boat.1.1.bin", np.ones((3, 3)))
    (root / "folds" / "fold1.txt").write_text("boat.1.1.bin\n")
    with pytest.raises(DatasetError, match=r"boat\.1\.1 is of 'boat'"):
        sydney.find_scans(root)
