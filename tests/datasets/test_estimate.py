"""What --dry-run says of a plan, against what making it took."""

from functools import partial
from pathlib import Path

import pytest

from tests.datasets.test_generate import tetrahedron
from zbuf_occlude import Mesh, MeshCollection, MeshError
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.rehearsal import estimate
from zbuf_occlude.meshes.collection import MeshEntry


def bad(number: int) -> Mesh:
    raise MeshError(f"m{number} is bad")


def plan_of(format: str, n_bad: int = 0) -> Plan:
    entries = [MeshEntry(f"m{i}", "chair", "train", partial(bad if i < n_bad else tetrahedron, i)) for i in range(10)]
    config = DatasetConfig("oracle", views="ring:30@20", n_points=400, sample_size=100)
    return Plan(MeshCollection(entries), config, format)


@pytest.mark.parametrize("format", ["hdf5", "packed", "modelnet-o"])
def test_bytes_are_those_of_the_files(tmp_path: Path, format: str) -> None:
    plan = plan_of(format)
    found = estimate(plan)
    assert (found.n_meshes, found.n_failed) == (10, 0)
    assert 0 < found.processor_seconds < 60
    generate(plan, tmp_path)
    names = {path for path in tmp_path.rglob("*") if path.suffix in (".h5", ".zip", ".xyz", ".npy")}
    made = sum(path.stat().st_size for path in names)
    if format != "modelnet-o":  # which is text
        assert found.n_bytes == pytest.approx(made, rel=0.2)  # small files have large headers
    most = {"hdf5": 1.0, "packed": 1.0, "modelnet-o": 2.0}[format]
    assert found.peak_bytes == pytest.approx(most * found.n_bytes, rel=0.01)


def test_meshes_that_fail_are_counted(tmp_path: Path) -> None:
    found = estimate(plan_of("hdf5", n_bad=4))
    assert (found.n_meshes, found.n_failed) == (10, 4)
