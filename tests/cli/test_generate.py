"""`generate` end to end: layout, truth of the clouds, manifest, resuming, failures, errors."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from tests.cli.conftest import Run
from zbuf_occlude import load_mesh, prepare
from zbuf_occlude.meshes.sampling import SurfacePoints

SMALL = "--method oracle --views ring:4@30 --points 600 --sample-size 64 --workers 1"


def pointnet_load(out: Path, split: str) -> tuple[np.ndarray, np.ndarray]:
    """Load as PointNet's own loaders do: a list of files, `data` and `label` of each."""
    names = [line.rstrip() for line in (out / f"{split}_files.txt").open()]
    files = [h5py.File(out / name) for name in names]
    return np.concatenate([f["data"][:] for f in files]), np.concatenate([f["label"][:] for f in files])


def manifest(out: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((out / "manifest.json").read_text())
    return document


@pytest.mark.parametrize("size", ["1_000", "+1000", " 1000"])
def test_a_sample_size_is_any_whole_number_that_python_reads(run: Run, modelnet: Path, size: str) -> None:
    outcome = run(f"generate {modelnet} --out out {SMALL} --sample-size '{size}' --dry-run")
    assert "clouds of 1000 points" in outcome.out


def test_the_main_job(run: Run, modelnet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    outcome = run(f"generate {modelnet} --out {out} {SMALL}")
    for name in ("manifest.json", "contact_sheet.png", "ply_data_test0.h5 and 1 more (train: 1, test: 1)"):
        assert str(out / name) in outcome.out
    assert "generate: 100%" in outcome.err

    data, label = pointnet_load(out, "train")
    assert (data.shape, data.dtype) == ((16, 64, 3), np.dtype("f4"))
    assert (label.shape, label.dtype) == ((16, 1), np.dtype("i8"))
    assert (out / "shape_names.txt").read_text().split() == ["ball", "brick"]
    assert set(label[:8].ravel()) == {0, 1}, "classes must be mixed within a file"
    assert np.allclose(np.ptp(data, axis=1).max(axis=1), 1, atol=1e-6), "longest side 1"
    # an occluded ball is a cap: seen from 4 diameters only (1 - 1/8) / 2 of its area
    balls = h5py.File(out / "ply_data_train0.h5")["visible_fraction"][:][label[:, 0] == 0]
    assert abs(balls.mean() - (1 - 1 / 8) / 2) < 0.02

    document = manifest(out)
    assert document["counts"]["clouds"] == 32
    assert document["counts"]["clouds_by_split"] == {"train": 16, "test": 16}
    error = document["error"]
    assert (error["false_visible"], error["false_hidden"], error["n_checked"]) == (0.0, 0.0, 8 * 4 * 600)
    assert error["interval"] == [0.0, pytest.approx(1.92e-4, rel=0.01)]
    assert (error["bad_views"], error["n_views_checked"], error["worst_view"]["share"]) == (0.0, 8 * 4, 0.0)
    assert document["renderer"] == "none"
    assert {"seed", "options", "versions", "failures", "seconds"} <= set(document)
    assert not (out / "work").exists()


def test_every_point_written_is_visible_by_the_definition(run: Run, modelnet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    run(f"generate {modelnet} --out out {SMALL} --scale mesh")
    keys = (out / "mesh_keys.txt").read_text().splitlines()
    with h5py.File(out / "ply_data_test0.h5") as h5:
        for data, face_ids, pose, mesh_id in zip(h5["data"], h5["face_ids"], h5["pose"], h5["mesh_id"], strict=True):
            mesh = load_mesh(modelnet / keys[mesh_id])
            points = SurfacePoints(data, face_ids, np.zeros_like(data))
            eye = -pose[:3, :3].T @ pose[:3, 3]
            with prepare(mesh, "oracle", contact=1e-4) as oracle:  # data is float32
                assert oracle.visible(points, eye[None]).all()


def test_another_plan_in_the_folder_is_an_error_not_a_merge(run: Run, modelnet: Path, tmp_path: Path) -> None:
    path, line = tmp_path / "out" / "ply_data_train0.h5", f"generate {modelnet} --out out {SMALL}"
    first = run(line)
    made = path.stat().st_mtime_ns, path.read_bytes()
    assert run(line).out == first.out
    refused = run(f"{line} --seed 9", code=1, says="must be empty or hold this same plan")
    assert "--overwrite" in refused.err
    assert (path.stat().st_mtime_ns, path.read_bytes()) == made
    run(f"{line} --seed 9 --overwrite")
    assert manifest(tmp_path / "out")["seed"] == 9
    assert path.read_bytes() != made[1]


def test_a_folder_with_other_files_is_left_alone(run: Run, modelnet: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("years of work")
    for option in ("", "--overwrite"):
        words = "it has other files. Choose another folder."
        run(f"generate {modelnet} --out out {SMALL} {option}", code=1, says=words)
    assert [path.name for path in out.iterdir()] == ["thesis.tex"]


def test_bad_meshes_are_named_and_the_rest_is_made(run: Run, modelnet: Path, tmp_path: Path) -> None:
    (modelnet / "brick" / "train" / "broken_7.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n")
    (modelnet / "ball" / "test" / "empty_8.off").write_text("")
    outcome = run(f"generate {modelnet} --out out {SMALL}", code=3)
    assert "2 meshes failed" in outcome.out
    assert "broken_7.off" in outcome.out
    document = manifest(tmp_path / "out")
    assert set(document["failures"]) == {"brick/train/broken_7.off", "ball/test/empty_8.off"}
    assert document["counts"]["clouds"] == 32


def test_a_folder_that_cannot_be_read_is_named_and_the_rest_is_made(
    run: Run, modelnet: Path, tmp_path: Path, lock: Callable[[Path], None]
) -> None:
    lock(modelnet / "brick" / "train")
    outcome = run(f"generate {modelnet} --out out {SMALL}", code=3)
    assert "brick/train/*: " in outcome.out
    assert manifest(tmp_path / "out")["counts"]["clouds"] == 24
    assert "brick/train/*" in manifest(tmp_path / "out")["failures"]


def test_nothing_but_bad_meshes_is_a_failure(run: Run, tmp_path: Path) -> None:
    (tmp_path / "bad.off").write_text("OFF\n")
    run(f"generate bad.off {SMALL}", code=1, says="error: at least one mesh must give a cloud; none of 1 did")


def test_fewer_points_than_asked_are_repeated_and_counted(run: Run, modelnet: Path, tmp_path: Path) -> None:
    run(f"generate {modelnet} --out out {SMALL} --points 100 --limit 2")
    counts = manifest(tmp_path / "out")["counts"]
    assert (counts["clouds_with_repeated_points"], counts["meshes"]) == (8, 2)


def test_density_counts_points_per_area_with_the_longest_side_one(run: Run, modelnet: Path, tmp_path: Path) -> None:
    run(f"generate {modelnet}/ball --out out {SMALL.replace('--points 600', '--density 500')}")
    with h5py.File(tmp_path / "out" / "ply_data_train0.h5") as h5:
        n_points = h5["n_visible"][:] / h5["visible_fraction"][:]
    assert np.allclose(n_points, 500 * np.pi, rtol=0.04)  # the area of a ball of diameter 1


def test_shares_made_one_by_one_are_the_same_dataset(
    run: Run, modelnet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zbuf_occlude.datasets.plan.MIN_PER_SHARD", 8)  # two meshes a shard
    line = f"generate {modelnet} {SMALL}"
    run(f"{line} --out whole")
    first = run(f"{line} --out parts --shard 0/2")
    assert "2 of 4 shards are this share; 2 of" in first.out
    assert first.out.endswith("zbuf-occlude merge parts\n")
    run("merge parts", code=1, says="all 4 shards; shard 1 is not done")
    status = run("status parts").out
    assert "shards      2 of 4 done" in status
    assert "the same command resumes it" in status
    monkeypatch.setenv("SLURM_ARRAY_TASK_ID", "8")
    monkeypatch.setenv("SLURM_ARRAY_TASK_COUNT", "2")
    monkeypatch.setenv("SLURM_ARRAY_TASK_MIN", "7")
    run(f"{line} --out parts")
    status = run("status parts").out
    assert "zbuf-occlude merge parts\n" in status
    assert "resumes" not in status
    merged = run("merge parts --shard 0/2 --workers 1", says="--workers is not needed")
    assert "32 clouds of 8 meshes" in merged.out
    for path in (tmp_path / "whole").glob("*.h5"):
        assert (tmp_path / "parts" / path.name).read_bytes() == path.read_bytes()
    assert "clouds read" in run("verify parts --shard 1/2 --workers 1").out


def test_dry_run_writes_nothing(run: Run, modelnet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zbuf_occlude.datasets.rehearsal.SECONDS", 60.0)
    outcome = run(f"generate {modelnet} --out out {SMALL} --dry-run")
    assert "8 meshes x 4 views x 1 variation = 32 clouds" in outcome.out
    assert re.search(r"give or take .*: 8 meshes made here took \S+ s each\n", outcome.out)
    assert not (tmp_path / "out").exists()


def test_auto_says_what_it_took_and_why(run: Run, modelnet: Path, tmp_path: Path) -> None:
    line = f"generate {modelnet} --out out {SMALL} --method auto"
    outcome = run(line)
    document = manifest(tmp_path / "out")
    options = document["options"]
    assert options["method"] in {"exact", "exact_gl"}  # with a GPU the latter
    assert "no GPU" in options["reason"] or "GPU here" in options["reason"]
    assert f"because {options['reason']}" in outcome.out
    assert document["error"]["false_visible"] == document["error"]["false_hidden"] == 0.0
    run(line)  # the choice must be the same, or the run could not be resumed
    run(f"{line} --set contact=1e-6", code=2, says="--set needs a named method; got --method auto")
