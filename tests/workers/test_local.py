"""The local engine: dead, hanging and swelling workers, a broken plan, a dead parent."""

import os
import subprocess
import sys
from functools import partial
from multiprocessing.context import ForkServerProcess
from pathlib import Path

import numba
import numpy as np
import pytest

from tests.dataset.shards import make_shards
from tests.workers.loads import bad, ball, hang, suicide, swell, tell
from tests.processes import ended
from zbuf_occlude import DatasetError
from zbuf_occlude.dataset.clouds import record_type
from zbuf_occlude.dataset.generate import merge
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.shard import data_path, look_at, run_shard
from zbuf_occlude.workers import local, server, supervisor
from zbuf_occlude.workers.local import run_jobs
from zbuf_occlude.workers.supervisor import Message
from zbuf_occlude.limits import Limits
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry

RECIPE = Recipe(method="oracle", views="fibonacci:60", n_points=50, sample_size=8)
AMPLE = Limits(seconds=60, gigabytes=8)


def plan_of(*loads: object) -> Plan:
    """Two meshes a shard, made by these functions of their number."""
    entries = [MeshEntry(f"m{i}", "ball", "train", partial(f, i)) for i, f in enumerate(loads)]  # type: ignore[arg-type]
    return Plan(MeshCollection(entries), RECIPE)


def contents(plan: Plan, out: Path) -> list[bytes]:
    return [data_path(plan, out, shard).read_bytes() for shard in range(len(plan.shards))]


def records(plan: Plan, out: Path, shard: int) -> np.ndarray:
    return np.fromfile(data_path(plan, out, shard), record_type(plan.recipe))


def failures(plan: Plan, out: Path) -> dict[str, str]:
    sidecars = [look_at(plan, out, shard)[0] for shard in range(len(plan.shards))]
    return {key: why for sidecar in sidecars if sidecar for key, why in sidecar.failures.items()}


@pytest.fixture
def out(tmp_path: Path) -> Path:
    (tmp_path / "out").mkdir()
    return tmp_path / "out"


def run(plan: Plan, out: Path, limits: Limits = AMPLE, n_workers: int = 2) -> None:
    make_shards(plan, out, partial(run_jobs, n_workers=n_workers, limits=limits))


def test_workers_make_what_one_process_makes(out: Path, tmp_path: Path) -> None:
    plan = plan_of(*[ball] * 6)
    assert len(plan.shards) == 3
    run(plan, out)
    alone = tmp_path / "alone"
    alone.mkdir()
    make_shards(plan, alone)
    assert contents(plan, out) == contents(plan, alone)


