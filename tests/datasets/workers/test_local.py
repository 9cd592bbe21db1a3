"""The local engine: dead, hanging and swelling workers, a broken plan, a dead parent."""

import os
import subprocess
import sys
import time
from functools import partial
from multiprocessing.context import ForkServerProcess
from pathlib import Path

import numba
import numpy as np
import pytest

from tests.datasets.test_generate import files
from tests.datasets.workers.loads import bad, ball, hang, suicide, swell, tell, warn
from tests.processes import ended, python
from zbuf_occlude import DatasetError
from zbuf_occlude.base.cores import n_cores
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.datasets.folder import claim_folder
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.datasets.workers import local, pool
from zbuf_occlude.datasets.workers.local import run_local
from zbuf_occlude.datasets.workers.pool import Message
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry

pytestmark = pytest.mark.usefixtures("no_pictures")
CONFIG = DatasetConfig(method="oracle", views="fibonacci:100", n_points=50, sample_size=8)
AMPLE = Limits(seconds=60, gigabytes=8)


def plan_of(*loads: object) -> Plan:
    """Two meshes a shard, made by these functions of their number."""
    entries = [MeshEntry(f"m{i}", "ball", "train", partial(f, i)) for i, f in enumerate(loads)]  # type: ignore[arg-type]
    return Plan(MeshCollection(entries), CONFIG)


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "out"


def run(plan: Plan, out: Path, limits: Limits = AMPLE, n_workers: int = 2) -> dict[str, str]:
    """Make a dataset; return the failures."""
    document = generate(plan, out, run=partial(run_local, n_workers=n_workers, limits=limits))
    failures: dict[str, str] = document["failures"]
    return failures


def mesh_ids(out: Path) -> list[int]:
    source = open_dataset(out)
    return np.unique(source.take(source.order["train"])["mesh_id"]).tolist()


