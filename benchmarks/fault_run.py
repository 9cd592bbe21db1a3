"""Kill a run of `zbuf-occlude generate` at random moments: its data must be an undisturbed run's, byte for byte.

    python benchmarks/fault_run.py [--kills 50] [--every 2] [--format hdf5 --format packed] [generate's arguments]

For each format one undisturbed run and one in which SIGKILL ends workers, now and then the whole run (the same command
is then given again), and the whole run while it writes the final files. Only children of the process started here are
killed, each by its own process descriptor. Then every file is compared, the manifests but for their times. Exit status
1 when anything differs, when something half-written is left, or when the run was over before all kills were made.
"""

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from signal import SIGKILL, pidfd_send_signal

from zbuf_occlude.dataset.folder import GROUPS, MANIFEST, PLAN, read_plan
from zbuf_occlude.dataset.formats import FORMATS

ARGUMENTS = ["--views", "paper100", "--points", "1000", "--sample-size", "64", "--set", "resolution=128"]
"""Of generate, when none are given: 60,000 small clouds of the built-in shapes."""
WORKER, RUN, END = "a worker", "the whole run", "the whole run, writing the final files"
LOOK = 0.03
"""Seconds between two looks at the run."""
AGAIN = "is done again"
"""What a run says on standard error of the job that a dead worker had."""


class Victim:
    """A run that is killed again and again, and started again."""

    def __init__(self, command: list[str], out: Path, log: Path, rng: random.Random) -> None:
        self.command, self.out, self.log, self.rng = command, out, log, rng
        self.kills: Counter[str] = Counter()
        self._start()

    def _start(self) -> None:
        with open(self.log, "ab") as log:
            self.process = subprocess.Popen(self.command, stdout=log, stderr=log)

    def disturb(self, kinds: list[str], every: float, writing: float) -> int:
        """Kill as these say, then let the run end; return its exit status.

        A kill comes at a random moment, `every` seconds after the last one on average; at once where the run is so far
        that it might end before all are made. Those of the kind `END` come while the final files are written, which
        takes `writing` seconds.
        """
        before, n_end = [kind for kind in kinds if kind != END], kinds.count(END)
        n_before, moment = len(before), self._moment(every)
        while (before or n_end) and self.process.poll() is None and not (self.out / MANIFEST).exists():
            time.sleep(LOOK)
            progress = self._progress()
            if progress == 1.0 and n_end:
                time.sleep(self.rng.uniform(0, 0.3 * writing))
                n_end -= self._kill(END)
                continue
            due = time.monotonic() > moment or progress * n_before > n_before - len(before) + 0.5
            if before and due and self._kill(before[0]):
                before.pop(0)
                moment = self._moment(every)
        return self.process.wait()

    def _moment(self, every: float) -> float:
        return time.monotonic() + self.rng.uniform(0, 2 * every)

    def _progress(self) -> float:
        """Return which fraction of the batches is done, soon: by the names of files alone."""
        if not (self.out / PLAN).exists():
            return 0.0
        of_groups = read_plan(self.out).batches_of
        # not rglob, which ends where a folder is removed under it
        found = [Path(folder, name) for folder, _, names in os.walk(self.out) for name in names]
        done = {int(path.stem) for path in found if path.suffix == ".json" and path.parent.name == GROUPS}
        n_done = sum(len(batches) for number, batches in enumerate(of_groups) if number in done)
        return min(1.0, (n_done + sum(path.suffix == ".batch" for path in found)) / sum(map(len, of_groups)))

    def _kill(self, kind: str) -> bool:
        """Kill one; False when there is none to kill."""
        if kind != WORKER:
            if self.process.poll() is not None or (self.out / MANIFEST).exists():
                return False
            self.process.kill()
            self.process.wait()
            self._start()
        elif not self._kill_worker():
            return False
        self.kills[kind] += 1
        return True

    def _kill_worker(self) -> bool:
        workers = list(workers_of(self.process.pid))
        if not workers:
            return False
        chosen = self.rng.choice(workers)
        with suppress(ProcessLookupError):  # it ended just now
            descriptor = os.pidfd_open(chosen)
            try:
                if chosen in workers_of(self.process.pid):  # and nobody else got its number
                    pidfd_send_signal(descriptor, SIGKILL)
                    return True
            finally:
                os.close(descriptor)
        return False


