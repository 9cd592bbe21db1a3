"""The parts of `gpu.py` but speed: each a function from how much to do to plain data, in a process of its own."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from dataclasses import asdict, dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any, Self

import numpy as np
from common import DATA, ROOT, cost_of, in_turns

import zbuf_occlude as zo
from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.child import Child, call_in_child
from zbuf_occlude.base.cores import n_cores
from zbuf_occlude.base.errors import GlError, OccludeError
from zbuf_occlude.base.provenance import versions
from zbuf_occlude.datasets.counts import QualityCounts, WorstView
from zbuf_occlude.datasets.pipeline import check
from zbuf_occlude.engines.gl.buffers import Buffers, block_limit
from zbuf_occlude.engines.gl.context import GlContext
from zbuf_occlude.engines.gl.probe import probe_all
from zbuf_occlude.meshes import shapes
from zbuf_occlude.studies.compare.run import machine
from zbuf_occlude.visibility import find_method

PATIENCE = 240.0
"""Seconds that another process may take."""
ONE_THREAD = {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "0"}
WARP = find_spec("warp") is not None
RAYS = WARP and find_spec("torch") is not None
"""Whether `gpu_warp` can be imported."""


@dataclass(frozen=True)
class Amount:
    """How much the parts do."""

    software: bool = False  # a CPU may render
    meshes: int = 60  # of `right`
    points: int = 4000  # of each of them
    scenes: int = 1000
    faces: Sequence[int] = (300, 5_000, 20_000, 100_000, 1_000_000, 8_000_000)  # of `fast`
    fast_points: Sequence[int] = (2_000, 20_000, 100_000, 1_000_000)
    views: Sequence[int] = (1, 10, 100, 1000)
    middle: tuple[int, int, int] = (20_000, 100_000, 100)  # faces, points and views where another of them varies
    call: float = 0.4  # seconds of one call; what is slower is asked about fewer views
    fast_seconds: float = 100.0  # after these no more is measured
    job_meshes: int = 400
    job_views: str = "paper100"
    workers: Sequence[int] = (8, 4, 2, 1)
    job_seconds: float = 110.0
    core_workers: Sequence[int] = (16, 8, 4, 2, 1)
    core_seconds: float = 80.0
    frames: int = 24
    soak: float = 20.0


WHOLE = Amount()
SMALL = Amount(
    software=True,
    meshes=2,
    points=300,
    scenes=13,
    faces=(300, 5_000),
    fast_points=(2_000, 10_000),
    views=(1, 16),
    middle=(5_000, 2_000, 16),
    call=0.02,
    fast_seconds=15.0,
    job_meshes=8,
    job_views="ring:4@30",
    workers=(2,),
    core_workers=(2, 1),
    frames=1,
    soak=2.0,
)


# ---- what ------------------------------------------------------------------------------------------------------------


def renderer_here() -> tuple[str, bool]:
    """Return what renders, and whether it is a CPU."""
    with GlContext.open() as gl:
        return gl.renderer, gl.is_software


def what(amount: Amount) -> dict[str, Any]:
    with GlContext.open() as gl:
        found = {"renderer": gl.renderer, "version": gl.version, "limits": device_limits(gl)}
    cards = nvidia_smi("name,driver_version,memory.total") or []
    return {
        **found,
        "cards": cards,
        "processor": machine(),
        "packages": versions(),
        "devices": [asdict(row) for row in probe_all()],
    }


def nvidia_smi(fields: str) -> list[list[str]] | None:
    """Return fields of each NVIDIA card; None where there is no nvidia-smi."""
    try:
        command = ["nvidia-smi", f"--query-gpu={fields}", "--format=csv,noheader,nounits"]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=30)
    except (OSError, subprocess.SubprocessError):
        return None
    return [[cell.strip() for cell in line.split(",")] for line in done.stdout.splitlines()]


def device_limits(gl: GlContext) -> dict[str, float]:
    """Measure what bounds every method: gigabytes a second within, to and from the device, and operations."""
    n_bytes, groups = (1 << 24, 256) if gl.is_software else (1 << 27, 1 << 14)
    data, rounds = np.zeros(n_bytes, dtype=np.uint8), 3 if gl.is_software else 20
    stream, peak = gl.program("stream.comp"), gl.program("peak.comp")
    peak["iterations"].value = 1000
    with Buffers(gl, first=data, second=n_bytes, results=groups * 64 * 16) as buffers:

        def copy() -> None:
            buffers.bind(first=0, second=1)
            for _ in range(rounds):
                stream.run(1024, n_bytes // (1024 * 64 * 16))

        def compute() -> None:
            buffers.bind(results=0)
            for _ in range(rounds):
                peak.run(groups)

        def upload() -> None:
            Buffers(gl, again=data).release()

        jobs = {
            "copy": copy,
            "compute": compute,
            "upload": upload,
            "download": lambda: buffers.read_into("first", data),
        }
        finished = {name: partial(_until_done, gl, job) for name, job in jobs.items()}
        seconds = {name: median(each[1:]) for name, each in in_turns(finished, 4).items()}
    return {
        "copy GB/s": 2 * rounds * n_bytes / seconds["copy"] / 1e9,
        "TFLOP/s": rounds * groups * 64 * 1000 * 64 / seconds["compute"] / 1e12,
        "upload GB/s": n_bytes / seconds["upload"] / 1e9,
        "download GB/s": n_bytes / seconds["download"] / 1e9,
    }


def _until_done(gl: GlContext, job: Callable[[], None]) -> None:
    job()
    gl.wait()


# ---- right -----------------------------------------------------------------------------------------------------------

BATCHES = (8, 64, 100)
"""Eyes of a call: fewer than a batch, and more than one that is not full."""
DEPTH_BUFFERS: dict[str, tuple[str, dict[str, Any]]] = {
    "depth_buffer": ("depth_buffer", {}),
    "depth_buffer, refine=none": ("depth_buffer", {"refine": "none"}),
}
"""Methods and options that are wrong now and then."""
MAX_TESTS = 2e8
"""Pairs of line and face that the oracle tests on a mesh to tell which wrong answers lie in the boundary band."""


def right(amount: Amount) -> dict[str, Any]:
    exact_ones = {name: (name, {}) for name in ("exact_gl", "warp")[: 1 + WARP]}
    asked: dict[str, Callable[[zo.Mesh], Any]] = {
        label: partial(zo.prepare, method=method, **options)
        for label, (method, options) in {**DEPTH_BUFFERS, **exact_ones}.items()
    }
    if RAYS:
        from gpu_warp import Float32Rays  # late: Warp and PyTorch may not be there

        asked["float32 rays of Warp"] = lambda mesh: nullcontext(Float32Rays(mesh))
    tallies: dict[str, Counter[str]] = {name: Counter() for name in asked}
    stated = {name: QualityCounts() for name in DEPTH_BUFFERS}
    meshes = meshes_at_hand(amount.meshes)
    for number, mesh in enumerate(meshes):
        points, views = zo.sample_surface(mesh, n_points=amount.points, seed=number), views_near_and_far(mesh)
        with zo.prepare(mesh, "exact") as exact:
            truth = exact.visible(points, views.eyes)
        for name, prepare in asked.items():
            with prepare(mesh) as occluder:
                answers = [occluder.visible(points, views.eyes[:k]) for k in BATCHES]
            tally, answer = tallies[name], answers[-1]
            tally["pairs"] += answer.size
            tally["wrong"] += int((answer != truth).sum())
            tally["otherwise in another batch"] += sum(int((few != answer[: len(few)]).sum()) for few in answers)
            tally["outside"] += wrong_outside_band(mesh, points, views.eyes, answer != truth)
            if name in stated:
                rng = np.random.default_rng(number)
                stated[name] += check(mesh, points, views, answer, rng, 500, WorstView(0.0, mesh.name, 0, 0))
    rows = {
        name: {**tally, "stated": stated[name].error["interval"] if name in stated else None}
        for name, tally in tallies.items()
    }
    scenes = {}
    with Cores() as cores:
        for name in exact_ones:
            shares = [(name, numbers.tolist()) for numbers in cores.split(range(amount.scenes))]
            counts = cores.each(wrong_in_scenes, shares)
            wrong, pairs = (int(sum(column)) for column in zip(*counts, strict=True))
            scenes[name] = {"scenes": amount.scenes, "pairs": pairs, "wrong": wrong}
    return {"meshes": [mesh.name for mesh in meshes], "rows": rows, "scenes": scenes}


def meshes_at_hand(most: int) -> list[zo.Mesh]:
    """Return the meshes of the data's folders, spread evenly, or built-in shapes where there are none."""
    meshes = []
    for path in files_at_hand(("furniture", "modelnet", "hard"), most):
        try:
            meshes.append(zo.load_mesh(path))
        except OccludeError:  # some of the hard files must be refused
            continue
    if not meshes:
        pairs = [(label, index) for index in range(-(-most // len(shapes.CLASSES))) for label in shapes.CLASSES]
        meshes = [shapes.make(*pair) for pair in pairs[:most]]
    return meshes


def files_at_hand(folders: Sequence[str], most: int) -> list[Path]:
    """Return mesh files of the data's folders, spread evenly."""
    suffixes = {".off", ".obj", ".ply", ".stl"}
    found = [path for name in folders for path in sorted((DATA / name).rglob("*")) if path.suffix.lower() in suffixes]
    return [found[i * len(found) // min(most, len(found))] for i in range(min(most, len(found)))]


def views_near_and_far(mesh: zo.Mesh) -> zo.views.Views:
    """Return 100 views all around, a twelfth of them from near or within the mesh, which takes six pictures."""
    rows = zo.views.parse(f"fibonacci:{BATCHES[-1]}").to_rows()
    rows[5::12, 2] = 0.4
    return zo.views.Views.from_rows(rows).around(mesh.centre, mesh.longest_side)


def wrong_outside_band(mesh: zo.Mesh, points: zo.SurfacePoints, eyes: FloatArray, wrong: BoolArray) -> int:
    """Count wrong answers outside the boundary band; of very many, a random few are looked at."""
    where = np.argwhere(wrong)
    n_tested = min(len(where), int(MAX_TESTS / (10 * len(mesh.faces))))
    some = np.random.default_rng(0).permutation(where)[:n_tested]
    outside = 0
    with zo.prepare(mesh, "oracle") as oracle:
        for k in np.unique(some[:, 0]):
            outside += int(oracle.decided(points.select(some[some[:, 0] == k, 1]), eyes[k : k + 1]).sum())
    return round(outside * len(where) / n_tested) if n_tested else 0


def wrong_in_scenes(method: str, numbers: list[int]) -> tuple[int, int]:
    """Count wrong answers, and all, in random scenes of these numbers."""
    sys.path.insert(0, str(ROOT))
    from tests.random_scenes import CONTACTS, wrong_answers_of

    counts = [wrong_answers_of(method, 0, number, CONTACTS[number % len(CONTACTS)]) for number in numbers]
    return sum(wrong for wrong, _ in counts), sum(pairs for _, pairs in counts)


class Cores:
    """A process of one thread for each core; all answer at once."""

    def __init__(self) -> None:
        self._children = [Child(**ONE_THREAD) for _ in range(n_cores())]

    def split(self, items: Any) -> list[Any]:
        """Divide items among the processes; none gets nothing, where there are fewer."""
        return [part for part in np.array_split(np.asarray(items), len(self._children)) if len(part)]

    def each(self, function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Call a function once in each process, with its own arguments."""
        busy = self._children[: len(arguments)]
        for child, given in zip(busy, arguments, strict=True):
            child.start(function, *given)
        return [child.answer(PATIENCE) for child in busy]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        for child in self._children:
            child.kill()


# ---- job, cores ------------------------------------------------------------------------------------------------------


def job(amount: Amount) -> dict[str, Any]:
    runs = [("exact", amount.workers[0], {})]
    runs += [(method, n, {}) for n in amount.workers for method in ("depth_buffer", "exact_gl")]
    return datasets_made(amount, runs, amount.job_seconds)


def cores(amount: Amount) -> dict[str, Any]:
    numbers = sorted({n for n in amount.core_workers if n < n_cores()} | {n_cores()}, reverse=True)
    made = datasets_made(amount, [("exact", n, ONE_THREAD) for n in numbers], amount.core_seconds)
    workers, clocks = np.array([(row["workers"], row["clock"]) for row in made["rows"]]).T
    if len(workers) > 1:  # Amdahl's law by least squares: seconds = serial + parallel / workers
        system = np.stack([np.ones_like(workers), 1.0 / workers], axis=1)
        (serial, parallel), *_ = np.linalg.lstsq(system / clocks[:, None], np.ones_like(clocks), rcond=None)
        share = float(np.clip(serial / (serial + parallel), 0.0, 1.0))
        made |= {"serial_seconds": share * float(serial + parallel), "serial_share": share}
    return made


def datasets_made(amount: Amount, runs: Sequence[tuple[str, int, dict[str, str]]], limit: float) -> dict[str, Any]:
    """Run `generate` by methods, workers and variables of the environment; what would end too late is left out."""
    began, rows, left_out = time.perf_counter(), [], []
    with tempfile.TemporaryDirectory() as place:
        meshes, out = Path(place, "meshes"), Path(place, "out")
        source = lay_out(meshes, amount.job_meshes)
        common = [sys.executable, "-m", "zbuf_occlude", "generate", str(meshes), "--out", str(out), "--overwrite"]
        common += ["--points", "10000", "--sample-size", "1024", "--views", amount.job_views]
        commands = {method: [*common, "--method", method] for method, _, _ in runs}
        for method, command in commands.items():
            if not amount.software:
                command += ["--require-gpu"] if find_method(method).needs_gl else []
                call_in_child(cost_of, [*command, "--limit", "2"], out, timeout=PATIENCE)  # compiles
        for method, n_workers, environment in runs:
            before = [row["clock"] * row["workers"] / n_workers for row in rows if row["method"] == method]
            if before and time.perf_counter() - began + min(before) > limit:
                left_out.append(f"{method}, workers {n_workers}")
                continue
            command = [*commands[method], "--workers", str(n_workers)]
            with CardWatch() as card:
                cost = call_in_child(partial(cost_of, **environment), command, out, timeout=PATIENCE)
            rows.append({"method": method, "workers": n_workers, **cost._asdict(), **card.found})
        clouds = json.loads((out / "manifest.json").read_text())["counts"]["clouds"]
    return {"meshes": source, "clouds": clouds, "rows": rows, "left_out": left_out}


def lay_out(folder: Path, n: int) -> str:
    """Fill a folder with mesh files: those at hand over and over, or else built-in shapes; say which."""
    folder.mkdir()
    found = files_at_hand(("furniture", "modelnet"), n)
    for i in range(n if found else 0):
        (folder / f"{i:04}_{found[i % len(found)].name}").symlink_to(found[i % len(found)].resolve())
    if found:
        return f"{n} meshes, {len(found)} files over and over" if n > len(found) else f"{n} mesh files"
    for i in range(n):
        label = shapes.CLASSES[i % len(shapes.CLASSES)]
        shapes.make(label, i // len(shapes.CLASSES)).to_trimesh().export(folder / f"{i:04}_{label}.ply")
    return f"{n} built-in shapes"


class CardWatch:
    """Use of the busiest NVIDIA card meanwhile: mean utilisation and most memory, or nothing without nvidia-smi."""

    def __init__(self) -> None:
        self.found: dict[str, float] = {}
        self._process: Any = None

    def __enter__(self) -> Self:
        fields = "index,utilization.gpu,memory.used"
        command = ["nvidia-smi", f"--query-gpu={fields}", "--format=csv,noheader,nounits", "-lms", "200"]
        with suppress(OSError):
            self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        return self

    def __exit__(self, *error: object) -> None:
        if self._process is None:
            return
        self._process.terminate()
        samples = defaultdict(list)
        for line in self._process.communicate()[0].splitlines():
            try:
                index, busy, memory = map(float, line.split(","))
            except ValueError:  # cut short, or [N/A]
                continue
            samples[index].append((busy, memory))
        if samples:
            busy, memory = zip(*max(samples.values(), key=lambda each: np.mean(each, axis=0)[0]), strict=True)
            self.found = {"gpu_busy": float(np.mean(busy)), "gpu_megabytes": max(memory)}


# ---- soak ------------------------------------------------------------------------------------------------------------


def soak(amount: Amount) -> dict[str, Any]:
    from soak import CALLS, FLAT, VIEWS, WARM_UP, answer, judged

    from zbuf_occlude.base.limits import resident_gigabytes

    memory, device, first, n_different, began = [], [], dict[int, str](), 0, time.perf_counter()
    with GlContext.open() as gl:
        while (passed := time.perf_counter() - began) < amount.soak:
            number = len(memory) % len(CALLS)
            digest = answer(gl, CALLS[number])
            n_different += digest != first.setdefault(number, digest)
            memory.append(resident_gigabytes(os.getpid()))
            if passed > len(device) * amount.soak / 10:
                device.append(sum(float(row[0]) for row in nvidia_smi("memory.used") or []))
    life = judged("the process", memory)
    return {
        "renders": len(memory) * VIEWS,
        "different": n_different,
        "enough": WARM_UP * len(memory) >= len(CALLS),  # every kind of call was made before memory must be flat
        "growth": life["growth"],
        "allowed": FLAT,
        "megabytes": life["after"],
        "device_megabytes": [device[1 % len(device)], max(device)],
        "full": call_in_child(full_device, timeout=PATIENCE),
    }


def full_device() -> str:
    """Fill the device, or what a CPU may have for one, and return what a depth buffer then says; "" if nothing."""
    mesh, held = shapes.make("chair", 0), list[Buffers]()
    cards = nvidia_smi("memory.total")
    with GlContext.open() as gl:
        if gl.is_software:
            import resource

            now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (now + (1 << 30), now + (1 << 30)))
        most = (1.1 * max(float(row[0]) for row in cards) if cards else 4096.0) * (1 << 20)
        for size in (min(block_limit(gl), 1 << 30), 1 << 26):
            with suppress(GlError):
                while most > 0:
                    held.append(Buffers(gl, filler=size))
                    held[-1].clear("filler")  # a driver may take memory only when it is written
                    gl.wait()
                    most -= size
        try:
            with zo.prepare(mesh, "depth_buffer", gl=gl, resolution=4096) as occluder:
                occluder.visible(zo.sample_surface(mesh, n_points=1000, seed=0), mesh.centre[None])
        except GlError as error:
            return str(error)
    return ""
