"""CloudSet: wrong arguments, subsets, and clouds of a dataset."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from zbuf_occlude.base.errors import ArgumentError, DatasetError
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.meshes import shapes
from zbuf_occlude.studies.learn.data import CloudSet, load_clouds


def some_clouds(m: int = 6, n: int = 9) -> CloudSet:
    rng = np.random.default_rng(0)
    return CloudSet(
        rng.normal(size=(m, n, 3)),
        np.arange(m) % 2,
        ("bed", "car"),
        np.arange(m) // 2,
        np.linspace(-1, 1, m),
    )


def test_subset_by_mask_and_by_index() -> None:
    clouds = some_clouds()
    by_mask, by_index = clouds.subset(clouds.labels == 1), clouds.subset([1, 3, 5])
    assert (by_mask.positions == by_index.positions).all()
    assert by_mask.group_ids.tolist() == [0, 1, 2]
    assert (clouds.subset([5, 0]).elevations == clouds.elevations[[5, 0]]).all()
    assert len(clouds.subset([])) == 0


def test_selected_points_are_points_of_the_cloud() -> None:
    clouds = some_clouds()
    fewer = clouds.select_points(4, seed=3)
    assert fewer.n_points == 4
    for few, many in zip(fewer.positions, clouds.positions, strict=True):
        rows = {tuple(point) for point in few}
        assert len(rows) == 4
        assert rows <= {tuple(point) for point in many}
    assert (clouds.select_points(4, seed=3).positions == fewer.positions).all()
    assert (clouds.select_points(4, seed=4).positions != fewer.positions).any()


def test_thinned_keeps_so_many_of_each_group() -> None:
    clouds = some_clouds(m=60)
    groups = np.repeat([7, 1, 4], [40, 19, 1])
    thin = clouds.thinned(groups, 5, seed=0)
    kept = [int(np.flatnonzero((clouds.positions == cloud).all(axis=(1, 2)))[0]) for cloud in thin.positions]
    assert kept == sorted(set(kept)), "each once, in their order"
    assert [sum(groups[i] == g for i in kept) for g in (7, 1, 4)] == [5, 5, 1]
    other = clouds.thinned(groups, 5, seed=1)
    assert (other.positions != thin.positions).any()
    assert len(clouds.thinned(groups, 100, seed=0)) == 60


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"positions": np.zeros((6, 3))}, r"positions must be \(m, n, 3\) float.*got \(6, 3\) float64"),
        ({"positions": np.full((6, 9, 3), np.nan)}, "positions must be finite; those of cloud 0 are not"),
        ({"labels": np.zeros(5)}, r"labels must be \(6,\), one per cloud; got \(5,\) int64"),
        ({"labels": np.full(6, 2)}, r"labels must lie in \[0, 2\), the classes; got 2 to 2"),
        ({"elevations": np.zeros((6, 1))}, r"elevations must be \(6,\)"),
    ],
)
def test_what_is_refused(change: dict[str, np.ndarray], message: str) -> None:
    clouds = some_clouds()
    fields = {name: getattr(clouds, name) for name in ("positions", "labels", "classes", "group_ids", "elevations")}
    with pytest.raises(ArgumentError, match=message):
        CloudSet(**(fields | change))


def test_too_many_points_and_sets_that_do_not_fit() -> None:
    clouds = some_clouds()
    with pytest.raises(ArgumentError, match=r"n must lie in 1\.\.9, the points of each cloud; got 10"):
        clouds.select_points(10, seed=0)
    with pytest.raises(ArgumentError, match="both sets must have the same classes and the same size"):
        CloudSet.concatenate(clouds, clouds.select_points(4, seed=0))


@pytest.mark.parametrize("format", ["packed", "hdf5"])
def test_clouds_of_a_dataset(tmp_path: Path, format: str) -> None:
    """Occluded clouds have the camera's elevation, complete ones have none; both have their object."""
    meshes = shapes.collection(n_members=1).select(classes=["bed", "table"])
    config = DatasetConfig(method="exact", views="ring:3@40", n_points=600, sample_size=64)
    generate(Plan(meshes, config, format), tmp_path / "seen")
    whole = DatasetConfig(method="exact", views="ring:1@0", n_points=600, sample_size=64, complete=True)
    generate(Plan(meshes, whole, format), tmp_path / "whole")
    seen, complete = load_clouds(tmp_path / "seen", "train", 48), load_clouds(tmp_path / "whole", "train")
    assert seen.classes == ("bed", "table")
    assert sorted(zip(seen.group_ids, seen.labels, strict=True)) == [(0, 0)] * 3 + [(1, 1)] * 3
    assert (seen.n_points, complete.n_points) == (48, 64)
    assert seen.elevations == pytest.approx(np.radians(40), abs=1e-6)
    assert np.isnan(complete.elevations).all()
    assert np.ptp(seen.positions, axis=1).max(axis=1) == pytest.approx(1, abs=0.25), (
        "scaled before points were left out"
    )
    assert np.ptp(complete.positions, axis=1).max(axis=1) == pytest.approx(1, abs=1e-4)
    with pytest.raises(DatasetError, match="must have clouds of the split test; it has train"):
        load_clouds(tmp_path / "seen", "test")
    with pytest.raises(DatasetError, match=r"n_points must lie in 1\.\.64"):
        load_clouds(tmp_path / "seen", "train", 65)


def test_a_point_that_is_not_finite_is_told_with_its_folder(tmp_path: Path) -> None:
    config = DatasetConfig(method="oracle", views="ring:2@30", n_points=100, sample_size=8)
    generate(Plan(shapes.collection(n_members=2), config, "hdf5"), tmp_path / "clouds")
    with h5py.File(tmp_path / "clouds" / "ply_data_train0.h5", "a") as file:
        file["data"][3, 1, 2] = np.nan
    with pytest.raises(
        DatasetError, match=r"clouds must be as .* \(positions must be finite; those of cloud 3 are not"
    ):
        load_clouds(tmp_path / "clouds", "train")
