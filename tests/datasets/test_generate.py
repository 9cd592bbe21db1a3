"""Datasets made in one run and in many: the same files, by any workers and machines, killed, damaged, out of room."""

import json
import os
import random
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.cli.conftest import write_off
from tests.datasets.test_export import config_for
from zbuf_occlude import DatasetError, Mesh, MeshCollection, MeshError, OptionError
from zbuf_occlude.datasets import pipeline
from zbuf_occlude.datasets import plan as plans
from zbuf_occlude.datasets.folder import locked, partition_files
from zbuf_occlude.datasets.formats import FORMATS
from zbuf_occlude.datasets.generate import GenerateTask, generate, merge, progress_of
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.shard import make_mesh, new_store, sidecar_path
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.datasets.verify import verify
from zbuf_occlude.datasets.workers import Done, Task, run_here
from zbuf_occlude.meshes.collection import MeshEntry

pytestmark = pytest.mark.usefixtures("no_pictures")
CONFIG = DatasetConfig(method="oracle", views="fibonacci:5", n_points=64, sample_size=64)
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


def small(monkeypatch: pytest.MonkeyPatch, *, per_file: int, per_shard: int) -> None:
    """Cut datasets finely."""
    monkeypatch.setattr(plans, "CLOUDS_PER_FILE", per_file)
    monkeypatch.setattr(plans, "MIN_PER_SHARD", per_shard)
    monkeypatch.setattr(plans, "FILES_PER_SHARD", per_shard)


@pytest.fixture
def plan(monkeypatch: pytest.MonkeyPatch) -> Plan:
    """300 clouds of 60 meshes, in seven shards of some 45 clouds, three or four files each."""
    small(monkeypatch, per_file=16, per_shard=55)
    plan = Plan(collection(60), CONFIG)
    assert [len(plan.shards), len(plan.files)] == [7, 22]
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
    skipped = ("manifest.json", "contact_sheet.png", "shards/")
    return {name: path.read_bytes() for name, path in found.items() if not name.startswith(skipped)}


class Killed(BaseException):
    """As by SIGKILL: nothing is tidied up."""


def killed_after(n_jobs: int) -> Callable[[Task, list[Any], Done], None]:
    """Return an engine that is killed when it has done this many jobs."""

    def run(task: Task, jobs: list[Any], done: Done) -> None:
        left = n_jobs

        def stop(job: Any, result: object) -> None:
            nonlocal left
            if not left:
                raise Killed
            left -= 1
            done(job, result)

        run_here(task, jobs, stop)

    return run


def shuffled(task: Task, jobs: list[Any], done: Done) -> None:
    """As many workers would do them: no two jobs in the order in which one would."""
    rng, left = random.Random(3), list(jobs)
    while left:
        job = left.pop(rng.randrange(len(left)))
        done(job, task.do(job, None))


def test_same_files_in_any_order_and_by_any_number_of_machines(
    plan: Plan, whole: dict[str, bytes], tmp_path: Path
) -> None:
    generate(plan, tmp_path / "shuffled", run=shuffled)
    machines = tmp_path / "machines"
    generate(plan, machines, share=(1, 2))
    with pytest.raises(DatasetError, match=r"must have all 7 shards; shard 0 is not done.* Run the"):
        merge(plan, machines)
    assert generate(plan, machines, share=(0, 2)) == {}
    document = merge(plan, machines)
    assert merge(plan, machines) == document, "a second one finds it done"
    assert whole == files(tmp_path / "shuffled") == files(machines)
    assert verify(machines, None).faults == []
    assert partition_files(machines, plan)[1] == []


