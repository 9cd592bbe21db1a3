"""What a dataset's administration costs as it grows: plan, resume, status, merge, verify of many tiny meshes.

    python benchmarks/scale.py [N ...] [--clouds-per-mesh 1] [--points 16] [--workers 2] [--format hdf5]
                               [--json FILE]

For each number of meshes (10,000, 30,000 and 100,000 when none is given) that many files of a tetrahedron lie in class
folders. Their shards are filled with clouds of random numbers: what is measured is all but the making.

    plan      find the files, deal them to groups and shards, write plan.json
    resume    the same command when all shards are done: look at each, and at each mesh's file
    status    as `zbuf-occlude status`, when half of the parts are written
    merge     write all final files and the manifest
    verify    read them all, compare checksums
    again     the same command when the dataset is finished

Each step runs in a process of its own; printed are its seconds, its own greatest memory and its greatest worker's, and
the factor by which the seconds grew, where the meshes grew by another.
"""

import argparse
import json
import multiprocessing
import tempfile
import time
from collections import Counter
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from zbuf_occlude.dataset.claim import claim
from zbuf_occlude.dataset.jobs import Done, Jobs, Making, Task
from zbuf_occlude.dataset.parts import n_parts
from zbuf_occlude.dataset.records import RecordStore
from zbuf_occlude.dataset.sealed import write_sealed
from zbuf_occlude.dataset.shard import Sidecar, data_path, sidecar_path

from zbuf_occlude.cli.status import gather
from zbuf_occlude.dataset.counts import Counts
from zbuf_occlude.dataset.folder import SHARDS, read_plan
from zbuf_occlude.dataset.formats import FORMATS
from zbuf_occlude.dataset.generate import generate, merge, run_here
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.verify import verify
from zbuf_occlude.limits import Limits, resident_gigabytes
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.meshes.mesh_files import origin_unread
from zbuf_occlude.origin import Origin
from zbuf_occlude.workers.local import run_jobs

TETRAHEDRON = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n3 0 2 3\n3 1 2 3\n"
N_CLASSES = 40
MOST: list[float] = []
"""Megabytes that the largest worker had, whenever one was done with a job."""
CAMERA = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -4], [0, 0, 0, 1]])
STEPS = ("plan", "resume", "status", "merge", "verify", "again")


class Made(NamedTuple):
    """Clouds of each mesh, points of each cloud, by how many workers files are written and verified, and as what."""

    n_clouds: int
    size: int
    n_workers: int
    format: str


def plan_of(meshes: Path, made: Made) -> Plan:
    recipe = Recipe(method="oracle", views=f"ring:{made.n_clouds}@30", n_points=made.size, sample_size=made.size)
    return Plan(MeshCollection.from_paths([meshes]), recipe, made.format)


def lay_out(meshes: Path, n: int) -> None:
    """Write the mesh files, 1,000 at most in a folder, a tenth of them for testing."""
    for i in range(n):
        folder = meshes / f"class{i % N_CLASSES}_{i // 20_000}" / ("test" if i // N_CLASSES % 10 == 0 else "train")
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"solid_{i:06d}.off").write_text(TETRAHEDRON)


def origin_of(entry: MeshEntry, sha256: str) -> Origin:
    assert entry.path is not None  # they are files
    return Origin(sha256, origin_unread(entry.path).files)


def fill(plan: Plan, out: Path) -> None:
    """Write all shards, of random clouds."""
    (out / SHARDS).mkdir(exist_ok=True)
    rng, size = np.random.default_rng(0), plan.recipe.equal_size
    sha256 = plan.meshes[0].load().origin.sha256
    for shard, mesh_ids in enumerate(plan.shards):
        store = RecordStore(plan)
        kind = store._kept[0].dtype
        n_clouds, n_whole = Counter[str](), Counter[str]()
        for i in mesh_ids:
            records = np.zeros(plan.clouds_per_mesh, kind)
            records["data"] = rng.uniform(-0.5, 0.5, (len(records), size, 3))
            records["factor"], records["pose"] = 1.0, CAMERA
            records["view_id"], records["n_visible"] = np.arange(len(records)), size
            store.add(i, None, [records])  # type: ignore[arg-type]  # its mesh is not looked at
            n_clouds[plan.meshes[i].split] += len(records)
            n_whole[plan.meshes[i].split] += 1
        runs = store.write(data_path(plan, out, shard), shard)
        origins = {plan.meshes[i].key: origin_of(plan.meshes[i], sha256) for i in mesh_ids}
        counts = Counts(n_clouds=sum(n_clouds.values()), n_checked=64 * len(mesh_ids))
        sidecar = Sidecar(plan.fingerprint, shard, counts, {}, {}, origins, "none", 1.0, n_clouds, n_whole, runs, "")
        write_sealed(sidecar_path(out, shard), sidecar.document)