def test_killed_workers_change_nothing(out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = plan_of(*[ball] * 12)
    killed = []

    class Doomed(local.LocalWorker):
        def listen(self) -> list[Message]:
            messages = super().listen()
            if len(killed) < 4 and any(kind == "mesh" for kind, _ in messages):
                killed.append(self.process.pid)  # it is somewhere in its work
                self.process.kill()
            return messages

    monkeypatch.setattr(local, "LocalWorker", Doomed)
    run(plan, out)
    assert len(killed) == 4
    assert failures(plan, out) == {}
    alone = tmp_path / "alone"
    alone.mkdir()
    make_shards(plan, alone)
    assert contents(plan, out) == contents(plan, alone)


def test_a_mesh_that_kills_its_workers_is_given_up(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervisor, "DEATHS_PER_MESH", 2)
    plan = plan_of(ball, suicide, ball, ball)
    run(plan, out)
    assert failures(plan, out) == {"m1": "the worker was killed by signal 9 at it, 2 times"}
    assert records(plan, out, 0)["mesh_id"].tolist() == [0] * 60


@pytest.mark.parametrize(
    ("load", "limits", "reason"),
    [
        (hang, Limits(seconds=4), "a mesh may take 4 seconds; this one took longer. Raise --mesh-seconds."),
        (
            swell,
            Limits(gigabytes=1.2),
            "a mesh may take 1.2 GB of memory; this one took more. Raise --mesh-gigabytes.",
        ),
    ],
)
def test_a_mesh_that_hangs_or_swells_is_given_up(out: Path, load: object, limits: Limits, reason: str) -> None:
    plan = plan_of(ball, load)
    run(plan, out, limits)
    assert failures(plan, out) == {"m1": reason}
    assert set(records(plan, out, 0)["mesh_id"]) == {0}, "the other mesh of its shard is made"


def test_a_full_disk_ends_the_run_and_keeps_what_is_done(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = plan_of(ball, ball, ball)
    run_shard(plan, 0, out, None)
    before = data_path(plan, out, 0).read_bytes()
    # a folder where the second shard's records belong: writing them fails as a full disk does
    data_path(plan, out, 1).mkdir()
    with pytest.raises(DatasetError, match=r"What was finished is kept, and the same command resumes\."):
        run(plan, out)
    data_path(plan, out, 1).rmdir()
    run(plan, out)
    assert data_path(plan, out, 0).read_bytes() == before
    assert not list(out.rglob("*.part"))


def test_what_follows_the_last_mesh_is_told(out: Path) -> None:
    """Else its seconds, and deaths while the shard is written, would be the last mesh's."""
    told: list[int | None] = []
    run_shard(plan_of(ball, ball), 0, out, None, on_mesh=told.append)
    assert told == [0, 1, None]


def test_nothing_half_written_is_taken_for_done(out: Path) -> None:
    plan = plan_of(ball, ball, ball)
    run_shard(plan, 0, out, None)
    data_path(plan, out, 1).write_bytes(b"half a file, and no sidecar")
    assert look_at(plan, out, 1) == (None, "")
    with pytest.raises(DatasetError, match="all 2 shards must be done; shard 1 is not"):
        merge(plan, out)
    run(plan, out)
    assert len(records(plan, out, 1)) == 60


def test_a_shard_of_another_plan_is_an_error(out: Path) -> None:
    plan = plan_of(ball)
    run_shard(plan, 0, out, None)
    with pytest.raises(DatasetError, match="must belong to plan"):
        look_at(plan_of(ball, ball), out, 0)


def test_workers_end_with_their_parent(tmp_path: Path) -> None:
    script = (
        "import sys; from pathlib import Path; from tests.workers.test_local import *\n"
        "if __name__ == '__main__':\n"
        "    out = Path(sys.argv[1]); out.mkdir()\n"
        "    class Telling(local.LocalWorker):\n"
        "        def listen(self):\n"
        "            messages = super().listen()\n"
        "            if any(kind == 'mesh' for kind, _ in messages): print(self.process.pid, flush=True)\n"
        "            return messages\n"
        "    local.LocalWorker = Telling\n"
        "    run(plan_of(hang, hang, hang), out)\n"
    )
    parent_file = tmp_path / "parent.py"
    parent_file.write_text(script)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    parent = subprocess.Popen(
        [sys.executable, str(parent_file), str(tmp_path / "out")], stdout=subprocess.PIPE, text=True, env=environment
    )
    assert parent.stdout is not None
    workers = [int(parent.stdout.readline()) for _ in range(2)]
    parent.kill()
    parent.wait()
    assert all(ended(pid) for pid in workers), "the workers outlived their parent"
    parent.stdout.close()


def test_a_mesh_error_is_a_failure_not_an_end(out: Path) -> None:
    plan = plan_of(ball, bad, ball)
    run(plan, out)
    assert failures(plan, out) == {"m1": "m1 is bad"}


def test_workers_find_the_environment_of_now(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not that of the first run of this process, when the server that they are forked from began."""
    for value in ("one", "two"):
        monkeypatch.setenv("TOLD_TO_WORKERS", value)
        out = tmp_path / value
        out.mkdir()
        plan = plan_of(*[tell] * 4)
        run(plan, out, n_workers=2)
        n = min(numba.config.NUMBA_NUM_THREADS, max(1, (os.cpu_count() or 1) // 2))
        assert failures(plan, out) == {f"m{i}": f"{value}, {n} threads" for i in range(4)}


@pytest.mark.skipif(sys.platform != "linux", reason="workers are forked on Linux alone")
def test_nothing_that_a_fork_would_break_is_where_workers_are_forked_from() -> None:
    program = (
        "import gc, os, sys, zbuf_occlude.workers.warm, numba\n"
        "assert len(os.listdir('/proc/self/task')) == 1, 'threads'\n"
        "assert not {'moderngl', 'glcontext'} & set(sys.modules), 'OpenGL'\n"
        "try: numba.threading_layer()\n"
        "except ValueError: pass\n"
        "else: raise AssertionError('OpenMP')\n"
        "assert gc.isenabled() and gc.get_freeze_count() > 100_000, 'garbage'\n"
        "assert 'scipy' not in sys.modules, 'hidden from numba only, and only from its import'\n"
    )
    environment = {**os.environ, **server.ENVIRONMENT}
    child = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=300
    )
    assert child.returncode == 0, child.stderr


@pytest.mark.long
def test_a_worker_that_was_killed_leaves_no_words_of_pythons_own(tmp_path: Path) -> None:
    """Of a mesh that takes too long the summary says all there is to say; numba's locks are nobody's business."""
    options = [
        "--limit=1",
        "--method=oracle",
        "--views=paper100",
        "--points=50000",
        "--mesh-seconds=0.001",
        "--workers=1",
    ]
    command = [sys.executable, "-m", "zbuf_occlude", "generate", *options, "--out", str(tmp_path / "out")]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 1
    assert "a mesh may take 0.001 seconds; this one took longer" in ended.stderr
    assert "resource_tracker" not in ended.stderr
    assert ended.stderr.rstrip().splitlines()[-1].startswith("error: ")


def test_a_temporary_folder_of_a_long_name_is_no_obstacle(tmp_path: Path) -> None:
    """An address of a process that lies there would be too long for the system."""
    folder = tmp_path / ("long" * 30)
    folder.mkdir()
    options = ["--limit=1", "--method=oracle", "--views=ring:1@0", "--points=50", "--sample-size=8", "--workers=1"]
    command = [sys.executable, "-m", "zbuf_occlude", "generate", *options, "--out", str(tmp_path / "out")]
    environment = {**os.environ, "TMPDIR": str(folder)}
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert (tmp_path / "out" / "manifest.json").is_file()


@pytest.mark.skipif(sys.platform != "linux", reason="workers are forked on Linux alone")
@pytest.mark.parametrize("n_dead", [2, 3])
def test_servers_that_die_are_replaced_and_three_in_a_row_an_error(
    out: Path, monkeypatch: pytest.MonkeyPatch, n_dead: int
) -> None:
    """Not an interruption, which is what the end of a file means to a command line."""
    deaths, fork = iter(range(n_dead)), ForkServerProcess._Popen

    def lost(process: object) -> object:
        if next(deaths, None) is None:
            return fork(process)
        raise EOFError

    monkeypatch.setattr(ForkServerProcess, "_Popen", staticmethod(lost))
    if n_dead < local.SERVERS:
        run(plan_of(ball), out, n_workers=1)
    else:
        with pytest.raises(DatasetError, match="the process that workers are forked from must live; 3 in a row ended"):
            run(plan_of(ball), out, n_workers=1)


def test_an_interrupt_while_the_server_starts_is_no_traceback() -> None:
    code = (
        "import multiprocessing, os, signal, time\n"
        "from zbuf_occlude.workers.server import start_server\n"
        "signal.signal(signal.SIGINT, lambda *_: None)\n"
        "start_server()\n"
        "for _ in range(40):\n"
        "    time.sleep(0.02)\n"
        "    os.killpg(0, signal.SIGINT)\n"
        "child = multiprocessing.get_context('forkserver').Process(target=print, args=('forked',))\n"
        "child.start()\n"
        "child.join()\n"
    )
    outcome = subprocess.run(
        [sys.executable, "-c", code], start_new_session=True, capture_output=True, text=True, timeout=60, check=True
    )
    assert (outcome.stdout, outcome.stderr) == ("forked\n", ""), "and the server goes on"
