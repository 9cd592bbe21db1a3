"""Complete clouds by `generate --complete`: the whole surface in every format, told in the manifest, verified."""

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from tests.cli.conftest import Run, write_off
from tests.scenes import box
from zbuf_occlude.datasets.folder import read_finished
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.meshes import shapes

SMALL = "--limit 2 --views ring:3@20 --points 2000 --sample-size 400 --workers 1"


def records_of(out: Path) -> Any:
    source = open_dataset(out)
    records = source.take(np.concatenate(list(source.order.values())))
    return records[np.lexsort((records["view_id"], records["mesh_id"]))]


def write_boxes(folder: Path) -> None:
    """Two classes of one box each, 2 x 1 x 1 and 1 x 1 x 4."""
    for label, sides in (("bar", (2.0, 1.0, 1.0)), ("tower", (1.0, 1.0, 4.0))):
        mesh = box(sides)
        write_off(folder / label / f"{label}.off", mesh.vertices, mesh.faces)


def shares_of_faces(record: Any) -> np.ndarray:
    return np.bincount(record["face_ids"], minlength=12) / len(record["data"])


@pytest.mark.parametrize("format", ["hdf5", "packed", "npz", "modelnet40-c"])
@pytest.mark.parametrize("scanned", [False, True])
def test_every_side_is_in_every_cloud(run: Run, tmp_path: Path, format: str, scanned: bool) -> None:
    """Shares of a box's sides are those of their areas, those turned away from the camera too."""
    names = {"bar": "car", "tower": "person"}
    for label, sides in (("bar", (2.0, 1.0, 1.0)), ("tower", (1.0, 1.0, 4.0))):
        mesh = box(sides)
        write_off(tmp_path / "meshes" / names[label] / f"{label}.off", mesh.vertices, mesh.faces)
    sensor = "--sensor vlp-16 --range 9 --size 2" if scanned else ""
    run(f"generate meshes --complete --format {format} {sensor} {SMALL} --out out")
    plan, manifest = read_finished(tmp_path / "out")
    assert plan.config.complete
    assert manifest["options"]["complete"] is True
    assert manifest["counts"]["clouds"] == 6
    assert manifest["error"]["n_checked"] == 0
    if format == "modelnet40-c":
        clouds = np.load(next((tmp_path / "out" / "train").glob("data_*_1.npy")))
        assert clouds.shape[1:] == (400, 3)
        return
    records = records_of(tmp_path / "out")
    assert len(records) == 6
    for record in records:
        wide = plan.meshes[int(record["mesh_id"])].label == "car"
        areas = np.array([1, 1, 2, 2, 2, 2]) / 10 if wide else np.array([4, 4, 4, 4, 1, 1]) / 18
        assert np.abs(shares_of_faces(record).reshape(6, 2).sum(axis=1) - areas).max() < 4 * np.sqrt(0.25 / 400)
        assert (record["n_visible"], record["visible_fraction"]) == (2000, 1.0)
        assert np.ptp(record["data"], axis=0).max() == pytest.approx(1.0, abs=1e-4)
        assert 1 / record["factor"] == pytest.approx(2.0 if wide or scanned else 4.0, rel=0.01)
    verdict = run("verify out meshes").out
    assert "points of complete clouds: on the surface, and all over it" in verdict
    assert "2400 points" in verdict


@pytest.mark.parametrize("subset", ["random", "fps"])
def test_verify_finds_clouds_that_are_not_complete(run: Run, tmp_path: Path, subset: str) -> None:
    """Visible points of an occluded dataset are put in place of complete ones, with their right checksums."""
    write_boxes(tmp_path / "meshes")
    options = f"{SMALL} --frame camera --subset {subset}"
    run(f"generate meshes --complete {options} --out whole")
    assert "on the surface, and all over it" in run("verify whole meshes").out
    run(f"generate meshes --method exact {options} --out seen")
    seen = records_of(tmp_path / "seen")
    path = next((tmp_path / "whole").glob("*.h5"))
    with h5py.File(path, "r+") as file:
        order = [(int(m), int(v)) for m, v in zip(file["mesh_id"][:], file["view_id"][:], strict=True)]
        for row, (mesh, view) in enumerate(order):
            (record,) = seen[(seen["mesh_id"] == mesh) & (seen["view_id"] == view)]
            for name in ("data", "face_ids", "centre", "factor"):
                file[name][row] = record[name]
    approve(tmp_path / "whole", path.name)
    if subset == "random":
        run("verify whole meshes", code=1, says="must be spread as the surface is; view")
    with h5py.File(path, "r+") as file:
        file["data"][0, 5] += [0.01, 0.0, 0.02]
    approve(tmp_path / "whole", path.name)
    run("verify whole meshes", code=1, says="all points must lie on their faces; one of view")


def approve(out: Path, name: str) -> None:
    """Put the checksum of a changed file into the manifest."""
    from zbuf_occlude.datasets.folder import sha256_of

    manifest = json.loads((out / "manifest.json").read_text())
    manifest["sha256"][name] = sha256_of(out / name)
    manifest["bytes"][name] = (out / name).stat().st_size
    (out / "manifest.json").write_text(json.dumps(manifest))


def test_road_users_are_known_and_in_metres(run: Run, tmp_path: Path) -> None:
    line = f"generate --shapes road-users --complete --classes pedestrian --scale mesh {SMALL} --out out"
    assert "complete clouds: nothing was removed" in run(line).out
    assert "2400 points of complete clouds: on the surface, and all over it" in run("verify out").out
    plan, _ = read_finished(tmp_path / "out")
    for record in records_of(tmp_path / "out"):
        mesh = shapes.traffic.make("pedestrian", int(plan.meshes[int(record["mesh_id"])].key.rsplit("_", 1)[1]))
        assert np.ptp(record["data"], axis=0) == pytest.approx(np.ptp(mesh.bounds, axis=0), abs=0.1)


def test_what_does_not_go_with_complete(run: Run, tmp_path: Path) -> None:
    run("generate --complete --method exact --out out", code=2, says="--method must go without --complete")
    for format in ("pcn", "pairs", "frames"):
        run(f"generate --complete --format {format} --limit 1 --out out", code=2, says="holds what views see")
    sensor = "--sensor hdl-64e --scene street --limit 1"
    for option in ("--hidden 0.2..0.4", "--keep all", "--keep-clean", "--velocity 9,0,0", "--least-points 3"):
        said = f"{option.split()[0]} must go without --complete"
        run(f"generate --complete {sensor} {option} --out out", code=2, says=said)
    boxes = f"{sensor} --with boxes"
    run(f"generate --complete {boxes} --out out", code=2, says="boxes must be of scans")
    run("generate --complete --limit 1 --dry-run --out out")
    assert not (tmp_path / "out").exists()
