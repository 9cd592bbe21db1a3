"""`verify`: what a sound dataset says, and each way in which one can be unsound."""

import json
import re
from pathlib import Path

import h5py
import pytest
from trimesh.creation import icosphere

from tests.cli.conftest import Run, write_off
from zbuf_occlude import MeshCollection
from zbuf_occlude.datasets.counts import interval
from zbuf_occlude.datasets.folder import checksums
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.verify import verify

SMALL = "--method oracle --views ring:4@30 --points 600 --sample-size 64 --workers 1"


@pytest.fixture
def dataset(run: Run, modelnet: Path, tmp_path: Path) -> Path:
    run(f"generate {modelnet} --out out {SMALL}")
    return tmp_path / "out"


def test_a_sound_dataset(run: Run, dataset: Path, modelnet: Path) -> None:
    said = run(f"verify {dataset} {modelnet} --samples 10").out
    assert "2 files, 32 clouds read" in said
    assert "640 points tested by the oracle: 0.000% are hidden" in said
    assert "the dataset is what its manifest says" in said
    assert "not compared with the meshes" in run(f"verify {dataset}").out


def test_files_of_an_export_are_counted_to_the_last(run: Run, modelnet: Path) -> None:
    """They have no clouds of ours, of which a bar would stay at 0 %."""
    run(f"generate {modelnet} --out out --method oracle --views ring:8@30 --limit 2 --format pcn --workers 1")
    verified = run("verify out --workers 1")
    assert re.search(r"^\d+ files, checksums read$", verified.out, re.MULTILINE)
    assert re.search(r"100%.*\| (\d+)/\1 ", verified.err)
    assert "| 0/" not in verified.err


@pytest.mark.parametrize("options", ["--frame camera", "--scale mesh", "--format packed"])
def test_any_frame_scale_and_format(run: Run, modelnet: Path, options: str) -> None:
    run(f"generate {modelnet} --out out {SMALL} {options}")
    assert "points tested by the oracle: 0." in run(f"verify out {modelnet}").out


@pytest.mark.parametrize(("n_checked", "code"), [(20, 0), (37_000, 1)])
def test_no_error_among_few_pairs_promises_little(
    run: Run, modelnet: Path, tmp_path: Path, n_checked: int, code: int
) -> None:
    """Of 20 pairs of which none is wrong, up to a sixth of all may be; of 37,000 one in 10,000."""
    grid = SMALL.replace("--method oracle", "--method occupancy_grid --set n=24")
    run(f"generate {modelnet} --out out {grid}")
    path = tmp_path / "out" / "manifest.json"
    manifest = json.loads(path.read_text())
    assert 0.01 < manifest["error"]["false_visible"] < 0.15
    manifest["error"] |= {"false_visible": 0.0, "false_hidden": 0.0, "interval": interval(0, n_checked)}
    path.write_text(json.dumps(manifest))
    run(f"verify out {modelnet}", code=code)


