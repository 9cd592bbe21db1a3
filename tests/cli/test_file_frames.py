"""--unit and --up on the command line: files in millimetres or with y up are converted, and assumptions are printed."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

import zbuf_occlude as zo
from tests.cli.conftest import Run
from tests.scenes import box, together

STOOL = together(
    box((0.4, 0.4, 0.05)).transformed(1, (0, 0, 0.425)),
    *(box((0.04, 0.04, 0.4)).transformed(1, (x, y, 0.2)) for x in (-0.15, 0.15) for y in (-0.15, 0.15)),
)
"""A mesh in metres, z up, 0.45 high."""
SMALL = "--method exact --views ring:2@30 --points 2000 --sample-size 64 --workers 1"
KINECT = "--sensor kinect-v1 --set-sensor noise=0"


@pytest.fixture
def stl(tmp_path: Path) -> Path:
    """The mesh in millimetres."""
    path = tmp_path / "gizmo.stl"
    STOOL.transformed(1000.0).to_trimesh().export(path)
    return path


@pytest.fixture
def obj(tmp_path: Path) -> Path:
    """The mesh in metres, y up."""
    path = tmp_path / "stool.obj"
    STOOL.rotated([[1, 0, 0], [0, 0, 1], [0, -1, 0]]).to_trimesh().export(path)
    return path


def points_of(path: Path) -> np.ndarray:
    table = np.load(path)
    return np.stack([table[axis] for axis in "xyz"], axis=1) if table.dtype.names else table


def test_a_range_in_metres_of_a_file_in_millimetres(run: Run, stl: Path, tmp_path: Path) -> None:
    outcome = run(f"scan {stl} {KINECT} --range 1.2 --azimuth 0 --unit mm --out scan.npy")
    assert "0.45 m long, in mm" in outcome.out
    assert "z up, assumed" in outcome.out
    found = points_of(tmp_path / "scan.npy")
    assert len(found) > 1000
    assert ((found >= STOOL.bounds[0] - 0.01) & (found <= STOOL.bounds[1] + 0.01)).all()
    assert found[:, 0].max() == pytest.approx(0.2, abs=0.01)  # the side that faces the sensor


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("--range 0.8", "'gizmo' has none. Give --size gizmo=METRES, or --size METRES for all, or the files' --unit"),
        ("--range 0.8 --size file", "half the object's 450 m; it is 0.8 m. Raise --range, or give the --unit"),
        ("--range 0.8 --size 2 --unit mm", "--unit must go without --size 2"),
        ("--range 0.2 --unit mm", "half the object's 0.45 m; it is 0.2 m"),
    ],
)
def test_errors_of_size_and_range_have_both_lengths(run: Run, stl: Path, line: str, says: str) -> None:
    run(f"scan {stl} {KINECT} {line} --out scan.npy", code=2, says=says)


def test_a_scan_that_meets_nothing_says_how_long_and_how_far(run: Run, stl: Path) -> None:
    run(f"scan {stl} {KINECT} --range 800 --size file --out scan.npy", code=1, says="450 m long and 800 m away")


def test_the_cloud_of_a_file_with_y_up(run: Run, obj: Path, tmp_path: Path) -> None:
    line = f"visible {obj} --method exact --azimuth 0 --elevation 90 --out cloud.npy"
    wrong = run(line, says="warning: the mesh seems to lie on its side")
    assert "z up, assumed" in wrong.out
    right = run(f"{line} --up y --unit m")
    assert "y up; 0.45 m long" in right.out
    assert "warning" not in right.err
    found = points_of(tmp_path / "cloud.npy")
    seat = found[:, 2] > 0.449  # legs may be seen beside the seat's edge: the camera is near
    assert seat.mean() > 0.95
    np.testing.assert_allclose(np.ptp(found[seat], axis=0), [0.4, 0.4, 0.0], atol=0.02)


def test_visible_parts_depths_and_views_have_the_unit(run: Run, stl: Path, tmp_path: Path) -> None:
    run(f"visible {stl} --unit mm --azimuth 0 --elevation 90 --out part.off")
    assert zo.load_mesh(tmp_path / "part.off").bounds[1, 2] == pytest.approx(0.45)
    assert "0.45 m long" in run(f"views {stl} --unit mm --views ring:3@0").out


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_depths_have_the_unit(run: Run, stl: Path, tmp_path: Path) -> None:
    run(f"depth {stl} --unit mm --azimuth 0 --elevation 90 --distance 4 --resolution 32 --out depth.npy")
    assert np.load(tmp_path / "depth.npy").min() == pytest.approx(4 * 0.45 - 0.225, abs=1e-4)


def test_a_dataset_says_what_was_assumed_and_warns(run: Run, obj: Path, tmp_path: Path) -> None:
    wrong = run(f"generate {obj} {SMALL} --out wrong", says="warning: the mesh seems to lie on its side")
    assert "read as   z up, assumed" in wrong.out
    right = run(f"generate {obj} {SMALL} --up y --scale mesh --out right")
    assert "warning: the mesh seems" not in right.err
    assert "read as   y up, as --up says" in right.out
    with h5py.File(next((tmp_path / "right").glob("*.h5"))) as file:
        assert file["data"][:, :, 2].max() == pytest.approx(0.45)
    assert "read as" not in run(f"generate --limit 1 {SMALL} --out shapes").out


def test_a_dataset_in_metres_is_resumed_in_its_unit_only(run: Run, stl: Path, tmp_path: Path) -> None:
    line = f"generate {stl} {SMALL} --scale mesh --out metres"
    run(f"{line} --unit mm")
    with h5py.File(next((tmp_path / "metres").glob("*.h5"))) as file:
        assert file["data"][:, :, 2].max() == pytest.approx(0.45)
    run(f"{line} --unit mm", says="")
    assert "unit of gizmo.stl was 'mm', and is 'cm'" in run(f"{line} --unit cm", code=1).err
    assert "unit of gizmo.stl was 'mm', and is ''" in run(line, code=1).err
    run(f"verify metres {stl} --workers 1")
    rows = json.loads((tmp_path / "metres" / "plan.json").read_text())["meshes"]
    assert rows == [["gizmo.stl", rows[0][1], rows[0][2], "z", "mm"]]


def test_a_dataset_of_scans_takes_sizes_from_the_unit(run: Run, stl: Path, tmp_path: Path) -> None:
    line = f"generate {stl} {KINECT} --views ring:2@20 --range 0.8 --scale mesh --frame camera --workers 1"
    run(f"{line} --sample-size 64 --unit mm --out scans")
    with h5py.File(next((tmp_path / "scans").glob("*.h5"))) as file:
        assert np.linalg.norm(file["data"][:], axis=2).max() < 0.8 + 0.35
        assert np.linalg.norm(file["data"][:], axis=2).min() > 0.8 - 0.35
    run(f"{line} --size gizmo=3 --unit mm --out both", code=2, says="--unit must go without --size")
    near = f"generate {stl} {KINECT} --range 0.1 --unit mm --out near --workers 1"
    run(near, code=1, says="half the object's 0.45 m; it is 0.1 m")


def test_without_files_there_is_no_unit(run: Run) -> None:
    run("generate --unit mm --dry-run", code=2, says="--unit must go with MESH_OR_DIR")
