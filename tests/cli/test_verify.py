"""`verify`: what a sound dataset says, and each way in which one can be unsound."""

import json
from pathlib import Path

import h5py
import pytest
from trimesh.creation import icosphere

from tests.cli.conftest import Run, write_off
from zbuf_occlude.dataset.folder import checksums

SMALL = ("--method", "oracle", "--views", "ring:4@30", "--points", 600, "--sample-size", 64, "--workers", 1)


@pytest.fixture
def dataset(run: Run, modelnet: Path, tmp_path: Path) -> Path:
    out = tmp_path / "out"
    assert run("generate", modelnet, "--out", out, *SMALL).code == 0
    return out


def change(dataset: Path, field: str, value: object) -> None:
    """Change a field of the training file, and its checksum with it: a fault that only its content shows."""
    with h5py.File(dataset / "ply_data_train0.h5", "r+") as h5:
        h5[field][...] = value
    manifest = json.loads((dataset / "manifest.json").read_text())
    manifest["sha256"] = checksums(dataset, manifest["sha256"])
    (dataset / "manifest.json").write_text(json.dumps(manifest))


def test_a_sound_dataset(run: Run, dataset: Path, modelnet: Path) -> None:
    outcome = run("verify", dataset, modelnet, "--samples", 10)
    assert outcome.code == 0, outcome.err
    assert "2 files, 32 clouds read" in outcome.out
    assert "640 points asked of the oracle: 0.000% are hidden" in outcome.out
    assert "the dataset is what its manifest says" in outcome.out


@pytest.mark.parametrize("arguments", [("--frame", "camera"), ("--scale", "mesh"), ("--format", "packed")])
def test_any_frame_scale_and_format(run: Run, modelnet: Path, tmp_path: Path, arguments: tuple[str, str]) -> None:
    out = tmp_path / "out"
    assert run("generate", modelnet, "--out", out, *SMALL, *arguments).code == 0
    outcome = run("verify", out, modelnet)
    assert outcome.code == 0, outcome.err
    assert "points asked of the oracle: 0." in outcome.out


def test_rounding_is_no_fault_where_faces_are_small(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A point of `packed` is off by up to a 131,070th of the ball: below its neighbour where that is bent away."""
    ball = icosphere(subdivisions=4)
    mesh = write_off(tmp_path / "ball.off", ball.vertices, ball.faces)
    out, again = tmp_path / "out", tmp_path / "again"
    many = ("--method", "exact", "--views", "fibonacci:50", "--points", 3000, "--sample-size", 1024, "--workers", 1)
    assert run("generate", mesh, "--out", out, *many, "--format", "packed").code == 0
    assert run("convert", out, "--format", "npz", "--out", again).code == 0
    monkeypatch.setattr("zbuf_occlude.dataset.verify.POINTS_PER_CLOUD", 1024)
    for folder in (out, again):
        assert "points asked of the oracle: 0.000% are hidden" in run("verify", folder, mesh).out


def test_without_meshes_the_oracle_is_left_out_and_said_so(run: Run, dataset: Path) -> None:
    outcome = run("verify", dataset)
    assert outcome.code == 0
    assert "not asked of the oracle" in outcome.out


def test_a_damaged_file(run: Run, dataset: Path, modelnet: Path) -> None:
    path = dataset / "ply_data_test0.h5"
    content = bytearray(path.read_bytes())
    content[-100] ^= 1
    path.write_bytes(bytes(content))
    outcome = run("verify", dataset, modelnet)
    assert outcome.code == 1
    assert "fault: ply_data_test0.h5 must have the checksum" in outcome.err


@pytest.mark.parametrize("name", ["shape_names.txt", "mesh_keys.txt", "train_files.txt"])
def test_names_and_lists_are_verified_too(run: Run, dataset: Path, name: str) -> None:
    content = (dataset / name).read_text()
    (dataset / name).write_text(content.replace("a", "b"))
    outcome = run("verify", dataset)
    assert (outcome.code, f"fault: {name} must have the checksum" in outcome.err) == (1, True)
    (dataset / name).unlink()
    outcome = run("verify", dataset)
    assert (outcome.code, f"fault: {name} must be there; it is missing." in outcome.err) == (1, True)


def test_a_missing_file(run: Run, dataset: Path, modelnet: Path) -> None:
    (dataset / "ply_data_test0.h5").unlink()
    outcome = run("verify", dataset, modelnet)
    assert (outcome.code, "fault: ply_data_test0.h5 must be there; it is missing." in outcome.err) == (1, True)


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
    change(dataset, field, value)
    outcome = run("verify", dataset, modelnet)
    assert outcome.code == 1, outcome.out
    assert fault in outcome.err


def test_the_wrong_meshes(run: Run, dataset: Path, modelnet: Path) -> None:
    outcome = run("verify", dataset, modelnet / "ball")
    assert outcome.code == 1
    assert "fault: the meshes given must have brick/" in outcome.err


def test_an_unfinished_dataset(run: Run, dataset: Path, modelnet: Path) -> None:
    (dataset / "manifest.json").unlink()
    outcome = run("verify", dataset, modelnet)
    assert outcome.code == 1
    assert "must hold a complete dataset" in outcome.err


def test_a_damaged_or_missing_cloud_of_the_many_of_a_list(run: Run, modelnet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run("generate", modelnet, "--out", out, *SMALL, "--format", "ply").code == 0
    cloud = sorted(out.glob("ply/train/*/*.ply"))[0]
    content = bytearray(cloud.read_bytes())
    content[-10] ^= 1
    cloud.write_bytes(bytes(content))
    outcome = run("verify", out)
    assert outcome.code == 1
    assert "must have the checksum" in outcome.err
    cloud.unlink()
    outcome = run("verify", out)
    assert outcome.code == 1
    assert f"{cloud.relative_to(out)} must be there; it is missing." in outcome.err