def test_rounding_is_no_fault_where_faces_are_small(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A point of `packed` is off by up to a 131,070th of the ball: below its neighbour where that is bent away."""
    ball = icosphere(subdivisions=4)
    write_off(tmp_path / "ball.off", ball.vertices, ball.faces)
    many = "--method exact --views fibonacci:50 --points 3000 --sample-size 1024 --workers 1"
    run(f"generate ball.off --out out {many} --format packed")
    run("convert out --format npz --out again")
    monkeypatch.setattr("zbuf_occlude.datasets.verify.POINTS_PER_CLOUD", 1024)
    for folder in ("out", "again"):
        assert "points tested by the oracle: 0.000% are hidden" in run(f"verify {folder} ball.off").out


@pytest.mark.parametrize(
    ("format", "name"),
    [
        ("hdf5", "ply_data_test0.h5"),
        ("hdf5", "shape_names.txt"),
        ("hdf5", "mesh_keys.txt"),
        ("hdf5", "train_files.txt"),
        ("ply", "ply/train/ball/*.ply"),
    ],
)
def test_a_damaged_or_missing_file(run: Run, modelnet: Path, tmp_path: Path, format: str, name: str) -> None:
    run(f"generate {modelnet} --out out {SMALL} --format {format}")
    path = sorted((tmp_path / "out").glob(name))[0]
    content = bytearray(path.read_bytes())
    content[-10] ^= 1
    path.write_bytes(bytes(content))
    run(f"verify out {modelnet}", code=1, says=f"fault: {path.relative_to(tmp_path / 'out')} must have the checksum")
    path.unlink()
    missing = f"fault: {path.relative_to(tmp_path / 'out')} must be there; it is missing."
    run(f"verify out {modelnet}", code=1, says=missing)


@pytest.mark.parametrize(
    ("field", "value", "fault"),
    [
        ("data", float("nan"), "all positions must be finite; some of split train are not"),
        ("label", 7, "ply_data_train0.h5 must be as it was written; it cannot be read (label 7, where there are 2)"),
        # clouds said to be seen from the other side are hidden by the object itself
        ("pose", [[0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, -40], [0, 0, 0, 1]], "the oracle says that"),
    ],
)
def test_wrong_content(run: Run, dataset: Path, modelnet: Path, field: str, value: object, fault: str) -> None:
    """A field of the training file is changed, and its checksum with it: a fault that only its content shows."""
    with h5py.File(dataset / "ply_data_train0.h5", "r+") as h5:
        h5[field][...] = value
    manifest = json.loads((dataset / "manifest.json").read_text())
    manifest["sha256"] = checksums(dataset, manifest["sha256"])
    (dataset / "manifest.json").write_text(json.dumps(manifest))
    run(f"verify {dataset} {modelnet}", code=1, says=fault)


def test_the_wrong_meshes(run: Run, dataset: Path, modelnet: Path) -> None:
    found = run(f"verify {dataset} {modelnet}/ball", code=1, says="fault: the meshes given must have brick/")
    assert "--overwrite" not in found.out  # the dataset may be as it should


def test_a_mesh_of_other_content(run: Run, dataset: Path, modelnet: Path) -> None:
    """Of the same size, so that only its SHA-256 tells."""
    for path in modelnet.rglob("*.off"):
        path.write_bytes(path.read_bytes().replace(b"OFF\n", b"OFF ", 1))
    run(f"verify {dataset} {modelnet}", code=1, says="must have the SHA-256")


def test_an_unfinished_dataset(run: Run, dataset: Path, modelnet: Path) -> None:
    (dataset / "manifest.json").unlink()
    run(f"verify {dataset} {modelnet}", code=1, says="must hold a complete dataset")


@pytest.mark.parametrize("options", ["--up y --unit m", "--sensor kinect-v1 --range 2 --labels labels.csv"])
def test_meshes_are_read_as_the_dataset_was_made(run: Run, modelnet: Path, tmp_path: Path, options: str) -> None:
    """Up axis, unit and classes are in the plan, so nobody gives them again."""
    keys = [path.relative_to(modelnet).as_posix() for path in sorted(modelnet.rglob("*.off"))]
    (tmp_path / "labels.csv").write_text(
        "".join(f"{line}\n" for line in ["key,class", *(f"{key},chair" for key in keys)])
    )
    surface = SMALL if "--up" in options else SMALL.replace("--method oracle", "").replace("--points 600", "")
    run(f"generate {modelnet} --out out {surface} {options}")
    said = run(f"verify out {modelnet} --samples 4").out
    assert "0.000% are hidden" in said or "points scanned again: the same" in said
    run(f"verify out {modelnet} --unit in", code=1, says="fault: unit of ")


def test_a_mesh_in_another_frame_is_named(modelnet: Path, tmp_path: Path) -> None:
    config = DatasetConfig(method="oracle", views="ring:2@30", n_points=50, sample_size=8)
    generate(Plan(MeshCollection.from_paths(modelnet, unit="cm"), config), tmp_path / "out")
    faults = verify(tmp_path / "out", MeshCollection.from_paths(modelnet, up="y", unit="cm")).faults
    assert [fault.startswith("up of ") and "was z and is y" in fault for fault in faults] == [True]
    faults = verify(tmp_path / "out", MeshCollection.from_paths(modelnet)).faults
    assert [fault.startswith("unit of ") and "was cm and is none" in fault for fault in faults] == [True]
