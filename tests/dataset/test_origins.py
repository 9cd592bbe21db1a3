"""What clouds were made of: a mesh that changed is refused and named, one that failed is tried again."""

import json
import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import write_off
from tests.dataset.shards import make_shards
from zbuf_occlude import MeshCollection, load_mesh, shapes
from zbuf_occlude.dataset.generate import generate, run_here
from zbuf_occlude.dataset.jobs import Done, Task
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.shard import look_at, run_shard
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.limits import GivenUp, Limits
from zbuf_occlude.meshes.mesh_files import origin_now
from zbuf_occlude.origin import Origin
from zbuf_occlude.shapes import families

RECIPE = Recipe(method="oracle", views="fibonacci:60", n_points=50, sample_size=8)  # two meshes a shard
FACES = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])


def tetrahedron(path: Path, size: float = 1.0) -> Path:
    return write_off(path, size * np.vstack([np.zeros(3), np.eye(3)]), FACES)


@pytest.fixture
def meshes(tmp_path: Path) -> Path:
    for number in range(4):
        tetrahedron(tmp_path / "meshes" / "solid" / f"solid_{number}.off", 1 + number)
    return tmp_path / "meshes"


def plan_of(meshes: Path, up: str | None = None) -> Plan:
    return Plan(MeshCollection.from_paths(meshes, up=up), RECIPE)


@pytest.mark.parametrize("finished", [False, True])
def test_other_meshes_of_the_same_names_are_refused(meshes: Path, tmp_path: Path, finished: bool) -> None:
    out = tmp_path / "out"
    generate(plan_of(meshes), out, share=(0, 1 if finished else 2))
    tetrahedron(meshes / "solid" / "solid_1.off", 7.0)
    with pytest.raises(DatasetError, match=r"solid/solid_1\.off must be what the data in .* were made of, sha256 "):
        generate(plan_of(meshes), out)
    assert generate(plan_of(meshes), out, overwrite=True)["counts"]["meshes_failed"] == 0


def test_a_mesh_that_changed_while_others_were_made_is_refused(meshes: Path, tmp_path: Path) -> None:
    def run(task: Task, jobs: list[int], done: Done) -> None:
        run_here(task, jobs, done)
        tetrahedron(meshes / "solid" / "solid_0.off", 7.0)

    with pytest.raises(DatasetError, match=r"solid/solid_0\.off must be what the data"):
        generate(plan_of(meshes), tmp_path / "out", run=run)


