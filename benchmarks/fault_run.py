"""Disturb runs of `zbuf-occlude generate`: the data must be an undisturbed run's, byte for byte.

    python benchmarks/fault_run.py [--kills 50] [--every 2] [--format hdf5 --format packed] [generate's arguments]
    python benchmarks/fault_run.py --together 20 [--format ...]
    python benchmarks/fault_run.py --full 10 [--format ...]         # as root, for it mounts file systems

Kills: for each format one undisturbed run and one in which SIGKILL ends workers, now and then the whole run (the same
command is then given again), and the whole run while it writes the final files. Only children of the process started
here are killed, each by its own process descriptor.

Together: two runs of one command into one folder, the second a random while after the first. One must be refused in a
line, or both must end; either way the data are whole.

Full: a tmpfs and an ext4 of 8 MB with less and less room. The run must end with one line and no signal, and the same
command must finish the data when there is room. So must `visible`, `depth`, `scan` and `compare-scans`, which must
leave no part of a file.

Every file is compared, the manifests but for their times. Exit status 1 when anything differs, when something
half-written is left, or when the run was over before all kills were made.
"""

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from signal import SIGKILL, pidfd_send_signal

from zbuf_occlude.datasets.folder import MANIFEST, PLAN, SHARDS, read_plan
from zbuf_occlude.datasets.formats import FORMATS

ARGUMENTS = ["--views", "paper100", "--points", "1000", "--sample-size", "64", "--set", "resolution=128"]
"""Of generate, when none are given: 60,000 small clouds of the built-in shapes."""
_FEW = ["--method", "exact", "--workers", "1"]
_PIXELS = ["--limit", "4", "--views", "ring:4@30", "--set-sensor", "width=96", "--set-sensor", "height=72"]
SMALL = {
    "frames": _PIXELS,
    "bop": _PIXELS,
    "kitti": ["--limit", "1", "--views", "ring:2@0", "--set-sensor", "columns=200"],
    "pcn": ["--limit", "4", "--points", "16384", "--sample-size", "512"],
    "completion3d": ["--limit", "8", "--points", "2048"],
    "epn3d": ["--limit", "8", "--points", "2048"],
    "mvp": ["--limit", "2", "--points", "2048"],
    "pairs": ["--limit", "2", "--points", "2048", "--sample-size", "256", "--views", "fibonacci:8"],
    "voxels": ["--limit", "2", "--points", "2048", "--sample-size", "256", "--views", "fibonacci:4"],
    "projected-shapenet": ["--limit", "4", "--points", "8192", "--sample-size", "512"],
    "shapenet55": ["--limit", "8", "--points", "8192"],
}
"""Of generate, for a dataset of seconds and megabytes in a format; of others `SMALL_OTHERS`."""
SMALL_OTHERS = ["--limit", "4", "--views", "ring:8@30", "--points", "2048", "--sample-size", "256"]
SINGLE = {
    "visible": ["visible", "MESH", "--method", "exact", "--out", "OUT/cloud.ply"],
    "depth png": ["depth", "MESH", "--out", "OUT/depth.png"],
    "depth npy": ["depth", "MESH", "--out", "OUT/depth.npy"],
    "depth exr": ["depth", "MESH", "--out", "OUT/depth.exr"],
    "scan": ["scan", "MESH", "--size", "file", "--range", "3", "--out", "OUT/scan.npz", "--picture", "OUT/scan.png"],
    "compare-scans": ["compare-scans", "MESH", "SCAN", "--sensor", "vlp-32c", "--out", "OUT/report"],
}  # fmt: skip
"""Commands that write a few files."""
COMMANDS = "commands"
"""What stands for all of these among the formats."""
IMAGE = 8 * 2**20
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
        """Return which fraction of the shards is done."""
        if not (self.out / PLAN).exists():
            return 0.0
        return len(list((self.out / SHARDS).glob("*.json"))) / len(read_plan(self.out).shards)

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


def generate(format: str, out: Path) -> list[str]:
    """Return the command that makes a small dataset."""
    own = SMALL.get(format, SMALL_OTHERS)
    return [sys.executable, "-m", "zbuf_occlude", "generate", *_FEW, *own, "--format", format, "--out", str(out)]


