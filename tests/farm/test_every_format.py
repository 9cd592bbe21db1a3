"""Every format through one door: written by several, in any order, killed or short of room, the bytes are the same."""

import errno
import random
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.dataset.shards import make_shards
from tests.farm.test_merge import Killed, files, tetrahedron
from zbuf_occlude import Mesh, MeshCollection
from zbuf_occlude.dataset import parts, shared
from zbuf_occlude.dataset.claim import claim, own_names, remove, strangers
from zbuf_occlude.dataset.convert import convert, open_dataset
from zbuf_occlude.dataset.formats import FORMATS, Format, find_format
from zbuf_occlude.dataset.generate import generate, merge
from zbuf_occlude.dataset.jobs import Done, Task
from zbuf_occlude.dataset.parts import n_parts, shared_names
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.shared import unfinished
from zbuf_occlude.dataset.verify import verify
from zbuf_occlude.errors import MeshError
from zbuf_occlude.farm.local import run_jobs
from zbuf_occlude.limits import Limits
from zbuf_occlude.meshes.collection import MeshEntry

WRITTEN = [row for row in FORMATS if not row.all_points]
ONE_FILE = [row for row in WRITTEN if row.one_file]
every_format = pytest.mark.parametrize("row", WRITTEN, ids=[row.name for row in WRITTEN])
every_one_file = pytest.mark.parametrize("row", ONE_FILE, ids=[row.name for row in ONE_FILE])


def broken() -> Mesh:
    raise MeshError("a mesh must be whole; this one is not.")


@pytest.fixture
def plan(row: Format, monkeypatch: pytest.MonkeyPatch) -> Plan:
    """Ten objects, one of which fails, in two groups, a shard each; parts are of two."""
    n_points = 16_384 if row.pairs or row.complete else 64
    recipe = Recipe(
        method="exact", views=str(row.options.get("views", "fibonacci:3")), n_points=n_points, sample_size=32
    )
    entries = [
        MeshEntry(
            f"class{i % 2}/m{i}", ("chair", "table")[i % 2], "test" if i % 3 == 0 else "train", partial(tetrahedron, i)
        )
        for i in range(10)
    ]
    entries[4] = replace(entries[4], load=broken)
    plan = Plan(MeshCollection(entries), row.redrawn(recipe), row.name)
    monkeypatch.setattr("zbuf_occlude.dataset.plan.CLOUDS_PER_FILE", 2 * plan.clouds_per_mesh + 1)
    monkeypatch.setattr("zbuf_occlude.dataset.plan.CLOUDS_PER_SHARD", plan.clouds_per_mesh)
    monkeypatch.setattr("zbuf_occlude.dataset.plan.CLOUDS_PER_GROUP", 5 * plan.clouds_per_mesh)
    assert (len(plan.groups), len(plan.shards)) == (2, 10)
    assert n_parts(plan) >= 4
    return plan


def shuffled(task: Task, jobs: list[int], done: Done) -> None:
    """As many workers would do them: no two jobs in the order in which one would."""
    rng, left = random.Random(3), list(jobs)
    while left:
        job = left.pop(rng.randrange(len(left)))
        left.extend(done(job, task.do(job, None)))