def half_written(meshes: Path, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two shards of 240 clouds in five files, of which three are written; and one of those is lost."""
    monkeypatch.setattr("zbuf_occlude.dataset.plan.CLOUDS_PER_FILE", 48)

    def run(task: Task, jobs: list[int], done: Done) -> None:
        def stop(job: int, result: object) -> Iterable[int]:
            if job == 4:
                raise KeyboardInterrupt
            return done(job, result)

        run_here(task, jobs, stop)

    with pytest.raises(KeyboardInterrupt):
        generate(plan_of(meshes), out, run=run)
    written = sorted(out.glob("*.h5"))
    assert len(written) == 3
    written[-1].unlink()


def test_a_mesh_that_changed_is_refused_where_files_hold_it_and_its_shard_is_lost(
    meshes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    half_written(meshes, tmp_path / "out", monkeypatch)
    tetrahedron(meshes / "solid" / "solid_1.off", 7.0)
    with pytest.raises(DatasetError, match=r"solid/solid_1\.off must be what the data in .* were made of, sha256 "):
        generate(plan_of(meshes), tmp_path / "out")


def test_a_mesh_that_failed_and_now_would_not_is_refused_where_its_shard_is_lost(
    meshes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sound = (meshes / "solid" / "solid_1.off").read_bytes()
    (meshes / "solid" / "solid_1.off").write_bytes(b"OFF")
    half_written(meshes, tmp_path / "out", monkeypatch)
    (meshes / "solid" / "solid_1.off").write_bytes(sound)
    with pytest.raises(DatasetError, match=r"solid/solid_1\.off must fail as it did when the files in .* were made"):
        generate(plan_of(meshes), tmp_path / "out")


def test_clouds_that_only_some_files_have_are_noticed_in_the_end(
    meshes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All that was known of the shards is lost too, and one mesh fails in the second run alone."""
    half_written(meshes, tmp_path / "out", monkeypatch)
    for path in (tmp_path / "out" / "shards").glob("00*.json"):
        path.unlink()
    (meshes / "solid" / "solid_1.off").write_bytes(b"OFF")
    with pytest.raises(
        DatasetError, match=r"must hold the clouds that were made, .'train': 180.; they hold .'train': 2"
    ):
        generate(plan_of(meshes), tmp_path / "out")


def test_files_of_the_same_content_are_the_same_mesh(meshes: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    first = generate(plan_of(meshes), out)
    path = meshes / "solid" / "solid_1.off"
    os.utime(path, ns=(0, 0))
    assert generate(plan_of(meshes), out) == first
    digest = first["origins"]["solid/solid_1.off"]["sha256"]
    assert digest == origin_now(path, Origin.from_document(first["origins"]["solid/solid_1.off"])).sha256
    assert digest == load_mesh(path).origin.sha256


def test_files_that_look_the_same_are_not_read(meshes: Path) -> None:
    path = meshes / "solid" / "solid_1.off"
    origin = load_mesh(path).origin
    status = path.stat()
    path.write_bytes(b"\0" * status.st_size)
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert origin_now(path, origin) is origin
    os.utime(path, ns=(0, 0))
    assert origin_now(path, origin).sha256 != origin.sha256
    path.unlink()
    assert origin_now(path, origin).sha256 == ""


def test_which_way_is_up_is_part_of_the_plan(meshes: Path, tmp_path: Path) -> None:
    generate(plan_of(meshes), tmp_path / "out", share=(0, 2))
    with pytest.raises(DatasetError, match=r"in which up of solid/solid_\d\.off was 'z', and is 'y'"):
        generate(plan_of(meshes, "y"), tmp_path / "out")


def test_the_buffers_of_gltf_are_part_of_a_mesh(tmp_path: Path) -> None:
    from trimesh.creation import box

    for name, content in box().scene().export(file_type="gltf").items():
        (tmp_path / name).write_bytes(content)
    path = tmp_path / "model.gltf"
    origin = load_mesh(path).origin
    assert origin.files[0].name == "model.gltf"
    assert len(origin.files) > 1
    assert origin_now(path, origin) is origin
    buffer = tmp_path / origin.files[1].name
    os.utime(buffer, ns=(0, 0))
    assert origin_now(path, origin).sha256 == origin.sha256
    content = bytearray(buffer.read_bytes())
    content[3] ^= 1
    buffer.write_bytes(content)
    assert origin_now(path, origin).sha256 != origin.sha256


def test_a_shape_of_another_version_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recipe = Recipe(method="oracle", views="fibonacci:60", n_points=50, sample_size=8)
    generate(Plan(shapes.collection(n_members=1), recipe), tmp_path, share=(0, 2))
    monkeypatch.setattr("zbuf_occlude.shapes.families.VERSION", 1000)
    with pytest.raises(DatasetError, match="builtin/airplane/train/airplane_0000 must be what the data"):
        generate(Plan(shapes.collection(n_members=1), recipe), tmp_path)


def test_a_change_of_the_shapes_raises_their_version() -> None:
    """If this fails because a shape was changed, raise `families.VERSION`, and renew the figures."""
    made = [shapes.make(label, index) for label in shapes.CLASSES for index in range(8)]
    assert (families.VERSION, sum(len(mesh.vertices) for mesh in made), sum(len(mesh.faces) for mesh in made)) == (
        1,
        252746,
        144237,
    )
    assert sum(np.abs(mesh.vertices).sum() for mesh in made) == pytest.approx(24911071.00949546, rel=1e-9)
    assert sum(mesh.areas.sum() for mesh in made) == pytest.approx(5558860.6347326115, rel=1e-9)


def test_a_mesh_that_failed_is_tried_again_when_it_changed(meshes: Path, tmp_path: Path) -> None:
    out, bad = tmp_path / "out", meshes / "solid" / "solid_0.off"
    bad.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n")
    generate(plan_of(meshes), out, share=(0, 2))
    stamp = (out / "shards" / "000000.json").stat().st_mtime_ns
    generate(plan_of(meshes), out, share=(0, 2))
    assert (out / "shards" / "000000.json").stat().st_mtime_ns == stamp, "tried again, though nothing changed"
    tetrahedron(bad)
    assert generate(plan_of(meshes), out)["failures"] == {}


def test_a_finished_dataset_says_that_a_mesh_which_failed_may_be_made_now(meshes: Path, tmp_path: Path) -> None:
    out, bad = tmp_path / "out", meshes / "solid" / "solid_0.off"
    bad.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n")
    first = generate(plan_of(meshes), out)
    assert list(first["failures"]) == list(first["tries"]) == ["solid/solid_0.off"]
    assert generate(plan_of(meshes), out) == first
    tetrahedron(bad)
    with pytest.raises(DatasetError, match=r"solid/solid_0\.off failed when .* and may be made now: .*--overwrite"):
        generate(plan_of(meshes), out)
    assert generate(plan_of(meshes), out, overwrite=True)["failures"] == {}


def test_a_finished_dataset_says_that_limits_are_wider_now(meshes: Path, tmp_path: Path) -> None:
    out, plan = tmp_path / "out", plan_of(meshes)

    def run(task: Task, jobs: list[int], done: Done) -> None:
        for shard in jobs:
            run_shard(plan, shard, out, None, lost={1: GivenUp("it took longer", Limits(60, 4))})
            run_here(task, list(done(shard, None)), done)

    first = generate(plan, out, run=run, limits=Limits(60, 4))
    assert list(first["failures"]) == ["solid/solid_1.off"]
    for narrower in (Limits(60, 4), Limits(20, 4), Limits(60, 3)):
        assert generate(plan, out, limits=narrower) == first
    for wider in (Limits(61, 4), Limits(60, 5), None):
        with pytest.raises(DatasetError, match=r"solid/solid_1\.off failed when .* what a mesh may take, is another"):
            generate(plan, out, limits=wider)


def test_a_mesh_that_was_given_up_is_tried_again_within_other_limits(meshes: Path, tmp_path: Path) -> None:
    plan, out, few = plan_of(meshes), tmp_path / "out", Limits(seconds=1)
    generate(plan, out, share=(1, 2))
    run_shard(plan, 0, out, None, lost={1: GivenUp("it took longer", few)})
    made: list[int] = []

    def run(task: Task, jobs: list[int], done: Done) -> None:
        made.extend(jobs)
        run_here(task, jobs, done)

    make_shards(plan, out, run, few)
    assert made == []
    assert json.loads((out / "shards" / "000000.json").read_text())["failures"] == {
        "solid/solid_1.off": "it took longer"
    }
    make_shards(plan, out, run, Limits(seconds=2))
    assert made == [0]
    sidecar, fault = look_at(plan, out, 0)
    assert (sidecar is not None and sidecar.failures, fault) == ({}, "")
