"""Pairs for registration: overlaps against nearest neighbours, motions against the points that both clouds have."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import box, sphere
from zbuf_occlude import DatasetError, Mesh, OptionError, sensors
from zbuf_occlude.datasets.export import convert
from zbuf_occlude.datasets.export.registration import MATCHED, choose_pairs
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.meshes.shapes import make
from zbuf_occlude.sensors.scan_config import ScanConfig

SIZE = 2048


def plan(*meshes: Mesh, **changed: Any) -> Plan:
    entries = [
        MeshEntry(f"m{i}", "thing", "train" if i % 2 == 0 else "test", lambda m=m: m) for i, m in enumerate(meshes)
    ]
    given = {"views": "fibonacci:16", "n_points": 20_000, "sample_size": SIZE, "overlap": (0.3, 0.7), **changed}
    config = DatasetConfig(method="exact", **given)
    return Plan(MeshCollection(entries), find_format("pairs").redrawn(config), "pairs")


def read(path: Path) -> dict[str, Any]:
    with h5py.File(path) as h5:
        found = {name: h5[name][()] for name in h5 if name != "match_id"}
        return {**found, "match_id": [h5["match_id"][str(i)][()] for i in range(len(h5["match_id"]))]}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    out = tmp_path_factory.mktemp("pairs")
    generate(plan(make("bottle", 1), box((1.0, 2.0, 4.0)), make("car", 2)), out)
    return out, read(out / "MVP_Train_RG.h5")


def test_the_motion_takes_one_cloud_onto_the_other(made: tuple[Path, dict[str, Any]]) -> None:
    out, _ = made
    for name in ("MVP_Train_RG.h5", "MVP_Test_RG.h5"):
        rows = read(out / name)
        assert len(rows["overlap"]) == 16 * (2 if "Train" in name else 1)
        for i, transform in enumerate(rows["transforms"]):
            mine, theirs = rows["match_id"][i].T
            assert len(mine) > 10
            assert np.array_equal(rows["src"][i][mine], rows["tgt"][i][theirs]), "both lie in the object's frame"
            moved = rows["rotated_src"][i][mine] @ transform[:3, :3].T + transform[:3, 3]
            assert np.abs(moved - rows["rotated_tgt"][i][theirs]).max() < 1e-6
            assert transform[:3, :3] @ transform[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
            angle = np.arccos(np.clip((np.trace(transform[:3, :3]) - 1) / 2, -1, 1))
            assert rows["rot_level"][i] == (angle >= np.pi / 4)
            for which in ("src", "tgt"):
                pose = rows[f"pose_{which}"][i]
                there = rows[which][i] @ pose[:3, :3].T + pose[:3, 3]
                assert np.abs(rows[f"rotated_{which}"][i] - there).max() < 1e-6


def distances(points: Any, others: Any, k: int) -> Any:
    """Of each point to its k-th nearest of the others; the first is itself where both are the same."""
    return np.sort(((points[:, None] - others[None]) ** 2).sum(axis=2), axis=1)[:, k - 1] ** 0.5


def test_overlaps_are_those_of_nearest_neighbours(made: tuple[Path, dict[str, Any]]) -> None:
    """Of a cloud's points those near the other cloud: a rule without masks, off by the clouds' density."""
    _, rows = made
    found = []
    for src, tgt in zip(rows["src"][::2], rows["tgt"][::2], strict=True):
        some = src[:400]  # in random order
        spacing = np.median(distances(some, src, k=2))
        found.append((distances(some, tgt, k=1) < 2.0 * spacing).mean())
    assert np.corrcoef(found, rows["overlap"][::2])[0, 1] > 0.9
    assert np.abs(np.array(found) - rows["overlap"][::2]).mean() < 0.06
    assert ((rows["match_level"] == 1) == (rows["overlap"] >= MATCHED)).all()
    assert (rows["view_src"] != rows["view_tgt"]).all()
    assert ((rows["overlap"] >= 0.3) & (rows["overlap"] <= 0.7)).all()


def test_pairs_of_scans_have_the_sensors_noise_and_the_overlap_of_what_its_places_see(tmp_path: Path) -> None:
    sensor = sensors.make("pinhole", width=160, height=120, fov=40.0, noise=0.002)
    scan = ScanConfig(sensor, range=(3.0, 3.0), size={"thing": 1.0}, method="exact")
    made = plan(make("bottle", 1), sample_size=1024, scale="mesh", scan=scan)
    generate(made, tmp_path / "scans")
    rows = read(tmp_path / "scans" / "MVP_Train_RG.h5")
    assert len(rows["overlap"]) == 16
    mesh = make("bottle", 1)
    standing = Mesh((mesh.vertices - mesh.centre) / mesh.longest_side, mesh.faces)
    surface = zo.sample_surface(standing, n_points=20_000, seed=5).positions[:, [0, 2, 1]] * [1, 1, -1]  # y is up there
    eyes = zo.views.fibonacci(16, distance=3.0).eyes
    off = []
    for i, transform in enumerate(rows["transforms"]):
        off.append(distances(rows["src"][i][:100], surface, k=1))
        moved = rows["rotated_src"][i] @ transform[:3, :3].T + transform[:3, 3]
        pose = rows["pose_tgt"][i]
        assert np.abs(moved - (rows["src"][i] @ pose[:3, :3].T + pose[:3, 3])).max() < 1e-6
        assert len(rows["match_id"][i]) == 0
    assert 0.0005 < np.mean(off) < 0.008, "beside the surface, by the noise and the spacing of its points"
    for i in range(0, 16, 4):
        first, second = eyes[rows["view_src"][i]], eyes[rows["view_tgt"][i]]
        one, other, both = (
            zo.visible_mesh(standing, each).mesh.areas.sum() for each in (first, second, [first, second])
        )
        assert rows["overlap"][i] == pytest.approx((one + other - both) / one, abs=0.03), "by areas, not by points"
    packed = Plan(made.meshes, replace(made.config, overlap=None), "packed")
    generate(packed, tmp_path / "packed")
    with pytest.raises(DatasetError, match="generate --format"):
        convert(tmp_path / "packed", tmp_path / "converted", "pairs")
    with pytest.raises(OptionError, match="object alone"):
        generate(plan(box(), scan=replace(scan, scene="room")), tmp_path / "room")


def test_overlaps_are_counted_and_even() -> None:
    rng = np.random.default_rng(0)
    mesh, found = sphere(), list[float]()
    points = zo.sample_surface(mesh, n_points=4_000, seed=1)
    with zo.prepare(mesh, "exact") as occluder:
        for seed in range(6):
            mask = occluder.visible(points, zo.views.random(40, seed=seed).around(mesh.centre, mesh.longest_side))
            for pair in choose_pairs(mask, 40, (0.3, 0.7), rng):
                both = (mask[pair.source] & mask[pair.target]).sum()
                assert pair.overlap == pytest.approx(both / mask[pair.source].sum())
                found.append(pair.overlap)
    counts, _ = np.histogram(found, np.linspace(0.3, 0.7, 9))
    assert counts.sum() == 240
    assert np.abs(counts / 30 - 1).max() < 0.2, "as many in each eighth of the range"
    assert len(choose_pairs(mask, 40, (0.9999, 1.0), rng)) < 40


def test_what_gives_no_pairs(tmp_path: Path) -> None:
    manifest = generate(plan(box(), sphere(), views="ring:4@0", overlap=(0.45, 0.55)), tmp_path / "one")
    assert manifest["counts"]["objects_without_pairs"] == 1, "a box shows whole sides"
    without = Plan(plan(box()).meshes, DatasetConfig(method="exact", views="ring:2@20", scale="object"), "pairs")
    for message, refused in (
        ("must have a range", without),
        ("2 views", plan(box(), views="ring:1@20")),
        ("in one frame.* --frame object .*completion3d and epn3d keep", plan(box(), frame="camera")),
    ):
        with pytest.raises(OptionError, match=message):
            find_format("pairs").check(refused)
    with pytest.raises(DatasetError, match="at least one pair must have an overlap of"):
        generate(plan(box(), views="ring:2@0", overlap=(0.99, 1.0)), tmp_path / "two")