def test_files_mix_the_clouds_of_the_meshes_of_a_shard(plan: Plan, whole: dict[str, bytes], made_once: Path) -> None:
    source = open_dataset(made_once)
    assert source.n_clouds == {"train": 240, "test": 60}
    seen, n_met = [], []
    for split in source.order:
        for _, numbers in source.files(split):
            records = source.take(numbers)
            assert sum(set(records["mesh_id"]) <= set(ids.tolist()) for ids in plan.shards) == 1
            seen += zip(records["mesh_id"].tolist(), records["view_id"].tolist(), strict=True)
            if split == "train":
                assert 0 < records["label"].sum() < len(records), "both classes"
                n_met.append(len(set(records["mesh_id"])))
    assert sorted(seen) == [(mesh, view) for mesh in range(60) for view in range(5)], "each cloud once"
    assert np.mean(n_met) > 6, "a file of a third of ten objects' clouds has most of the objects"


@pytest.mark.parametrize(
    ("n_meshes", "n_views", "n_shards", "n_files"),
    [(10, 10, 1, 1), (108, 100, 54, 54), (175, 100, 88, 88), (20_000, 100, 247, 988), (3, 1_000, 3, 3)],
)
def test_the_size_of_a_shard_is_by_the_dataset_alone(n_meshes: int, n_views: int, n_shards: int, n_files: int) -> None:
    entries = (MeshEntry(f"m{i}", "ball", "train", partial(tetrahedron, i)) for i in range(n_meshes))
    plan = Plan(MeshCollection(entries), replace(CONFIG, views=f"fibonacci:{n_views}"))
    assert [len(plan.shards), len(plan.files)] == [n_shards, n_files]
    large = Plan(plan.meshes, replace(plan.config, sample_size=100_000))
    assert max(map(len, large.shards)) * n_views * 1.6e6 <= 2**29 or len(large.shards) == n_meshes


@pytest.mark.parametrize("format", ["hdf5", "packed", "pairs"])
def test_a_shard_takes_no_more_memory_than_it_may(format: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """However few of an object's points its clouds have, those that a format keeps all take the room."""
    monkeypatch.setattr(plans, "SHARD_BYTES", 2**20)
    entries = (MeshEntry(f"m{i}", "ball", "train", partial(tetrahedron, i)) for i in range(40))
    config = replace(CONFIG, n_points=20_000, sample_size=256, attributes=("normals",), variations=2)
    plan = Plan(MeshCollection(entries), config, format)
    shard, store = max(plan.shards, key=len), new_store(plan)
    for mesh_id in shard.tolist():
        make_mesh(plan, mesh_id, None, store)
    members = getattr(store, "_members", None)
    n_bytes = sum(len(content) for _, content in members) if members else sum(each.nbytes for each in store._records)
    assert 2**19 < n_bytes <= 2**20


@pytest.mark.parametrize("n_shards", [1, 4])
def test_a_killed_run_resumes_and_makes_no_shard_twice(
    plan: Plan, whole: dict[str, bytes], tmp_path: Path, n_shards: int
) -> None:
    out, again = tmp_path / "out", list[Any]()
    with pytest.raises(Killed):
        generate(plan, out, run=killed_after(n_shards))
    (out / ".zbuf-0123456789abcdef.part").write_bytes(b"half of it")

    def run(task: Task, jobs: list[Any], done: Done) -> None:
        run_here(task, jobs, lambda job, result: (again.append(job), done(job, result))[1])

    generate(plan, out, run=run)
    assert files(out) == whole
    assert len(again) == len(plan.shards) - n_shards - 1, "the shard whose sidecar was written is done, too"


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (["seconds"], "long"),
        (["n_clouds"], {"train": "many"}),
        (["failures"], {"m1": 3}),
        (["files", "train", 0, 0], 7),
        (["files", "train"], 7),
        (["sources", "m1"], 7),
        (["sources", "m1"], {"sha256": "", "files": [[1, 2]]}),
        (["blank"], {"m1": [1]}),
        (["counts", "n_clouds"], "many"),
        (["counts", "worst"], ["all", "m1", 0, 0]),
        (["counts", "faces_dropped"], {"duplicate": "many"}),
        (["renderers"], [7]),
        (["more"], 7),
    ],
)
def test_a_sidecar_with_a_value_of_another_type_is_made_again(
    plan: Plan, tmp_path: Path, caplog: pytest.LogCaptureFixture, place: list[Any], value: object
) -> None:
    small_plan = Plan(plan.meshes[:2], plan.config)
    out, path = tmp_path / "out", sidecar_path(tmp_path / "out", 0)
    generate(small_plan, out, share=(0, 2))
    document = part = json.loads(path.read_text())
    for key in place[:-1]:
        part = part[key]
    part[place[-1]] = value
    path.write_text(json.dumps(document))
    assert progress_of(small_plan, out)["to_make_again"] == {"shard 0": "000000.json is damaged"}
    assert generate(small_plan, out)["counts"]["clouds"] == 10
    assert "shard 0 is made again: 000000.json is damaged" in caplog.text


