"""Scans in layouts of pairs: the complete cloud is the scanned object's, where and as large as it stood."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from tests.cli.conftest import Run
from tests.pcd import read_pcd
from zbuf_occlude.meshes import shapes

SCANS = (
    "--sensor pinhole:width=40,height=30,fov=60 --method embree --limit 2 --range 4 --size airplane=2,bed=3 "
    "--set-sensor noise=0 --format pcn --scale mesh --sample-size 64 --workers 1"
)


def files_of(out: Path) -> dict[str, bytes]:
    made = {str(path.relative_to(out)): path.read_bytes() for path in out.rglob("*") if path.is_file()}
    return {name: content for name, content in made.items() if name != "manifest.json"}


@pytest.fixture
def pcn(run: Run, kept: Path) -> Path:
    """Scans as PCN has them, in metres, made once."""
    if not (kept / "pcn" / "manifest.json").exists():
        run(f"generate {SCANS} --out {kept}/pcn")
    return kept / "pcn"


def standing(key: str, size: float) -> Any:
    """An object as it stands before the sensor, by another library."""
    (entry,) = (entry for entry in shapes.collection() if entry.key == key)
    mesh = entry.load()
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    return trimesh.Trimesh((mesh.vertices - (low + high) / 2) * size / (high - low).max(), mesh.faces, process=False)


def distances(mesh: Any, points: Any) -> Any:
    """Of points from the nearest triangle, all asked."""
    asked = np.repeat(points, len(mesh.faces), axis=0)
    nearest = trimesh.triangles.closest_point(np.tile(mesh.triangles, (len(points), 1, 1)), asked)
    return np.linalg.norm(nearest - asked, axis=1).reshape(len(points), -1).min(axis=1)


def z_up(path: Path) -> Any:
    """The points of a PCD, whose y is up there, with z up."""
    return read_pcd(path).astype(float)[:, [0, 2, 1]] * [1, -1, 1]


def test_both_clouds_lie_on_the_object_as_it_stood(pcn: Path) -> None:
    keys = (pcn / "mesh_keys.txt").read_text().split()
    index = json.loads((pcn / "PCN.json").read_text())
    assert {row["taxonomy_name"] for row in index} == {"airplane", "bed"}
    for row in index:
        (split,) = (split for split in ("train", "val", "test") if row[split])
        (name,) = row[split]
        (key,) = (key for key in keys if Path(key).stem == name)
        truth = standing(key, {"airplane": 2.0, "bed": 3.0}[row["taxonomy_name"]])
        complete = z_up(pcn / split / "complete" / row["taxonomy_id"] / f"{name}.pcd")
        partials = sorted((pcn / split / "partial" / row["taxonomy_id"] / name).glob("*.pcd"))
        assert len(complete) == 16_384
        assert len(np.unique(complete, axis=0)) == 16_384
        assert len(partials) == {"train": 8}.get(split, 1)
        for points in (complete, *(z_up(path) for path in partials)):
            assert distances(truth, points[:20]).max() < 1e-4
        assert np.allclose(np.ptp(complete, axis=0), np.ptp(truth.vertices, axis=0), atol=0.15)
        # the first points are as good a sample as all of them: loaders that take fewer take the first
        assert np.allclose(complete[:2048].mean(axis=0), complete.mean(axis=0), atol=0.1)


def test_halves_and_a_damaged_one_are_the_whole(
    run: Run, pcn: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each object a shard: one is made, then damaged, then the other; the rest is made again."""
    monkeypatch.setattr("zbuf_occlude.datasets.plan.MIN_PER_SHARD", 8)
    run(f"generate {SCANS} --out halves --shard 0/2")
    archive = tmp_path / "halves" / "shards" / "packed-000000.zip"
    archive.write_bytes(archive.read_bytes()[:-10])
    run(f"generate {SCANS} --out halves --shard 1/2")
    run("merge halves", code=1)
    run(f"generate {SCANS} --out halves")
    made, expected = files_of(tmp_path / "halves"), files_of(pcn)
    for name in expected.keys() - {"plan.json"}:
        assert made[name] == expected[name], name