def workers_of(run: int) -> Iterator[int]:
    """The workers of a run: processes that its server has forked or, where it has none, that it has spawned itself."""
    processes = dict(filter(None, map(_parent_and_command, Path("/proc").glob("[0-9]*"))))
    servers = [pid for pid, (parent, command) in processes.items() if parent == run and b"forkserver" in command]
    for pid, (parent, command) in processes.items():
        if parent in servers or (parent == run and b"spawn_main" in command):
            yield pid


def _parent_and_command(folder: Path) -> tuple[int, tuple[int, bytes]] | None:
    try:
        parent = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
        return int(folder.name), (parent, (folder / "cmdline").read_bytes())
    except OSError:  # it ended just now
        return None


def differences(one: Path, other: Path) -> list[str]:
    """Say which files of two datasets differ; times in manifests may."""
    names = sorted({str(path.relative_to(root)) for root in (one, other) for path in root.rglob("*") if path.is_file()})
    found = []
    for name in names:
        if not ((one / name).exists() and (other / name).exists()):
            found.append(f"{name} is in one folder only")
        elif _comparable(one / name) != _comparable(other / name):
            found.append(f"{name} differs")
    return found


def _comparable(path: Path) -> object:
    if path.name != MANIFEST and path.parent.name != GROUPS:
        return path.read_bytes()
    return {key: value for key, value in json.loads(path.read_text()).items() if key not in ("seconds", "checksum")}


def kinds_of(n_kills: int, rng: random.Random) -> list[str]:
    """A sixth of the kills end the whole run, a sixteenth while it writes the final files; one of each at least."""
    n_end, n_run = max(1, n_kills // 16), max(1, n_kills // 6)
    kinds = [END] * n_end + [RUN] * n_run + [WORKER] * (n_kills - n_end - n_run)
    rng.shuffle(kinds)
    return kinds


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--every", type=float, default=2.0, help="seconds between kills, on average")
    parser.add_argument("--format", action="append", choices=[row.name for row in FORMATS])
    parser.add_argument("--random", type=int, default=None, help="seed of the moments and victims")
    known, others = parser.parse_known_args(arguments)
    seed = known.random if known.random is not None else random.SystemRandom().randrange(10**6)
    failed = False
    for format in known.format or ["hdf5", "packed"]:
        with tempfile.TemporaryDirectory() as name:
            folder, rng = Path(name), random.Random(seed)
            command = [sys.executable, "-m", "zbuf_occlude", "generate", *(others or ARGUMENTS), "--format", format]
            began = time.monotonic()
            subprocess.run([*command, "--out", str(folder / "alone")], check=True, capture_output=True)
            alone = time.monotonic() - began
            writing = json.loads((folder / "alone" / MANIFEST).read_text())["seconds"].get("writing", 0.5)
            began = time.monotonic()
            victim = Victim([*command, "--out", str(folder / "out")], folder / "out", folder / "log", rng)
            code = victim.disturb(kinds_of(known.kills, rng), known.every, writing)
            seconds = time.monotonic() - began
            log = (folder / "log").read_text()
            faults = differences(folder / "alone", folder / "out")
            if code:
                faults.append(f"the run ended with code {code}: {log[-500:]}")
            if victim.kills.total() < known.kills:
                faults.append(f"{known.kills} kills must be made; the run was over after {victim.kills.total()}")
            print(
                f"{format}: {alone:.0f} s undisturbed, {seconds:.0f} s with {victim.kills.total()} kills (seed {seed}):"
            )
            for kind, count in victim.kills.most_common():
                print(f"  {count:3} x {kind}")
            print(f"  {log.count(AGAIN)} jobs of dead workers done again, and what each killed run had in hand")
            n_files = sum(path.is_file() for path in (folder / "out").rglob("*"))
            print("\n".join(f"  fault: {fault}" for fault in faults) or f"  all {n_files} files are equal")
            failed |= bool(faults)
    print("FAILED" if failed else "the data equal the undisturbed runs'")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