def watched(task: Task, jobs: list[int], done: Done, n_workers: int) -> None:
    """Have the jobs done by workers, and note the most memory of one of them."""

    def looked(job: int, result: Any) -> Iterable[int]:
        sizes = [resident_gigabytes(child.pid or 0) for child in multiprocessing.active_children()]
        MOST.append(1000 * max(sizes, default=0.0))
        return done(job, result)

    run_jobs(task, jobs, looked, n_workers=n_workers, limits=Limits())


def do(step: str, meshes: Path, out: Path, made: Made) -> None:
    run = partial(watched, n_workers=made.n_workers)
    if step == "plan":
        plan = plan_of(meshes, made)
        assert plan.shards
        claim(plan, out)
    elif step == "resume":
        plan = plan_of(meshes, made)
        claim(plan, out)
        jobs = Jobs(plan, out, range(len(plan.shards)), range(n_parts(plan)), Limits())
        assert min(jobs.first) >= len(plan.shards), "all shards are done"
    elif step == "half":
        plan = read_plan(out)
        parts = range(n_parts(plan) // 2)
        run_here(Making(plan, out, False), [len(plan.shards) + i for i in reversed(parts)], lambda job, result: ())
    elif step == "status":
        report = gather(out)
        assert report["shards_done"] == report["shards"]
        assert 0 < report["parts_written"] < report["parts"]
    elif step == "merge":
        assert merge(read_plan(out), out, run=run)["counts"]["clouds"] == read_plan(out).n_clouds
    elif step == "verify":
        assert not verify(out, None, run=run).faults
    else:
        assert generate(plan_of(meshes, made), out)


def measured(queue: Any, *arguments: Any) -> None:
    began = time.perf_counter()
    do(*arguments)
    seconds, status = time.perf_counter() - began, Path("/proc/self/status").read_text()
    mine = int(status.partition("VmHWM:")[2].split()[0]) / 1e3
    queue.put({"seconds": seconds, "megabytes": mine, "megabytes_of_workers": max(MOST, default=0.0)})


def apart(*arguments: Any) -> dict[str, float]:
    """Do a step in a fresh process."""
    spawn = multiprocessing.get_context("spawn")
    queue = spawn.Queue()
    process = spawn.Process(target=measured, args=(queue, *arguments))
    process.start()
    found: dict[str, float] = queue.get(timeout=3600)
    process.join()
    return found


def told(step: dict[str, float]) -> str:
    return f"{step['seconds']:.1f} s {step['megabytes']:.0f}/{step['megabytes_of_workers']:.0f} MB"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("numbers", nargs="*", type=int, default=[10_000, 30_000, 100_000], metavar="N")
    parser.add_argument("--clouds-per-mesh", type=int, default=1)
    parser.add_argument("--points", type=int, default=16)
    parser.add_argument("--workers", type=int, default=2)
    records = [row.name for row in FORMATS if not (row.keeps_points or row.complete)]
    parser.add_argument("--format", choices=records, default="hdf5")
    parser.add_argument("--json", type=Path)
    known = parser.parse_args()
    made = Made(known.clouds_per_mesh, known.points, known.workers, known.format)
    rows: list[dict[str, Any]] = []
    for n in known.numbers:
        with tempfile.TemporaryDirectory() as name:
            meshes, out = Path(name, "meshes"), Path(name, "out")
            lay_out(meshes, n)
            row: dict[str, Any] = {"meshes": n}
            for step in STEPS:
                row[step] = apart(step, meshes, out, made)
                if step == "plan":
                    fill(plan_of(meshes, made), out)
                elif step == "resume":
                    do("half", meshes, out, made)
            row["parts"] = n_parts(read_plan(out))
            rows.append(row)
            print(f"{n:,} meshes: " + ", ".join(f"{step} {told(row[step])}" for step in STEPS), flush=True)
            if len(rows) > 1:
                before = rows[-2]
                grown = {step: row[step]["seconds"] / before[step]["seconds"] for step in STEPS}
                print(
                    f"  x {n / before['meshes']:.1f} meshes: " + ", ".join(f"{k} x {v:.1f}" for k, v in grown.items())
                )
    if known.json:
        known.json.write_text(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