def said(text: str) -> list[str]:
    """Return the lines of an output that are no bars, and no table of what is to be made."""
    lines = text.replace("\r", "\n").split("\n")
    begins = ("error:", "Traceback", "Exception", "Segmentation", "Bus error")
    return [line for line in lines if line.startswith(begins) or "Error" in line or " is made again" in line]


def together(format: str, tries: int, folder: Path, rng: random.Random) -> list[str]:
    """Have two runs meet again and again; return the faults."""
    began, faults, ends = time.monotonic(), list[str](), Counter[str]()
    subprocess.run(generate(format, folder / "alone"), check=True, capture_output=True)
    seconds = time.monotonic() - began
    for number in range(tries):
        runs, out = list[subprocess.Popen[str]](), folder / f"out{number}"
        for _ in range(2):
            runs.append(subprocess.Popen(generate(format, out), stdout=-1, stderr=-1, text=True))
            time.sleep(rng.uniform(0, seconds) if len(runs) == 1 else 0)
        errors = [said(run.communicate()[1]) for run in runs]
        codes = [run.returncode for run in runs]
        ends["one is refused" if 1 in codes else "both end"] += 1
        refused = [lines for code, lines in zip(codes, errors, strict=True) if code]
        if 0 not in codes or any(len(lines) != 1 or "one run at a time" not in lines[0] for lines in refused):
            faults.append(f"try {number}: {codes}, {errors}")
        faults += [f"try {number}: {each}" for each in differences(folder / "alone", out)]
        shutil.rmtree(out)
    print(f"{format}: {', '.join(f'{what} {n} times' for what, n in ends.most_common())}", flush=True)
    return faults


@contextmanager
def small_disk(place: Path, kind: str, room: int) -> Iterator[Callable[[], None]]:
    """Mount a file system with so much room, bytes; yields what makes room."""
    place.mkdir(exist_ok=True)
    ballast = place / "ballast"
    if kind == "tmpfs":
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={4096 + room}", "tmpfs", place], check=True)
    else:
        with tempfile.NamedTemporaryFile() as image:  # another each time: its device stays busy for a while
            os.truncate(image.name, IMAGE)
            subprocess.run(["mkfs.ext4", "-q", "-F", "-m", "0", "-O", "^has_journal", image.name], check=True)
            subprocess.run(["mount", "-o", "loop", image.name, place], check=True)

    def make_room() -> None:
        if kind == "tmpfs":
            subprocess.run(["mount", "-o", "remount,size=1G", place], check=True)
        ballast.unlink(missing_ok=True)

    try:
        (place / "out").mkdir()
        if kind != "tmpfs":
            with suppress(OSError), open(ballast, "wb", 0) as file:
                while file.write(bytes(4096)):
                    pass
            os.truncate(ballast, max(0, ballast.stat().st_size - room))
        yield make_room
    finally:
        subprocess.run(["umount", place], check=True)


