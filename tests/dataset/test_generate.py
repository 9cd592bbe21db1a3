"""Datasets made in one run and in many: the same files, by any workers and machines, killed, damaged, out of room."""

import json
import os
import random
import subprocess
import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cli.conftest import write_off
from tests.dataset.test_export import recipe_for
from zbuf_occlude import DatasetError, Mesh, MeshCollection, MeshError
from zbuf_occlude.dataset import plan as plans
from zbuf_occlude.dataset.batch import batch_path, group_path
from zbuf_occlude.dataset.folder import locked, partition_files
from zbuf_occlude.dataset.formats import FORMATS
from zbuf_occlude.dataset.generate import GenerateTask, generate, merge
from zbuf_occlude.dataset.plan import DatasetConfig, Plan
from zbuf_occlude.dataset.source import open_dataset
from zbuf_occlude.dataset.verify import verify
from zbuf_occlude.limits import GivenUp, Limits
from zbuf_occlude.meshes.collection import MeshEntry
from zbuf_occlude.workers import Done, Task, run_here

pytestmark = pytest.mark.usefixtures("no_pictures")
RECIPE = DatasetConfig(method="oracle", views="fibonacci:5", n_points=64, sample_size=64)
FACES = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])


def tetrahedron(number: int) -> Mesh:
    return Mesh(np.vstack([np.zeros(3), np.eye(3)]) * (1 + number), FACES)


def broken() -> Mesh:
    raise MeshError("a mesh must be whole; this one is not.")


def collection(n_meshes: int) -> MeshCollection:
    return MeshCollection(
        MeshEntry(f"m{i}", "odd" if i % 2 else "even", "test" if i % 5 == 0 else "train", partial(tetrahedron, i))
        for i in range(n_meshes)
    )


def small(monkeypatch: pytest.MonkeyPatch, *, per_file: int, per_batch: int, per_group: int) -> None:
    """Cut datasets finely."""
    monkeypatch.setattr(plans, "CLOUDS_PER_FILE", per_file)
    monkeypatch.setattr(plans, "CLOUDS_PER_BATCH", per_batch)
    monkeypatch.setattr(plans, "FEWEST_PER_BATCH", per_batch)
    monkeypatch.setattr(plans, "CLOUDS_PER_GROUP", per_group)


@pytest.fixture
def plan(monkeypatch: pytest.MonkeyPatch) -> Plan:
    """Three groups of 100 clouds; files of 16, batches of 20 clouds."""
    small(monkeypatch, per_file=16, per_batch=20, per_group=100)
    plan = Plan(collection(60), RECIPE)
    assert (len(plan.groups), len(plan.batches)) == (3, 15)
    return plan


@pytest.fixture(scope="module")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("generated") / "whole"


@pytest.fixture
def whole(plan: Plan, made_once: Path) -> dict[str, bytes]:
    """The files of the dataset, made in one run by this process, the first time it is asked for."""
    if not made_once.exists():
        generate(plan, made_once)
    return files(made_once)


def files(out: Path) -> dict[str, bytes]:
    """Everything in a folder but what has seconds in it, and the picture."""
    found = {str(path.relative_to(out)): path for path in out.rglob("*") if path.is_file()}
    skipped = ("manifest.json", "contact_sheet.png", "groups/")
    return {name: path.read_bytes() for name, path in found.items() if not name.startswith(skipped)}


class Killed(BaseException):
    """As by SIGKILL: nothing is tidied up."""


def killed_after(n_jobs: int) -> Callable[[Task, list[Any], Done], None]:
    """Return an engine that is killed when it has done this many jobs."""

    def run(task: Task, jobs: list[Any], done: Done) -> None:
        left = n_jobs

        def stop(job: Any, result: object) -> Iterable[Any]:
            nonlocal left
            if not left:
                raise Killed
            left -= 1
            return done(job, result)

        run_here(task, jobs, stop)

    return run


def shuffled(task: Task, jobs: list[Any], done: Done) -> None:
    """As many workers would do them: no two jobs in the order in which one would."""
    rng, left = random.Random(3), list(jobs)
    while left:
        job = left.pop(rng.randrange(len(left)))
        left.extend(done(job, task.do(job, None)))


