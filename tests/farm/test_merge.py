"""Files written by several: the same bytes, whoever writes them, killed or not; and never much more on the disk."""

import json
import os
import random
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.dataset.shards import make_shards
from zbuf_occlude import DatasetError, Mesh, MeshCollection
from zbuf_occlude.dataset import parts
from zbuf_occlude.dataset.claim import claim
from zbuf_occlude.dataset.convert import open_dataset
from zbuf_occlude.dataset.generate import generate, merge, run_here
from zbuf_occlude.dataset.jobs import Done, Task
from zbuf_occlude.dataset.parts import mark_path
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.shard import data_path
from zbuf_occlude.dataset.verify import verify
from zbuf_occlude.meshes.collection import MeshEntry

RECIPE = Recipe(method="oracle", views="fibonacci:5", n_points=64, sample_size=64)


def tetrahedron(number: int) -> Mesh:
    return Mesh(np.vstack([np.zeros(3), np.eye(3)]) * (1 + number), [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])


def collection(n_meshes: int) -> MeshCollection:
    return MeshCollection(
        MeshEntry(f"m{i}", "table" if i % 2 else "chair", "test" if i % 5 == 0 else "train", partial(tetrahedron, i))
        for i in range(n_meshes)
    )


@pytest.fixture(scope="module")
def plan() -> Iterator[Plan]:
    """Three groups of 250 clouds; files of 16, shards of 20 clouds."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("zbuf_occlude.dataset.plan.CLOUDS_PER_FILE", 16)
        patched.setattr("zbuf_occlude.dataset.plan.CLOUDS_PER_SHARD", 20)
        patched.setattr("zbuf_occlude.dataset.plan.CLOUDS_PER_GROUP", 250)
        plan = Plan(collection(150), RECIPE)
        assert (len(plan.groups), len(plan.shards)) == (3, 39)
        yield plan


@pytest.fixture(scope="module")
def whole(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The dataset, made by one process."""
    out = tmp_path_factory.mktemp("whole")
    generate(plan, out)
    return out