@pytest.mark.parametrize("damage", ["file cut", "file gone", "sidecar cut", "sidecar gone"])
def test_what_is_damaged_is_found_and_made_again(
    plan: Plan, whole: dict[str, bytes], tmp_path: Path, damage: str
) -> None:
    out = tmp_path / "out"
    with pytest.raises(Killed):
        generate(plan, out, run=killed_after(2))
    path = sidecar_path(out, 1) if damage.startswith("sidecar") else next(out.glob("*.h5"))
    os.truncate(path, 100) if damage.endswith("cut") else path.unlink()
    generate(plan, out)
    assert files(out) == whole


def test_a_file_missing_from_a_finished_dataset_is_made_again(
    plan: Plan, whole: dict[str, bytes], made_once: Path
) -> None:
    (made_once / "ply_data_train3.h5").unlink()
    generate(plan, made_once)
    assert files(made_once) == whole


def test_a_full_disk_ends_the_run_and_the_same_command_resumes(
    plan: Plan, whole: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left, replaced = 6, os.replace

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


def test_a_share_overwrites_nothing(plan: Plan, tmp_path: Path) -> None:
    """The second share would remove what the first has made."""
    generate(plan, tmp_path / "out", share=(0, 3))
    made = files(tmp_path / "out")
    with pytest.raises(OptionError, match="--overwrite must go with the whole dataset"):
        generate(plan, tmp_path / "out", share=(1, 3), overwrite=True)
    assert files(tmp_path / "out") == made


def test_two_runs_at_a_time_are_refused_and_shares_are_not(plan: Plan, tmp_path: Path) -> None:
    out = tmp_path / "out"
    generate(plan, out, share=(0, 3))
    code = (
        "import sys; from pathlib import Path; from zbuf_occlude.datasets.folder import locked\n"
        f"with locked(Path({str(out)!r}), shared=True): print('held', flush=True); sys.stdin.read()\n"
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
    with locked(out), pytest.raises(DatasetError, match="one run at a time"):
        generate(plan, out, share=(1, 3))
    assert generate(plan, out)["counts"]["clouds"] == plan.n_clouds


def test_leftovers_of_a_finished_dataset_are_removed_by_a_run_that_is_alone(plan: Plan, tmp_path: Path) -> None:
    """They may be another run's, which makes meshes again that failed."""
    out = tmp_path / "out"
    document, leftover = generate(plan, out), out / ".zbuf-0123456789abcdef.part"
    leftover.write_bytes(b"half of it")
    with locked(out), pytest.raises(DatasetError, match="one run at a time"):
        generate(plan, out)
    assert leftover.exists()
    assert generate(plan, out) == document
    assert not leftover.exists()


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
    plan = Plan(MeshCollection(entries), config_for(row, n_points, 32), row.name)
    n = plan.clouds_per_mesh
    small(monkeypatch, per_file=n + 1, per_shard=2 * n)
    assert [len(ids) for ids in plan.shards] == [2, 2, 2]
    document = generate(plan, tmp_path / "one")
    assert list(document["failures"]) == ["m4"]
    assert verify(tmp_path / "one", None).faults == []
    assert partition_files(tmp_path / "one", plan)[1] == []
    for n_jobs in (1, 0):
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


class TestMeshes:
    """What clouds were made of: one of another size is refused and named, one that failed is tried again if asked."""

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
        config = replace(CONFIG, views="fibonacci:130", n_points=50, sample_size=8)  # a mesh a shard
        return Plan(MeshCollection.from_paths(meshes, up=up), config)

    @pytest.mark.parametrize("n_jobs", [3, 9])
    def test_meshes_of_another_size_are_refused(self, meshes: Path, tmp_path: Path, n_jobs: int) -> None:
        out = tmp_path / "out"
        try:
            generate(self.plan(meshes), out, run=killed_after(n_jobs))
        except Killed:
            assert n_jobs < 9
        for number in range(4):
            self.write(meshes / "table" / f"solid_{number}.off", 7.125)
        with pytest.raises(DatasetError, match=r"table/solid_\d\.off has changed since the data in .* were made of it"):
            generate(self.plan(meshes), out)
        assert generate(self.plan(meshes), out, overwrite=True)["counts"]["meshes_failed"] == 0

    def test_which_way_is_up_is_part_of_the_plan(self, meshes: Path, tmp_path: Path) -> None:
        generate(self.plan(meshes), tmp_path / "out", share=(0, 2))
        with pytest.raises(DatasetError, match=r"in which up of table/solid_\d\.off was 'z', and is 'y'"):
            generate(self.plan(meshes, "y"), tmp_path / "out")

    @pytest.mark.parametrize("format", ["hdf5", "packed", "scanobjectnn"])
    @pytest.mark.parametrize("finished", [False, True])
    def test_a_mesh_that_failed_is_made_when_that_is_asked_for(
        self, meshes: Path, tmp_path: Path, finished: bool, format: str
    ) -> None:
        out, bad = tmp_path / "out", meshes / "table" / "solid_0.off"
        sound = bad.read_bytes()
        bad.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n")
        plan = replace(self.plan(meshes), format=format)
        if finished:
            assert list(generate(plan, out)["failures"]) == ["table/solid_0.off"]
        else:
            with pytest.raises(Killed):
                generate(plan, out, run=killed_after(3))
        bad.write_bytes(sound)
        assert list(generate(plan, out)["failures"]) == ["table/solid_0.off"]
        assert generate(plan, out, retry_failed=True)["failures"] == {}
        generate(plan, tmp_path / "fresh")
        assert files(out) == files(tmp_path / "fresh")

    def test_a_mesh_that_is_lost_is_left_out(self, meshes: Path, tmp_path: Path) -> None:
        out, plan = tmp_path / "out", self.plan(meshes)

        class Losing(GenerateTask):
            def do(self, job: int, gl: Any, lost: Any = None, on_mesh: Any = None) -> None:
                super().do(job, gl, {1: "it took longer"})

        def run(task: GenerateTask, jobs: list[Any], done: Done) -> None:  # type: ignore[misc]
            run_here(Losing(task.plan, task.out), jobs, done)

        first = generate(plan, out, run=run)  # type: ignore[arg-type]
        assert first["failures"] == {"table/solid_1.off": "it took longer"}
        assert generate(plan, out) == first
        assert generate(plan, out, retry_failed=True)["failures"] == {}


@pytest.mark.parametrize("format", ["hdf5", "packed"])
def test_scaled_by_the_object_all_clouds_have_the_box_of_its_mesh(tmp_path: Path, format: str) -> None:
    """Few points are drawn, so that their own box is smaller, and another in each variation."""
    mesh = Mesh(np.array([[10.0, 0, 0], [16, 0, 0], [10, 2, 0], [10, 0, 3]]), FACES)
    meshes = MeshCollection([MeshEntry("m", "odd", "train", lambda: mesh)])
    generate(Plan(meshes, replace(CONFIG, n_points=20, variations=3, scale="object"), format), tmp_path)
    source = open_dataset(tmp_path)
    records = np.concatenate([source.take(numbers) for numbers in source.order.values()])
    assert set(records["variation"]) == {0, 1, 2}
    np.testing.assert_allclose(records["centre"], np.broadcast_to([13.0, 1.0, 1.5], (len(records), 3)), rtol=1e-12)
    np.testing.assert_allclose(records["factor"], 1.0 / 6.0, rtol=1e-12)


@pytest.mark.parametrize("format", ["hdf5", "packed"])
@pytest.mark.parametrize(
    ("away", "scale", "fails"), [(1e6, "mesh", True), (1e3, "mesh", False), (1e6, "object", False)]
)
@pytest.mark.parametrize("complete", [False, True])
def test_a_mesh_too_far_from_the_origin_for_float32_is_not_rounded(
    tmp_path: Path, format: str, away: float, scale: str, fails: bool, complete: bool
) -> None:
    far = Mesh(tetrahedron(1).vertices + away, FACES)
    meshes = MeshCollection(
        [MeshEntry("far", "odd", "train", lambda: far), MeshEntry("near", "odd", "train", partial(tetrahedron, 1))]
    )
    document = generate(Plan(meshes, replace(CONFIG, scale=scale, complete=complete), format), tmp_path)
    assert document["failures"].keys() == ({"far"} if fails else set())
    assert verify(tmp_path, meshes, run=run_here).faults == []
    if fails:
        assert "float32 numbers are 0.062 apart" in document["failures"]["far"]  # 2^-4 from 2^19 on
        return
    source = open_dataset(tmp_path)
    for record in (one for numbers in source.order.values() for one in source.take(numbers)):
        x, y, z = (record["data"] / record["factor"] + record["centre"]).T - (away if record["mesh_id"] == 0 else 0.0)
        off = np.abs([x, y, z, (x + y + z - 2.0) / np.sqrt(3.0)]).min(axis=0)  # distance to a plane of its faces
        assert off.max() < 1e-4 * 2.0


def test_a_mesh_for_which_memory_does_not_suffice_fails_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    meshes = collection(4)
    sample_of = pipeline.sample

    def sample(mesh: Mesh, *given: Any) -> Any:
        if mesh.longest_side == 2.0:  # of m1
            np.empty(2**57)
        return sample_of(mesh, *given)

    def load() -> Mesh:
        raise MemoryError

    monkeypatch.setattr(pipeline, "sample", sample)
    meshes = MeshCollection([*meshes, MeshEntry("m9", "odd", "train", load)])
    document = generate(Plan(meshes, CONFIG), tmp_path)
    assert document["failures"].keys() == {"m1", "m9"}
    assert document["failures"]["m1"].startswith("out of memory (Unable to allocate 1.00 EiB")
    assert document["failures"]["m9"].startswith("out of memory. Reduce points")


@pytest.mark.parametrize("size", [1e-60, 1e60])
@pytest.mark.parametrize("config", [{"scale": "metres"}, {"scale": "mesh"}, {"scale": "mesh", "frame": "camera"}])
def test_a_mesh_whose_clouds_float32_cannot_hold_fails_alone(tmp_path: Path, size: float, config: Any) -> None:
    odd = Mesh(tetrahedron(1).vertices * size, FACES)
    meshes = MeshCollection(
        [MeshEntry("odd", "odd", "train", lambda: odd), MeshEntry("near", "odd", "train", partial(tetrahedron, 1))]
    )
    document = generate(Plan(meshes, replace(CONFIG, **config)), tmp_path)
    assert "must suit float32" in document["failures"].pop("odd")
    assert document["failures"] == {}
    assert document["counts"]["meshes"] == 1


def test_a_camera_too_far_away_for_float32_sees_no_cloud(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="must suit float32"):
        generate(Plan(collection(1), replace(CONFIG, scale="mesh", frame="camera", distance=1e7)), tmp_path)


def test_points_far_from_their_camera_lie_on_their_faces_as_far_as_float32_can_tell(tmp_path: Path) -> None:
    """600 units away float32 numbers are 6e-5 apart, of an object 2 units long."""
    config = replace(CONFIG, scale="mesh", frame="camera", distance=300.0, complete=True)
    meshes = MeshCollection([MeshEntry("near", "odd", "train", partial(tetrahedron, 1))])
    generate(Plan(meshes, config), tmp_path)
    assert verify(tmp_path, meshes, run=run_here).faults == []
