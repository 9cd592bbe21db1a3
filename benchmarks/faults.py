"""Disturb runs of `zbuf-occlude`: their data must be an undisturbed run's, byte for byte.

    python benchmarks/faults.py                                          # every part, every run
    python benchmarks/faults.py --part together --tries 20 --of hdf5 bop
    python benchmarks/faults.py --part disks --sizes 10                  # as root, for it mounts file systems
    python benchmarks/faults.py --part kills --tries 1 --kills-each 20 --of packed --more "--views paper100"

together: two runs of one command into one folder, the second a random while after the first. One must be refused in a
line, or both must end; either way the data are whole.

disks: a tmpfs and an ext4 of 8 MB with less and less room. The run must end with one line and no signal, and the same
command must finish the data when there is room. So must `visible`, `depth`, `scan` and `compare-scans`, which must
leave no part of a file.

kills: SIGKILL ends a worker, or the whole run, at a random moment, or while it writes the final files; the same command
is then given again. Only children of the process started here are killed, each by its own process descriptor.

A table has a row for each run, printed when it is done; the faults follow it. Every file is compared, the manifests but
for their times. Exit status 1 when anything differs, or something half-written is left.
"""

import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from signal import SIGKILL, pidfd_send_signal

from common import heads, row, run

from zbuf_occlude.datasets.folder import MANIFEST, PLAN, SHARDS, read_plan
from zbuf_occlude.datasets.formats import FORMATS

_FEW = ["--method", "exact", "--workers", "2"]
_PIXELS = ["--limit", "4", "--views", "ring:4@30", "--set-sensor", "width=96", "--set-sensor", "height=72"]
SMALL = {
    "frames": _PIXELS,
    "bop": _PIXELS,
    "organized-pcd": _PIXELS,
    "mcap": _PIXELS,
    "kitti": ["--limit", "1", "--views", "ring:2@0", "--set-sensor", "columns=200"],
    "pcn": ["--limit", "4", "--points", "16384", "--sample-size", "512"],
    "completion3d": ["--limit", "8", "--points", "2048"],
    "epn3d": ["--limit", "8", "--points", "2048"],
    "mvp": ["--limit", "2", "--points", "2048"],
    "pairs": ["--limit", "2", "--points", "2048", "--sample-size", "256", "--views", "fibonacci:8"],
    "voxels": ["--limit", "2", "--points", "2048", "--sample-size", "256", "--views", "fibonacci:4"],
    "projected-shapenet": ["--limit", "4", "--points", "8192", "--sample-size", "512"],
    "scans": ["--limit", "4", "--views", "ring:2@0", "--sensor", "vlp-16", "--range", "6", "--size", "2"],
    "shapenet55": ["--limit", "8", "--points", "8192"],
}
"""Arguments of `generate` for a dataset of seconds and megabytes in a format; for others `SMALL_OTHERS`."""
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
SCANS = "scans"
"""Name of the run of whole scans of a street, in HDF5 files."""
GENERATED = (*(row.name for row in FORMATS), SCANS)
PARTS = ("together", "disks", "kills")
IMAGE = 8 * 2**20
WORKER, RUN, END = "a worker", "the run", "the run at its final files"
LOOK = 0.03
"""Seconds between two looks at the run."""


def generate(name: str, out: Path, more: Sequence[str] = ()) -> list[str]:
    """Return the command that makes a small dataset."""
    own = SMALL.get(name, SMALL_OTHERS)
    format = "hdf5" if name == SCANS else name
    program = [sys.executable, "-m", "zbuf_occlude", "generate"]
    return [*program, *_FEW, *own, "--format", format, *more, "--out", str(out)]


def said(text: str) -> list[str]:
    """Return the lines of an output that are no bars, and no table of what is to be made."""
    lines = text.replace("\r", "\n").split("\n")
    begins = ("error:", "Traceback", "Exception", "Segmentation", "Bus error")
    return [line for line in lines if line.startswith(begins) or "Error" in line or " is made again" in line]