def test_the_log_of_workers_is_the_coordinators(out: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert run(plan_of(warn, ball, warn, warn), out) == {}
    said = [record.getMessage() for record in caplog.records if record.name == "zbuf_occlude.meshes"]  # not: compiling
    assert sorted(said) == [f"m{number} is a ball" for number in (0, 2, 3)]


@pytest.mark.parametrize("moment", ["mesh", "done"])
def test_killed_workers_change_nothing(out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str) -> None:
    plan = plan_of(*[ball] * 12)
    killed = []

    class Doomed(local.LocalWorker):
        def listen(self) -> list[Message]:
            messages = super().listen()
            if len(killed) < 4 and any(kind == moment for kind, _ in messages):
                killed.append(self.process.pid)  # it is somewhere in its work
                self.process.kill()
            return messages

    monkeypatch.setattr(local, "LocalWorker", Doomed)
    assert run(plan, out) == {}
    assert len(killed) == 4
    generate(plan, tmp_path / "alone")
    assert files(out) == files(tmp_path / "alone")


@pytest.mark.parametrize(
    ("load", "limits", "words"),
    [
        (hang, Limits(seconds=12), ("timed out", "12 s", "--mesh-seconds")),
        (swell, Limits(gigabytes=1.2), ("1.2 GB", "--mesh-gigabytes")),
        (suicide, AMPLE, ("killed by signal 9 at it, 2 times",)),
        (bad, AMPLE, ("m1 is bad",)),
    ],
)
def test_a_mesh_that_cannot_be_made_is_a_failure(
    out: Path, monkeypatch: pytest.MonkeyPatch, load: object, limits: Limits, words: tuple[str, ...]
) -> None:
    monkeypatch.setattr(pool, "KILLS", 2)
    failures = run(plan_of(ball, load), out, limits)
    assert list(failures) == ["m1"]
    assert all(word in failures["m1"] for word in words)
    assert mesh_ids(out) == [0], "the other mesh of its shard is made"


def test_an_error_that_any_worker_would_meet_ends_the_run(out: Path) -> None:
    """A folder where a file belongs: writing it fails as it does on a full disk."""
    plan = plan_of(ball, ball, ball)
    claim_folder(plan, out)
    (out / "ply_data_train0.h5").mkdir()
    with pytest.raises(DatasetError, match=r"What was finished is kept, and the same command resumes\."):
        run(plan, out)
    (out / "ply_data_train0.h5").rmdir()
    assert run(plan, out) == {}
    assert not list(out.rglob("*.part"))


def test_workers_end_with_their_parent(tmp_path: Path) -> None:
    script = (
        "import sys; from pathlib import Path; from tests.datasets.workers.test_local import *\n"
        "if __name__ == '__main__':\n"
        "    out = Path(sys.argv[1])\n"
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
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    parent = subprocess.Popen(
        [sys.executable, str(parent_file), str(tmp_path / "out")], stdout=subprocess.PIPE, text=True, env=environment
    )
    assert parent.stdout is not None
    workers = [int(parent.stdout.readline()) for _ in range(2)]
    parent.kill()
    parent.wait()
    assert all(ended(pid) for pid in workers), "the workers outlived their parent"
    parent.stdout.close()


def test_workers_find_the_environment_of_now(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not that of the first run of this process, when the server that they are forked from began."""
    for value in ("one", "two"):
        monkeypatch.setenv("TOLD_TO_WORKERS", value)
        failures = run(plan_of(*[tell] * 4, ball), tmp_path / value, n_workers=2)
        n = min(numba.config.NUMBA_NUM_THREADS, max(1, n_cores() // 2))
        assert failures == {f"m{i}": f"{value}, {n} threads" for i in range(4)}


@pytest.mark.skipif(sys.platform != "linux", reason="workers are forked on Linux alone")
def test_nothing_that_a_fork_would_break_is_where_workers_are_forked_from() -> None:
    program = (
        "import os, sys\n"
        f"for name in {local.PRELOAD}: __import__(name)\n"
        "import numba\n"
        "assert len(os.listdir('/proc/self/task')) == 1, 'threads'\n"
        "assert not {'moderngl', 'glcontext'} & set(sys.modules), 'OpenGL'\n"
        "try: numba.threading_layer()\n"
        "except ValueError: pass\n"
        "else: raise AssertionError('OpenMP')\n"
    )
    environment = {**os.environ, local.THREADS: "1"}
    child = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=300
    )
    assert child.returncode == 0, child.stderr


@pytest.mark.parametrize(("coordinator", "said"), [("os.getppid()", "goes on\n"), ("os.getpid()", "")])
def test_a_server_ends_with_its_coordinator_while_it_imports(coordinator: str, said: str) -> None:
    child = python(
        "-c", f"import os\nfrom {local.PRELOAD[0]} import end_without\nend_without({coordinator})\nprint('goes on')"
    )
    assert (child.returncode, child.stdout) == (0, said), child.stderr


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
def test_a_server_that_was_killed_is_replaced(out: Path, tmp_path: Path) -> None:
    """With the workers that it has forked."""
    program = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from tests.datasets.workers.test_local import *\n"
        "class Orphaned(local.LocalWorker):\n"
        "    def listen(self):\n"
        "        messages = super().listen()\n"
        "        if messages and not killed and messages[-1][0] == 'mesh':\n"
        "            killed.append(int(Path(f'/proc/{self.process.pid}/stat').read_text().split()[3]))\n"
        "            os.kill(killed[0], signal.SIGKILL)\n"
        "        return messages\n"
        "killed, local.LocalWorker = [], Orphaned\n"
        "assert run(plan_of(*[ball] * 12), Path(sys.argv[1])) == {}\n"
        "assert killed\n"
    )
    child = subprocess.run([sys.executable, "-c", program, str(out)], capture_output=True, text=True, timeout=300)
    assert child.returncode == 0, child.stderr
    generate(plan_of(*[ball] * 12), tmp_path / "alone")
    assert files(out) == files(tmp_path / "alone")


@pytest.mark.skipif(sys.platform != "linux", reason="workers are forked on Linux alone")
def test_a_killed_server_may_refuse_work_before_it_has_ended(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    start, refused_at = ForkServerProcess.start, []

    def start_later(process: ForkServerProcess) -> None:
        refused_at.append(time.monotonic())
        if refused_at[-1] - refused_at[0] < 0.1:
            raise ConnectionRefusedError
        start(process)

    monkeypatch.setattr(ForkServerProcess, "start", start_later)
    assert run(plan_of(ball, ball), out, n_workers=1) == {}
    assert len(refused_at) > 1


def test_an_interrupt_while_the_server_starts_is_no_traceback() -> None:
    code = (
        "import multiprocessing, os, signal, time\n"
        "from zbuf_occlude.datasets.workers.local import start_server\n"
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
