"""A dataset's folder when runs are killed in it, or meet in it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zbuf_occlude import Mesh, MeshCollection
from zbuf_occlude.dataset.generate import generate, run_here
from zbuf_occlude.dataset.jobs import Done, Making
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.meshes import MeshEntry


@pytest.fixture
def plan() -> Plan:
    corners = np.vstack([np.zeros(3), np.eye(3)])
    tetrahedron = Mesh(corners, [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])
    entries = [MeshEntry(f"solid/{i}", "solid", "train", lambda: tetrahedron) for i in range(2)]
    return Plan(MeshCollection(entries), Recipe("oracle", views="ring:2@30", n_points=50, sample_size=8))


def files(out: Path) -> dict[str, bytes]:
    """Everything in a folder but the manifest, whose seconds differ, and the picture."""
    names = {"manifest.json", "contact_sheet.png"}
    return {str(p.relative_to(out)): p.read_bytes() for p in out.rglob("*") if p.is_file() and p.name not in names}


@pytest.mark.parametrize("left", ["plan", "finished"])
def test_what_killed_processes_left_is_no_other_file(plan: Plan, tmp_path: Path, left: str) -> None:
    fresh, out = tmp_path / "fresh", tmp_path / "out"
    generate(plan, fresh)
    if left == "finished":
        generate(plan, out)
    out.mkdir(exist_ok=True)
    for name in (".zbuf-0123456789abcdef.part", ".zbuf-fedcba9876543210.part"):
        (out / name).write_bytes(b"half")
    generate(plan, out, overwrite=True)
    assert files(out) == files(fresh)


def test_a_users_own_file_is_another_file(plan: Plan, tmp_path: Path) -> None:
    (tmp_path / ".mine.part").write_bytes(b"")
    with pytest.raises(DatasetError, match="it has other files"):
        generate(plan, tmp_path)


def twin(task: Making, jobs: list[int], done: Done) -> None:
    """Make the shards, and then let another process of the same plan finish first."""
    run_here(task, jobs, done)
    generate(task.plan, task.out)


def disk(task: Making, jobs: list[int], done: Done) -> None:
    """Let another process finish, and find the shards' folder gone."""
    generate(task.plan, task.out)
    raise FileNotFoundError(2, "No such file or directory", str(task.out / "shards" / "000000.records"))


@pytest.mark.parametrize("run", [twin, disk])
def test_two_runs_at_a_time_end_with_one_dataset(plan: Plan, tmp_path: Path, run: Any) -> None:
    fresh, out = tmp_path / "fresh", tmp_path / "out"
    generate(plan, fresh)
    document = generate(plan, out, run=run)
    assert document == json.loads((out / "manifest.json").read_text())
    assert files(out) == files(fresh)


@pytest.mark.parametrize(("n_meshes", "n_shards"), [(10, 1), (12, 1), (13, 2), (400, 34), (1600, 32), (3200, 64)])
def test_small_datasets_are_cut_into_small_shards(plan: Plan, n_meshes: int, n_shards: int) -> None:
    entries = [MeshEntry(f"solid/{i}", "solid", "train", plan.meshes[0].load) for i in range(n_meshes)]
    many = Plan(MeshCollection(entries), Recipe("oracle", views="ring:10@30", n_points=50, sample_size=8))
    assert len(many.shards) == n_shards
    document = {**many.document, "clouds_per_shard": 500}  # as all datasets once were cut
    assert len(Plan.from_document(document).shards) == -(-n_meshes // 50)