def test_same_files_in_any_order_and_by_any_number_of_machines(
    plan: Plan, whole: dict[str, bytes], tmp_path: Path
) -> None:
    generate(plan, tmp_path / "shuffled", run=shuffled)
    machines = tmp_path / "machines"
    generate(plan, machines, share=(1, 2))
    with pytest.raises(DatasetError, match=r"must have all 3 groups of files; group 0 is not done.* Run the"):
        merge(plan, machines)
    assert generate(plan, machines, share=(0, 2)) == {}
    document = merge(plan, machines)
    assert merge(plan, machines) == document, "a second one finds it done"
    assert whole == files(tmp_path / "shuffled") == files(machines)
    assert verify(machines, None).faults == []
    assert partition_files(machines, plan)[1] == []


def test_files_mix_classes_and_objects_of_a_whole_group(plan: Plan, whole: dict[str, bytes], made_once: Path) -> None:
    source = open_dataset(made_once)
    assert source.n_clouds == {"train": 240, "test": 60}
    seen, n_met = [], []
    for split in source.order:
        for _, numbers in source.files(split):
            records = source.take(numbers)
            assert sum(set(records["mesh_id"]) <= set(ids.tolist()) for ids in plan.groups) == 1
            seen += zip(records["mesh_id"].tolist(), records["view_id"].tolist(), strict=True)
            if split == "train" and len(records) == 16:
                assert 0 < records["label"].sum() < 16, "both classes"
                n_met.append(len(set(records["mesh_id"])))
    assert sorted(seen) == [(mesh, view) for mesh in range(60) for view in range(5)], "each cloud once"
    # 16 of 80 clouds, drawn at random, five of each of 16 objects: 10.9 of these are met on average
    assert abs(np.mean(n_met) - 10.9) < 1
    for ids in plan.groups:
        assert abs(sum(i % 2 for i in ids) - 10) <= 2, "each group has its share of each class"


@pytest.mark.parametrize("n_jobs", [1, 6, 7, 14, 26, 33])
def test_a_killed_run_resumes_and_makes_nothing_twice(
    plan: Plan, whole: dict[str, bytes], tmp_path: Path, n_jobs: int
) -> None:
    out, again = tmp_path / "out", list[Any]()
    with pytest.raises(Killed):
        generate(plan, out, run=killed_after(n_jobs))

    def run(task: Task, jobs: list[Any], done: Done) -> None:
        run_here(task, jobs, lambda job, result: (again.append(job), done(job, result))[1])

    generate(plan, out, run=run)
    assert files(out) == whole
    n_batches = sum(what == "batch" for what, _ in again)
    assert n_batches <= len(plan.batches) - min(n_jobs, 5), "batches of before are not made again"