def full(what: str, command: list[str], again: Path, place: Path, n_sizes: int) -> list[str]:
    """Run a command where there is ever more room, and again where there is enough; return the faults.

    `again` has what an undisturbed one writes.
    """
    n_bytes = sum(path.stat().st_blocks * 512 for path in again.rglob("*"))
    faults, ends = list[str](), Counter[str]()
    for kind in ("tmpfs", "ext4"):
        for number in range(n_sizes):
            where = f"{kind} {number + 1}/{n_sizes}"
            with small_disk(place, kind, min(n_bytes * (number + 1) // n_sizes, IMAGE // 2)) as make_room:
                found = subprocess.run(command, capture_output=True, text=True, cwd=place.parent)
                lines = said(found.stderr)
                ends[f"code {found.returncode}"] += 1
                if found.returncode not in (0, 1) or len(lines) != found.returncode:
                    faults.append(f"{where}: code {found.returncode}, {lines[:3]}, {found.stderr[-200:]}")
                if "generate" not in command:  # a file is whole, or not there
                    names = {path.relative_to(place / "out") for path in (place / "out").rglob("*") if path.is_file()}
                    both = (((place / "out" / name).stat().st_size, (again / name).stat().st_size) for name in names)
                    faults += [f"{where}: a part of a file is left" for one, other in both if one != other]
                make_room()
                found = subprocess.run(command, capture_output=True, text=True, cwd=place.parent)
                if found.returncode:
                    faults.append(f"{where}, with room: code {found.returncode}, {found.stderr[-200:]}")
                faults += [f"{where}, with room: {each}" for each in differences(again, place / "out")]
    print(f"{what}: {', '.join(f'{end} {n} times' for end, n in ends.most_common())}", flush=True)
    return faults


def singles(folder: Path) -> dict[str, list[str]]:
    """Return the commands of `SINGLE`, on a mesh and a scan that are made here."""
    mesh, scan = folder / "box.off", folder / "seen.ply"
    rows = [f"{x} {y} {z}" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [f"4 {' '.join(map(str, quad))}" for quad in quads]
    mesh.write_text("\n".join(["OFF", "8 6 0", *rows, *faces, ""]))
    program = [sys.executable, "-m", "zbuf_occlude"]
    made = [*program, "scan", str(mesh), "--sensor", "vlp-32c", "--range", "3", "--size", "file", "--out", str(scan)]
    subprocess.run(made, check=True, capture_output=True)
    filled = {"MESH": str(mesh), "SCAN": str(scan)}
    return {what: [*program, *(filled.get(word, word) for word in words)] for what, words in SINGLE.items()}


def fill_disks(formats: list[str], n_sizes: int, folder: Path) -> list[str]:
    """Try every format, and every command that writes a few files, where there is little room."""
    faults, place = list[str](), folder / "disk"
    tried = {format: generate(format, Path("OUT")) for format in formats}
    for what, words in (tried if formats != [COMMANDS] else singles(folder)).items():
        alone = folder / f"{what} alone"
        alone.mkdir()
        commands = [[word.replace("OUT", str(out)) for word in words] for out in (alone, place / "out")]
        subprocess.run(commands[0], check=True, capture_output=True, cwd=folder)
        faults += [f"{what}: {each}" for each in full(what, commands[1], alone, place, n_sizes)]
    return faults


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
    if path.name != MANIFEST and path.parent.name != SHARDS:
        return path.read_bytes()
    return {key: value for key, value in json.loads(path.read_text()).items() if key != "seconds"}


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
    parser.add_argument("--together", type=int, metavar="TRIES", help="of two runs that meet")
    parser.add_argument("--full", type=int, metavar="SIZES", help="of file systems with too little room")
    parser.add_argument("--format", action="append", choices=[COMMANDS, *(row.name for row in FORMATS)])
    parser.add_argument("--random", type=int, default=None, help="seed of the moments and victims")
    known, others = parser.parse_known_args(arguments)
    seed = known.random if known.random is not None else random.SystemRandom().randrange(10**6)
    if known.together or known.full:
        rng, formats = random.Random(seed), known.format or [row.name for row in FORMATS]
        with tempfile.TemporaryDirectory() as name:
            if known.together:
                faults = [
                    f"{format}: {fault}"
                    for format in formats
                    for fault in together(format, known.together, Path(name, format), rng)
                ]
            else:
                faults = fill_disks(formats, known.full, Path(name))
        print("\n".join(f"  fault: {fault}" for fault in faults))
        print(f"FAILED (seed {seed})" if faults else "the data equal the undisturbed runs'")
        return int(bool(faults))
    failed = False
    for format in known.format or ["hdf5", "packed"]:
        with tempfile.TemporaryDirectory() as name:
            folder, rng = Path(name), random.Random(seed)
            command = [sys.executable, "-m", "zbuf_occlude", "generate", *(others or ARGUMENTS), "--format", format]
            began = time.monotonic()
            subprocess.run([*command, "--out", str(folder / "alone")], check=True, capture_output=True)
            alone = time.monotonic() - began
            making = json.loads((folder / "alone" / MANIFEST).read_text())["seconds"]["making"]
            began = time.monotonic()
            victim = Victim([*command, "--out", str(folder / "out")], folder / "out", folder / "log", rng)
            code = victim.disturb(kinds_of(known.kills, rng), known.every, max(0.5, alone - making))
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