class Disturbed:
    """A run that is killed, and started again."""

    def __init__(self, command: list[str], out: Path, seconds: float, rng: random.Random) -> None:
        self._command, self._out, self._seconds, self._rng = command, out, seconds, rng
        self.kills: Counter[str] = Counter()
        self._process = self._start()

    def _start(self) -> subprocess.Popen[bytes]:
        return subprocess.Popen(self._command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def disturb(self, n_kills: int) -> int:
        """Kill so often at random moments of the time that an undisturbed run takes; return the exit status."""
        for _ in range(n_kills):
            kind = self._rng.choice((WORKER, RUN, END))
            self._wait(kind, self._rng.uniform(0, (1.0 if kind == RUN else 0.5) * self._seconds / n_kills))
            if self._process.poll() is None and (kind != WORKER or self._kill_worker()):
                self.kills[kind] += 1
                if kind != WORKER:
                    self._process.kill()
                    self._process.wait()
                    self._process = self._start()
        return self._process.wait()

    def _wait(self, kind: str, seconds: float) -> None:
        """Wait so long, and until there is a worker to kill; or until all shards are made and a moment longer."""
        until = time.monotonic() + seconds
        while self._process.poll() is None and not self._is_due(kind, until):
            time.sleep(LOOK)
        if kind == END:
            time.sleep(self._rng.uniform(0, 0.1 * self._seconds))

    def _is_due(self, kind: str, until: float) -> bool:
        if kind == END:
            return self._all_made()
        return time.monotonic() > until and (kind == RUN or any(workers_of(self._process.pid)))

    def _all_made(self) -> bool:
        if not (self._out / PLAN).exists():
            return False
        made = len(list((self._out / SHARDS).glob("*.json")))
        return made == len(read_plan(self._out).shards) or (self._out / MANIFEST).exists()

    def _kill_worker(self) -> bool:
        """Kill a worker; False where there is none."""
        workers = list(workers_of(self._process.pid))
        if not workers:
            return False
        chosen = self._rng.choice(workers)
        with suppress(ProcessLookupError):  # it ended just now
            descriptor = os.pidfd_open(chosen)
            try:
                if chosen in workers_of(self._process.pid):  # and nobody else got its number
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


def undisturbed(command: list[str], folder: Path) -> float:
    """Run a command in a folder; return its seconds."""
    began = time.monotonic()
    subprocess.run(command, check=True, capture_output=True, cwd=folder)
    return time.monotonic() - began


def kills(name: str, tries: int, n_kills: int, more: Sequence[str], folder: Path, rng: random.Random) -> list[str]:
    """Kill runs; print the row, and return the faults."""
    seconds, faults, made = undisturbed(generate(name, folder / "alone", more), folder), list[str](), Counter[str]()
    for number in range(3 * tries):  # a run may be over before its moment comes
        if made.total() >= tries * n_kills:
            break
        out = folder / f"out{number}"
        victim = Disturbed(generate(name, out, more), out, seconds, rng)
        if code := victim.disturb(n_kills):
            faults.append(f"try {number}: the last run ended with code {code}")
        made += victim.kills
        faults += [f"try {number}, {dict(victim.kills)}: {each}" for each in differences(folder / "alone", out)]
        shutil.rmtree(out)
    row(name, *(made[kind] for kind in (WORKER, RUN, END)), len(faults))
    return faults


def together(name: str, tries: int, folder: Path, rng: random.Random) -> list[str]:
    """Have two runs meet again and again; print the row, and return the faults."""
    seconds, faults, ends = undisturbed(generate(name, folder / "alone"), folder), list[str](), Counter[str]()
    for number in range(tries):
        runs, out = list[subprocess.Popen[str]](), folder / f"out{number}"
        for _ in range(2):
            runs.append(subprocess.Popen(generate(name, out), stdout=-1, stderr=-1, text=True))
            time.sleep(rng.uniform(0, seconds) if len(runs) == 1 else 0)
        errors = [said(run.communicate()[1]) for run in runs]
        codes = [run.returncode for run in runs]
        ends["refused" if 1 in codes else "both"] += 1
        refused = [lines for code, lines in zip(codes, errors, strict=True) if code]
        if 0 not in codes or any(len(lines) != 1 or "one run at a time" not in lines[0] for lines in refused):
            faults.append(f"try {number}: {codes}, {errors}")
        faults += [f"try {number}: {each}" for each in differences(folder / "alone", out)]
        shutil.rmtree(out)
    row(name, ends["refused"], ends["both"], len(faults))
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


def disks(name: str, words: list[str], n_sizes: int, folder: Path) -> list[str]:
    """Run a command where there is ever more room, and again where there is enough; print the row, return the faults.

    ``OUT`` in the command stands for its folder.
    """
    alone, place = folder / "alone", folder / "disk"
    alone.mkdir()
    whole, command = ([word.replace("OUT", str(out)) for word in words] for out in (alone, place / "out"))
    undisturbed(whole, folder)
    n_bytes = sum(path.stat().st_blocks * 512 for path in alone.rglob("*"))
    faults, ends = list[str](), Counter[int]()
    for kind in ("tmpfs", "ext4"):
        for number in range(n_sizes):
            where = f"{kind} {number + 1}/{n_sizes}"
            with small_disk(place, kind, min(n_bytes * (number + 1) // n_sizes, IMAGE // 2)) as make_room:
                found = subprocess.run(command, capture_output=True, text=True, cwd=folder)
                lines = said(found.stderr)
                ends[found.returncode] += 1
                if found.returncode not in (0, 1) or len(lines) != found.returncode:
                    faults.append(f"{where}: code {found.returncode}, {lines[:3]}, {found.stderr[-200:]}")
                if "generate" not in command:  # a file is whole, or not there
                    names = {path.relative_to(place / "out") for path in (place / "out").rglob("*") if path.is_file()}
                    both = (((place / "out" / name).stat().st_size, (alone / name).stat().st_size) for name in names)
                    faults += [f"{where}: a part of a file is left" for one, other in both if one != other]
                make_room()
                found = subprocess.run(command, capture_output=True, text=True, cwd=folder)
                if found.returncode:
                    faults.append(f"{where}, with room: code {found.returncode}, {found.stderr[-200:]}")
                faults += [f"{where}, with room: {each}" for each in differences(alone, place / "out")]
    row(name, ends.pop(1, 0), ends.pop(0, 0), sum(ends.values()), len(faults))
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


def main(
    *,
    part: Sequence[str] = PARTS,
    of: Sequence[str] = (*GENERATED, *SINGLE),
    tries: int = 5,
    kills_each: int = 1,
    sizes: int = 3,
    more: str = "",
    seed: int = 0,
) -> int:
    faults, rng, generated = list[str](), random.Random(seed), [name for name in of if name in GENERATED]
    with tempfile.TemporaryDirectory() as place:

        def folder(name: str) -> Path:
            found = Path(place, name.replace(" ", "-"))
            shutil.rmtree(found, ignore_errors=True)
            found.mkdir()
            return found

        if "together" in part:
            heads("two runs at once", "one is refused", "both end", "faults")
            for name in generated:
                faults += [f"together, {name}: {each}" for each in together(name, tries, folder(name), rng)]
        if "kills" in part:
            heads("killed", WORKER, RUN, END, "faults")
            for name in generated:
                found = kills(name, tries, kills_each, more.split(), folder(name), rng)
                faults += [f"kills, {name}: {each}" for each in found]
        if "disks" in part:
            heads("full disks", "one line of error", "room enough", "signals", "faults")
            commands = {name: generate(name, Path("OUT")) for name in generated}
            commands |= {name: words for name, words in singles(Path(place)).items() if name in of}
            for name, words in commands.items():
                faults += [f"disks, {name}: {each}" for each in disks(name, words, sizes, folder(name))]
    print("\n".join(f"  fault: {fault}" for fault in faults) or "the data equal the undisturbed runs'")
    return int(bool(faults))


if __name__ == "__main__":
    run(main, __doc__, part=PARTS, of=(*GENERATED, *SINGLE))