@pytest.mark.parametrize("damage", ["file cut", "file gone", "record", "batch flipped", "batch cut", "batch gone"])
def test_what_is_damaged_is_found_and_made_again(
    plan: Plan, whole: dict[str, bytes], tmp_path: Path, damage: str
) -> None:
    out = tmp_path / "out"
    with pytest.raises(Killed):  # a group is done, and some batches of the next
        generate(plan, out, run=killed_after(5 + len(plan.files_of[0]) + 3))
    assert group_path(out, 0).exists()
    batch = next(path for i in range(len(plan.batches)) if (path := batch_path(out, i)).exists())
    name = json.loads(group_path(out, 0).read_text())["names"][0]
    if damage == "file cut":
        os.truncate(out / name, 1000)
    elif damage == "file gone":
        (out / name).unlink()
    elif damage == "record":
        group_path(out, 0).write_text("{}")
    elif damage == "batch flipped":
        content = bytearray(batch.read_bytes())
        content[-100] ^= 4
        batch.write_bytes(content)
    elif damage == "batch cut":
        os.truncate(batch, batch.stat().st_size // 2)
    else:
        batch.unlink()
    generate(plan, out)
    assert files(out) == whole


def test_a_file_missing_from_a_finished_dataset_is_made_again(
    plan: Plan, whole: dict[str, bytes], made_once: Path
) -> None:
    (made_once / "ply_data_train3.h5").unlink()
    generate(plan, made_once)
    assert files(made_once) == whole


def test_the_disk_holds_little_more_than_the_dataset_and_two_groups(plan: Plan, tmp_path: Path) -> None:
    peak = 0

    def on_disk() -> int:
        return sum(path.stat().st_size for path in tmp_path.rglob("*") if path.suffix in (".batch", ".h5", ".part"))

    def watched(task: Task, jobs: list[Any], done: Done) -> None:
        def look(job: Any, result: object) -> Iterable[Any]:
            nonlocal peak
            peak = max(peak, on_disk())
            return done(job, result)

        run_here(task, jobs, look)

    generate(plan, tmp_path, run=watched)
    whole = on_disk()
    assert whole > 400_000
    assert peak <= whole * (1 + 1 / 3) * 1.05


def test_a_full_disk_ends_the_run_and_the_same_command_resumes(
    plan: Plan, whole: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left, replaced = 12, os.replace

    def replace_while_there_is_room(source: Any, target: Any) -> None:
        nonlocal left
        if not left:
            raise OSError(28, "No space left on device", str(target))
        left -= 1
        replaced(source, target)

    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", replace_while_there_is_room)
        with pytest.raises(OSError, match="No space left"):
            generate(plan, tmp_path / "out")
    assert not list((tmp_path / "out").rglob("*.part"))
    generate(plan, tmp_path / "out")
    assert files(tmp_path / "out") == whole


def test_two_runs_at_a_time_are_refused(plan: Plan, tmp_path: Path) -> None:
    """Locks are a process's, so the other run is a process of its own."""
    out = tmp_path / "out"
    generate(plan, out, share=(0, 3))
    code = (
        "import sys, time; from pathlib import Path; from zbuf_occlude.dataset.folder import locked\n"
        f"with locked(Path({str(out)!r}), range(1, 2)): print('held', flush=True); sys.stdin.read()\n"
    )
    other = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert other.stdin is not None
    assert other.stdout is not None
    other.stdout.readline()
    with pytest.raises(DatasetError, match=r"one run at a time; another is at work there\..*--shard"):
        generate(plan, out)
    generate(plan, out, share=(2, 3))
    other.kill()
    other.wait()
    other.stdin.close()
    other.stdout.close()
    assert generate(plan, out)["counts"]["clouds"] == plan.n_clouds
    with locked(out, range(1)):
        pass


VOXELS = pytest.mark.needs("open3d")


@pytest.mark.parametrize(
    "row", [pytest.param(row, marks=[VOXELS] * (row.name == "voxels")) for row in FORMATS], ids=lambda row: row.name
)
def test_every_format_is_made_killed_and_resumed(row: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    n_points = 16_384 if row.keeps_points and row.exported_from else 8_192 if row.complete else 64
    entries = [
        MeshEntry(f"m{i}", ("bed", "table")[i % 2], "test" if i % 3 == 0 else "train", partial(tetrahedron, i))
        for i in range(6)
    ]
    entries[4] = replace(entries[4], load=broken)
    plan = Plan(MeshCollection(entries), recipe_for(row, n_points, 32), row.name)
    n = plan.clouds_per_mesh
    small(monkeypatch, per_file=2 * n + 1, per_batch=n, per_group=3 * n)
    assert (len(plan.groups), len(plan.batches)) == (2, 6)
    document = generate(plan, tmp_path / "one")
    assert list(document["failures"]) == ["m4"]
    assert verify(tmp_path / "one", None).faults == []
    assert partition_files(tmp_path / "one", plan)[1] == []
    for n_jobs in (2, 1):
        with pytest.raises(Killed):
            generate(plan, tmp_path / "two", run=killed_after(n_jobs))
    if row.exported_from:
        n_left, replaced = 3, os.replace

        def replace_thrice(source: Any, target: Any) -> None:
            nonlocal n_left
            n_left -= "export" in str(source)
            if not n_left:
                raise Killed
            replaced(source, target)

        with monkeypatch.context() as patched:
            patched.setattr(os, "replace", replace_thrice)
            with pytest.raises(Killed):
                generate(plan, tmp_path / "two")
        assert partition_files(tmp_path / "two", plan)[1] == []
    generate(plan, tmp_path / "two", run=shuffled)
    assert files(tmp_path / "one") == files(tmp_path / "two")
    for share in ((1, 2), (0, 2)):
        assert generate(plan, tmp_path / "three", share=share) == {}
    merge(plan, tmp_path / "three")
    assert files(tmp_path / "one") == files(tmp_path / "three")


@pytest.mark.parametrize(("n_meshes", "n_batches"), [(10, 1), (12, 1), (13, 2), (400, 34), (800, 32)])
def test_small_datasets_have_small_batches(n_meshes: int, n_batches: int) -> None:
    many = Plan(collection(n_meshes), replace(RECIPE, views="ring:10@30"))
    assert len(many.batches) == n_batches


class TestOrigins:
    """What clouds were made of: a mesh that changed is refused and named, one that failed is tried again."""

    @pytest.fixture
    def meshes(self, tmp_path: Path) -> Path:
        for number in range(4):
            self.write(tmp_path / "meshes" / "table" / f"solid_{number}.off", 1 + number)
        return tmp_path / "meshes"

    @staticmethod
    def write(path: Path, size: float = 1.0) -> Path:
        return write_off(path, size * np.vstack([np.zeros(3), np.eye(3)]), FACES)

    @staticmethod
    def plan(meshes: Path, up: str | None = None) -> Plan:
        recipe = DatasetConfig(method="oracle", views="fibonacci:60", n_points=50, sample_size=8)  # two meshes a batch
        return Plan(MeshCollection.from_paths(meshes, up=up), recipe)

    @pytest.mark.parametrize("n_jobs", [1, 2, 9])
    def test_other_meshes_of_the_same_names_are_refused(self, meshes: Path, tmp_path: Path, n_jobs: int) -> None:
        out = tmp_path / "out"
        try:
            generate(self.plan(meshes), out, run=killed_after(n_jobs))
        except Killed:
            assert n_jobs < 9
        self.write(meshes / "table" / "solid_1.off", 7.0)
        with pytest.raises(DatasetError, match=r"table/solid_1\.off must be what the data in .* were made of, sha256 "):
            generate(self.plan(meshes), out)
        assert generate(self.plan(meshes), out, overwrite=True)["counts"]["meshes_failed"] == 0

    def test_a_mesh_that_changed_while_others_were_made_is_refused(self, meshes: Path, tmp_path: Path) -> None:
        def run(task: Task, jobs: list[Any], done: Done) -> None:
            run_here(task, jobs, done)
            self.write(meshes / "table" / "solid_0.off", 7.0)

        with pytest.raises(DatasetError, match=r"table/solid_0\.off must be what the data"):
            generate(self.plan(meshes), tmp_path / "out", run=run)

    def test_files_of_the_same_content_are_the_same_mesh(self, meshes: Path, tmp_path: Path) -> None:
        first = generate(self.plan(meshes), tmp_path / "out")
        os.utime(meshes / "table" / "solid_1.off", ns=(0, 0))
        assert generate(self.plan(meshes), tmp_path / "out") == first

    def test_which_way_is_up_is_part_of_the_plan(self, meshes: Path, tmp_path: Path) -> None:
        generate(self.plan(meshes), tmp_path / "out", share=(0, 2))
        with pytest.raises(DatasetError, match=r"in which up of table/solid_\d\.off was 'z', and is 'y'"):
            generate(self.plan(meshes, "y"), tmp_path / "out")

    @pytest.mark.parametrize("format", ["hdf5", "packed", "scanobjectnn"])
    @pytest.mark.parametrize("finished", [False, True])
    def test_a_mesh_that_failed_is_made_when_it_was_put_back(
        self, meshes: Path, tmp_path: Path, finished: bool, format: str
    ) -> None:
        out, bad = tmp_path / "out", meshes / "table" / "solid_0.off"
        sound = bad.read_bytes()
        bad.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n")
        plan = replace(self.plan(meshes), format=format)
        if finished:
            first = generate(plan, out)
            assert list(first["failures"]) == list(first["tries"]) == ["table/solid_0.off"]
            assert generate(plan, out) == first, "nothing changed, nothing is tried again"
        else:
            with pytest.raises(Killed):
                generate(plan, out, run=killed_after(1))
        bad.write_bytes(sound)
        assert generate(plan, out)["failures"] == {}
        generate(plan, tmp_path / "fresh")
        assert files(out) == files(tmp_path / "fresh")

    def test_a_mesh_that_exceeded_limits_is_tried_again_within_wider_ones(self, meshes: Path, tmp_path: Path) -> None:
        out, plan = tmp_path / "out", self.plan(meshes)

        class Losing(GenerateTask):
            def do(self, job: Any, gl: Any, lost: Any = None, on_mesh: Any = None) -> Any:
                return super().do(job, gl, {1: GivenUp("it took longer", Limits(60, 4))})

        def run(task: GenerateTask, jobs: list[Any], done: Done) -> None:  # type: ignore[misc]
            run_here(Losing(task.plan, task.out, False), jobs, done)

        first = generate(plan, out, run=run, limits=Limits(60, 4))  # type: ignore[arg-type]
        assert first["failures"] == {"table/solid_1.off": "it took longer"}
        for narrower in (Limits(60, 4), Limits(20, 4), Limits(60, 3)):
            assert generate(plan, out, limits=narrower) == first
        assert generate(plan, out, limits=Limits(61, 4))["failures"] == {}
