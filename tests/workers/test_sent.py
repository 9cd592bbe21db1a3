"""What workers are given: the task, of which the part that grows with the meshes is shared by all."""

from functools import partial
from pathlib import Path

import pytest

from tests.workers.test_merge import RECIPE, tetrahedron
from zbuf_occlude import MeshCollection
from zbuf_occlude.dataset.jobs import Making
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.workers.sent import Sent
from zbuf_occlude.meshes.collection import SPLITS, MeshEntry


def large(n_meshes: int) -> Plan:
    return Plan(
        MeshCollection(
            MeshEntry(f"shape/{i:06d}.off", f"class{i % 40}", SPLITS[i % 3], partial(tetrahedron, i), Path(f"/m/{i}"))
            for i in range(n_meshes)
        ),
        RECIPE,
    )


def test_a_plan_arrives_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zbuf_occlude.dataset.plan.CLOUDS_PER_GROUP", 4_000)
    monkeypatch.setattr("zbuf_occlude.dataset.plan.CLOUDS_PER_SHARD", 40)
    plan = large(3_000)
    there = Sent(Making(plan, Path("out"), False)).unpacked().plan  # type: ignore[attr-defined]
    assert len(plan.groups) == 4
    assert (there.fingerprint, there.classes, there.splits) == (plan.fingerprint, plan.classes, plan.splits)
    monkeypatch.undo()  # a worker cuts as it is told, not as it would
    assert list(there.shards) == list(plan.shards)
    assert list(there.parts) == list(plan.parts)
    assert [there.group_of(i) for i in range(len(plan.shards))] == [plan.group_of(i) for i in range(len(plan.shards))]
    for i in (0, 1_234, 2_999):
        assert (there.meshes[i].key, there.meshes[i].path) == (plan.meshes[i].key, plan.meshes[i].path)
        assert there.meshes[i].load().vertices.tobytes() == tetrahedron(i).vertices.tobytes()


def test_what_a_worker_holds_for_itself_does_not_grow_with_the_meshes() -> None:
    own = [len(Sent(Making(large(n), Path("out"), False))._pickled) for n in (300, 3_000)]
    assert own[1] - own[0] < 100