@every_format
def test_same_bytes_by_one_by_many_by_five_machines_and_after_kills(
    row: Format, plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, many, machines, killed = (tmp_path / name for name in ("one", "many", "machines", "killed"))
    generate(plan, one)
    assert verify(one, None).faults == []
    assert strangers(one, plan) == []
    n_clouds = open_dataset(one).n_clouds
    fewer = {split: row.n_kept(split, plan.clouds_per_mesh) for split in ("train", "test")}
    assert n_clouds == {"train": 5 * fewer["train"], "test": 4 * fewer["test"]}

    generate(plan, many, run=shuffled)

    claim(plan, machines)
    make_shards(plan, machines)
    documents = [merge(plan, machines, share=(i, 5), run=shuffled) for i in (2, 0, 4, 3, 1)]
    assert [bool(document) for document in documents] == [False, False, False, False, True]

    moments, original = iter(range(1000)), parts._write_mark

    def write_mark(*arguments: Any) -> None:
        moment = next(moments) % 4
        if moment == 1:
            raise Killed  # files are there, and the mark is not
        original(*arguments)
        if moment == 3:
            raise Killed  # the mark is there, and shards are not cut

    monkeypatch.setattr(parts, "_write_mark", write_mark)
    n_kills = 0
    while True:
        try:
            generate(plan, killed)
            break
        except Killed:
            n_kills += 1
            assert not (killed / "manifest.json").exists()
    assert n_kills >= n_parts(plan) // 2
    assert files(one) == files(many) == files(machines) == files(killed)


@every_format
def test_converted_by_many_and_after_kills(
    row: Format, plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, many = tmp_path / "one", tmp_path / "many"
    packed = replace(plan, format="packed", recipe=replace(plan.recipe, complete=False))
    generate(packed, tmp_path / "packed")
    manifest = convert(tmp_path / "packed", one, row.name)
    assert verify(one, None).faults == []
    moments, original = iter(range(1000)), parts._write_mark

    def write_mark(*arguments: Any) -> None:
        if next(moments) % 3 == 2:
            raise Killed
        original(*arguments)

    with monkeypatch.context() as patched:
        patched.setattr(parts, "_write_mark", write_mark)
        with pytest.raises(Killed):
            convert(tmp_path / "packed", many, row.name, run=shuffled)
    told: list[int] = []
    again = convert(tmp_path / "packed", many, row.name, run=shuffled, progress=told.append)
    assert told[0] > 0, "what was written is not written again"
    assert again["sha256"] == manifest["sha256"]
    assert files(one) == files(many)


@pytest.mark.parametrize("row", [find_format("hdf5"), *ONE_FILE], ids=lambda row: row.name)
def test_one_that_another_overtakes_ends_with_the_same_files(
    row: Format, plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It has read what its first part is made of when the other writes all, and takes the shards away."""
    packed = replace(plan, format="packed", recipe=replace(plan.recipe, complete=False))
    generate(packed, tmp_path / "packed")
    makes: list[Callable[[Path], Any]] = [
        partial(generate, plan),
        lambda out: convert(tmp_path / "packed", out, row.name),
    ]
    original, others = parts.write_contents, list[Callable[[], Any]]()

    def write_contents(*arguments: Any) -> None:
        if others:
            others.pop()()
        original(*arguments)

    for module in ("parts", "convert"):
        monkeypatch.setattr(f"zbuf_occlude.dataset.{module}.write_contents", write_contents)
    for i, make in enumerate(makes):
        one, two = tmp_path / f"one{i}", tmp_path / f"two{i}"
        others.append(partial(make, two))
        document = make(two)
        make(one)
        assert files(one) == files(two)
        assert document["files"] == make(two)["files"]
        assert strangers(two, plan) == []


@every_one_file
def test_a_full_disk_and_what_is_removed(
    row: Format, plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls, original = iter(range(1000)), shared._write

    def write(*arguments: Any) -> None:
        if next(calls) == 5:
            raise OSError(errno.ENOSPC, "No space left on device")
        original(*arguments)

    out = tmp_path / "out"
    with monkeypatch.context() as patched:
        patched.setattr(shared, "_write", write)
        with pytest.raises(OSError, match="No space left"):
            generate(plan, out)
    begun = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert begun <= own_names(plan)
    finished = {name for name in row.load().names(plan) if (out / name).exists()}
    assert finished == set(), "no file has its name before all its rows are there"
    generate(plan, out)
    generate(plan, tmp_path / "whole")
    assert files(out) == files(tmp_path / "whole")
    remove(out)
    assert list(out.iterdir()) == []


@every_one_file
@pytest.mark.parametrize("damage", ["cut", "longer"])
def test_files_damaged_before_a_killed_run_goes_on(
    row: Format, plan: Plan, damage: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, original, n_written = tmp_path / "out", parts._write_mark, 0

    def write_mark(*arguments: Any) -> None:
        nonlocal n_written
        original(*arguments)
        n_written += 1
        if n_written == 3:
            raise Killed

    with monkeypatch.context() as patched:
        patched.setattr(parts, "_write_mark", write_mark)
        with pytest.raises(Killed):
            generate(plan, out)
    begun = [path for name in shared_names(plan) if (path := unfinished(out, name)).exists()]
    assert begun
    for path in begun:
        content = path.read_bytes()
        path.write_bytes(content[: len(content) // 2] if damage == "cut" else content + b"x")
    generate(plan, out)
    generate(plan, tmp_path / "whole")
    assert files(out) == files(tmp_path / "whole")


@pytest.mark.parametrize("row", [find_format("scanobjectnn")], ids=["scanobjectnn"])
def test_rows_written_by_two_processes(plan: Plan, tmp_path: Path) -> None:
    run = partial(run_jobs, n_workers=2, limits=Limits(seconds=300, gigabytes=8))
    generate(plan, tmp_path / "one")
    generate(plan, tmp_path / "two", run=run)
    assert files(tmp_path / "one") == files(tmp_path / "two")
    convert(tmp_path / "one", tmp_path / "three", "modelnet40-c", run=run)
    generate(replace(plan, format="modelnet40-c"), tmp_path / "four")
    assert {name: content for name, content in files(tmp_path / "three").items() if name.endswith(".npy")} == {
        name: content for name, content in files(tmp_path / "four").items() if name.endswith(".npy")
    }
