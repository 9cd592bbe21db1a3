"""What the benchmarks share: command line, tables of Markdown, times in turns, costs of processes, Open3D as a peer."""

import argparse
import ctypes
import inspect
import os
import subprocess
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, get_args, get_origin

import numpy as np

from zbuf_occlude.base.arrays import FloatArray

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("ZBUF_OCCLUDE_DATA", ROOT.parent / "shared" / "data"))
PR_SET_CHILD_SUBREAPER = 36
SHORT_OF = 1.0 - 1e-4
"""Of the way from an eye to a point, what peers look at."""


def run(main: Callable[..., int | None], description: str | None, **choices: Iterable[str]) -> None:
    """Call `main` with what the command line gives, and exit with what it returns.

    Parameters after `*` are options: a `Sequence` takes several values, a `bool` is a flag, and what is not given has
    the default of `main`. The others are arguments. `choices` are all that a parameter of that name may be.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parameters = inspect.signature(main).parameters
    for name, parameter in parameters.items():
        kind, needed = parameter.annotation, parameter.default is parameter.empty
        flag, several = f"--{name.replace('_', '-')}", get_origin(kind) is Sequence
        allowed = [*choices[name], []] if name in choices else None  # argparse asks whether no value, [], is allowed
        value: dict[str, Any] = {"type": (get_args(kind) or (kind,))[0], "choices": allowed, "metavar": name.upper()}
        if kind is bool:
            parser.add_argument(flag, action="store_true")
        elif parameter.kind is not parameter.KEYWORD_ONLY:
            many = "*" if parameter.kind is parameter.VAR_POSITIONAL else "+" if several else None if needed else "?"
            parser.add_argument(name, nargs=many, **value)
        elif several:
            parser.add_argument(flag, action="extend", nargs="+", **value)
        else:
            parser.add_argument(flag, required=needed, **value)
    arguments: list[Any] = []
    options = {name: value for name, value in vars(parser.parse_args()).items() if value is not None}
    for name, parameter in parameters.items():
        if parameter.kind is parameter.VAR_POSITIONAL:
            arguments += options.pop(name)
        elif parameter.kind is not parameter.KEYWORD_ONLY and name in options:
            arguments.append(options.pop(name))
    raise SystemExit(main(*arguments, **options))


def row(*cells: object) -> None:
    """Print a row of a table of Markdown."""
    print(f"| {' | '.join(map(str, cells))} |", flush=True)


def heads(*names: str, words: int = 1) -> None:
    """Print the head of a table of Markdown: first columns of words, then of numbers."""
    row(*names)
    row(*["---"] * words, *["---:"] * (len(names) - words))


def in_turns(
    jobs: Mapping[str, Callable[[], object]], rounds: int, clock: Callable[[], float] = time.perf_counter
) -> dict[str, list[float]]:
    """Return the seconds of each job in each round; in a round all jobs take their turn."""
    seconds: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(rounds):
        for name, job in jobs.items():
            began = clock()
            job()
            seconds[name].append(clock() - began)
    return seconds


def rates(answer: np.ndarray, truth: np.ndarray) -> list[float]:
    """Return which shares of the answers are right, show what is hidden, and hide what is visible."""
    return [float(each.mean()) for each in (answer == truth, answer & ~truth, ~answer & truth)]


class Cost(NamedTuple):
    """Seconds of a whole process, and the greatest memory of one of those that come from it."""

    clock: float
    processors: float
    megabytes: float


def cost_of(command: list[str], out: Path, checkout: Path = ROOT, **environment: str) -> Cost:
    """Run a command in the folder of `out`, with the package of a checkout; what it says is kept for errors."""
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)  # orphans come to this process, to be counted
    variables = {**os.environ, "PYTHONPATH": str(checkout), **environment}
    variables.pop("PYTHONDONTWRITEBYTECODE", None)  # what is installed has its bytecode
    with open(out.with_suffix(".log"), "w+") as log:
        began = time.perf_counter()
        process = subprocess.Popen(command, cwd=out.parent, env=variables, stdout=log, stderr=log)
        _, status, usage = os.wait4(process.pid, 0)  # with those that it waited for
        clock = time.perf_counter() - began
        processors = usage.ru_utime + usage.ru_stime + _of_orphans()
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode not in (0, 3):  # 3: done, some meshes failed
            log.seek(0)
            raise SystemExit(f"error: {' '.join(command)[:300]} ended with {process.returncode}:\n{log.read()[-2000:]}")
    return Cost(clock, processors, usage.ru_maxrss / 1e3)


def _of_orphans() -> float:
    """Wait for those that a process has left behind, which are this one's now; return their seconds of processors."""
    seconds = 0.0
    with suppress(ChildProcessError):  # none is left
        while True:
            usage = os.wait4(-1, 0)[2]
            seconds += usage.ru_utime + usage.ru_stime
    return seconds


class Open3D:
    """Open3D's caster of rays, built from a mesh, this package's or trimesh's."""

    def __init__(self, mesh: Any) -> None:
        import open3d

        self.tensor = open3d.core.Tensor
        self.scene = open3d.t.geometry.RaycastingScene()
        self.scene.add_triangles(self.tensor(np.float32(mesh.vertices)), self.tensor(np.uint32(mesh.faces)))
        self.first(self.rays(np.zeros((1, 3)), np.ones((1, 3))))  # builds

    def rays(self, origins: FloatArray, directions: FloatArray) -> Any:
        """Return rays as it takes them."""
        return self.tensor(np.concatenate([np.broadcast_to(origins, directions.shape), directions], axis=1, dtype="f4"))

    def occluded(self, rays: Any) -> np.ndarray:
        """Say which rays are met before they come to their ends."""
        return self.scene.test_occlusions(rays, 0.0, SHORT_OF).numpy()

    def first(self, rays: Any) -> np.ndarray:
        """Return the faces that rays meet first, -1 where none."""
        return self.scene.cast_rays(rays)["primitive_ids"].numpy().view(np.int32)