@pytest.fixture(scope="module")
def shards(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its shards alone, to be copied."""
    out = tmp_path_factory.mktemp("shards") / "out"
    claim(plan, out)
    make_shards(plan, out)
    return out


def files(out: Path) -> dict[str, bytes]:
    """Everything in a folder but the manifest, whose seconds differ, and the picture."""
    names = {"manifest.json", "contact_sheet.png"}
    return {str(p.relative_to(out)): p.read_bytes() for p in out.rglob("*") if p.is_file() and p.name not in names}


def on_disk(out: Path) -> int:
    return sum(path.stat().st_size for path in out.rglob("*") if path.suffix in (".records", ".h5", ".part"))


def test_same_bytes_whatever_writes_them_and_in_whatever_order(
    plan: Plan, whole: Path, shards: Path, tmp_path: Path
) -> None:
    def shuffled(task: Task, jobs: list[int], done: Done) -> None:
        rng, left = random.Random(3), list(jobs)
        while left:
            job = left.pop(rng.randrange(len(left)))
            left.extend(done(job, task.do(job, None)))

    generate(plan, tmp_path / "two", run=shuffled)
    shutil.copytree(shards, tmp_path / "three")
    documents = [merge(plan, tmp_path / "three", share=(i, 4)) for i in (2, 0, 3, 1)]
    assert [bool(document) for document in documents] == [False, False, False, True]
    assert files(whole) == files(tmp_path / "two") == files(tmp_path / "three")


def test_a_layout_of_a_file_per_cloud_is_written_in_parts_and_gives_up_its_shards(plan: Plan, tmp_path: Path) -> None:
    published, left = replace(plan, format="modelnet-o"), list[int]()

    def watched(task: Task, jobs: list[int], done: Done) -> None:
        queue = list(jobs)
        while queue:
            job = queue.pop(0)
            task.do(job, None)
            left.append(sum(path.stat().st_size for path in (tmp_path / "two").rglob("*.records")))
            queue.extend(done(job, None))

    generate(published, tmp_path / "one")
    generate(published, tmp_path / "two", run=watched)
    assert files(tmp_path / "one") == files(tmp_path / "two")
    assert len(list((tmp_path / "one").rglob("*.xyz"))) == published.n_clouds
    assert verify(tmp_path / "one", None).faults == []
    n_parts = len(published.parts)
    assert left[-1] == 0
    assert left[-n_parts // 4] < 0.5 * max(left), "three quarters of the files are there, and shards have gone"


def test_files_mix_classes_and_objects_of_a_whole_group(plan: Plan, whole: Path) -> None:
    source = open_dataset(whole)
    assert source.n_clouds == {"train": 600, "test": 150}
    seen, n_met = [], []
    for split in source.order:
        for _, numbers in source.files(split):
            records = source.take(numbers)
            group = {g for g, ids in enumerate(plan.groups) if set(records["mesh_id"]) <= set(ids)}
            assert len(group) == 1
            seen += zip(records["mesh_id"].tolist(), records["view_id"].tolist(), strict=True)
            if split == "train" and len(records) == 16:
                assert 0 < records["label"].sum() < 16, "both classes"
                n_met.append(len(set(records["mesh_id"])))
    assert sorted(seen) == [(mesh, view) for mesh in range(150) for view in range(5)], "each cloud once"
    # 16 of 200 clouds, drawn at random, five of each of 40 objects: 13.4 of these are met on average
    assert abs(np.mean(n_met) - 13.4) < 1
    for ids in plan.groups:
        assert abs(sum(i % 2 for i in ids) - 25) <= 2, "each group has its share of each class"


@pytest.mark.parametrize("separate", [False, True])
def test_the_disk_never_holds_much_more_than_the_dataset(plan: Plan, tmp_path: Path, separate: bool) -> None:
    peak = 0

    def watched(task: Task, jobs: list[int], done: Done) -> None:
        nonlocal peak
        left = list(jobs)
        while left:
            some, left = left[:2], left[2:]  # two workers: what both write is there before either cuts
            for job in some:
                task.do(job, None)
                peak = max(peak, on_disk(tmp_path))
            left = [new for job in some for new in done(job, None)] + left

    if separate:
        claim(plan, tmp_path)
        make_shards(plan, tmp_path, watched)
        merge(plan, tmp_path, run=watched)
    else:
        generate(plan, tmp_path, run=watched)
    whole = on_disk(tmp_path)
    assert whole > 1_000_000
    assert peak <= 1.2 * whole


def test_peak_while_a_file_is_there_and_the_shards_are_not_cut(
    plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    peak, trim = 0, parts.trim

    def looked(*arguments: Any) -> None:
        nonlocal peak
        peak = max(peak, on_disk(tmp_path))
        trim(*arguments)

    monkeypatch.setattr(parts, "trim", looked)
    generate(plan, tmp_path)
    assert 0 < peak <= 1.2 * on_disk(tmp_path)


def test_peak_where_all_clouds_are_of_one_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts that were handed out first must not be written last: shards can only be cut at their ends."""
    monkeypatch.setattr("zbuf_occlude.dataset.plan.CLOUDS_PER_FILE", 10)
    monkeypatch.setattr("zbuf_occlude.dataset.plan.CLOUDS_PER_SHARD", 20)
    plan, peak, trim = Plan(collection(60), RECIPE), 0, parts.trim
    assert (len(plan.groups), len(plan.parts)) == (1, 30)

    def looked(*arguments: Any) -> None:
        nonlocal peak
        peak = max(peak, on_disk(tmp_path))
        trim(*arguments)

    claim(plan, tmp_path)
    make_shards(plan, tmp_path)
    monkeypatch.setattr(parts, "trim", looked)
    merge(plan, tmp_path)
    assert 0 < peak <= 1.2 * on_disk(tmp_path)


class Killed(BaseException):
    """As by SIGKILL: nothing is tidied up."""


@pytest.mark.parametrize("moment", ["before the mark", "before the cut", "after"])
def test_a_killed_merge_goes_on_where_it_was(
    plan: Plan, whole: Path, shards: Path, tmp_path: Path, moment: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, n_left = shutil.copytree(shards, tmp_path / "out"), 7

    def kill(*arguments: Any) -> None:
        nonlocal n_left
        n_left -= 1
        if not n_left:
            raise Killed

    with monkeypatch.context() as patched:
        if name := {"before the mark": "_write_mark", "before the cut": "trim", "after": ""}[moment]:
            original = getattr(parts, name)
            patched.setattr(parts, name, lambda *a: (kill(), original(*a)))
        with pytest.raises(Killed):
            merge(plan, out, progress=kill if moment == "after" else lambda n: None)
    written = sum(mark_path(out, i).exists() for i in range(len(plan.parts)))
    assert written == {"before the mark": 6, "before the cut": 7, "after": 7}[moment]
    before = {path: path.stat().st_mtime_ns for path in out.glob("*.h5")}
    again: list[int] = []

    def run(task: Task, jobs: list[int], done: Done) -> None:
        def counted(job: int, result: object) -> Iterable[int]:
            again.append(job)
            return done(job, result)

        run_here(task, jobs, counted)

    merge(plan, out, run=run)
    assert len(again) == len(plan.parts) - written
    kept = sum(path.stat().st_mtime_ns == time for path, time in before.items())
    assert kept == written, "what was written is not written again"
    assert files(out) == files(whole)


@pytest.fixture(scope="module")
def half(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a killed run leaves, to be copied."""
    out, n_left = tmp_path_factory.mktemp("half") / "out", 24  # thirteen shards, and most of their files

    def some(task: Task, jobs: list[int], done: Done) -> None:
        def stop(job: int, result: object) -> Iterable[int]:
            nonlocal n_left
            n_left -= 1
            if not n_left:
                raise Killed
            return done(job, result)

        run_here(task, jobs, stop)

    with pytest.raises(Killed):
        generate(plan, out, run=some)
    return out


@pytest.mark.parametrize("damage", ["file cut", "file gone", "mark", "shard flipped", "shard gone"])
def test_what_is_lost_of_a_half_written_group_is_made_again(
    plan: Plan, whole: Path, half: Path, tmp_path: Path, damage: str
) -> None:
    out = shutil.copytree(half, tmp_path / "out")
    part = next(i for i in reversed(range(len(plan.parts))) if mark_path(out, i).exists())
    name = json.loads(mark_path(out, part).read_text())["files"][plan.parts[part].split][0]
    shard = next(p for i in range(len(plan.shards)) if (p := data_path(plan, out, i)).exists())
    if damage == "file cut":
        os.truncate(out / name, 1000)
    elif damage == "file gone":
        (out / name).unlink()
    elif damage == "mark":
        mark_path(out, part).write_text("{}")
    elif damage == "shard flipped":
        content = bytearray(shard.read_bytes())
        content[100] ^= 4
        shard.write_bytes(content)
    else:
        shard.unlink()
    if damage != "shard flipped":  # of data only the size is looked at
        with pytest.raises(
            DatasetError, match=r"all 39 shards must be done; .* Run it first: the `zbuf-occlude generate`"
        ):
            merge(plan, out)
    generate(plan, out)
    assert files(out) == files(whole)
