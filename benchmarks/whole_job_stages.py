"""What each stage of `generate` costs, in one process; `whole_job.py --stages` runs it, with any checkout's package.

python benchmarks/whole_job_stages.py REPORT.json OUT CONFIG MESH...        CONFIG: as JSON, what DatasetConfig takes
"""

import functools
import json
import sys
import time
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

STAGES = (
    ("load", "zbuf_occlude.meshes.load:load_mesh"),
    ("clean", "zbuf_occlude.geometry.mesh:Mesh.cleaned"),
    ("sample", "zbuf_occlude.datasets.pipeline:sample"),
    ("prepare", "zbuf_occlude.visibility:prepare"),
    ("ask", "zbuf_occlude.visibility.interface:VisibilityQuery.visible"),
    ("check", "zbuf_occlude.datasets.pipeline:check"),
    ("gather", "zbuf_occlude.datasets.shard:RecordShard.keep"),
    ("write", "zbuf_occlude.datasets.shard:RecordShard.write"),
    ("finish", "zbuf_occlude.datasets.generate:finish_dataset"),
)
"""A function that is called inside another stage belongs to that, but `clean`, which has a row of its own."""


class Clock:
    """Seconds of clock and of processor of the stages, each exclusive of the stages within."""

    def __init__(self) -> None:
        self.spent: dict[str, list[float]] = {name: [0.0, 0.0, 0] for name in ("start-up", *dict(STAGES), "else")}
        self._open: list[str] = ["start-up"]
        self._since = (_BEGAN, 0.0)

    def turn(self, *, enter: str = "") -> None:
        """Charge what has passed to the open stage, then open another or close this one."""
        now = (time.perf_counter(), time.process_time())
        row = self.spent[self._open[-1]]
        row[0] += now[0] - self._since[0]
        row[1] += now[1] - self._since[1]
        self._since = now
        if enter:
            self.spent[enter][2] += 1
            self._open.append(enter)
        else:
            self._open.pop()
        if self._open == ["start-up"]:
            self._open = ["else"]

    def timed(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def wrapped(*arguments: Any, **named: Any) -> Any:
            if len(self._open) > 1 and stage != "clean":
                return function(*arguments, **named)
            self.turn(enter=stage)
            try:
                return function(*arguments, **named)
            finally:
                self.turn()

        return wrapped


def watch(clock: Clock) -> None:
    """Put each stage's function, wherever it is known by a name, behind the clock."""
    for stage, place in STAGES:
        module_name, _, path = place.partition(":")
        if find_spec(module_name) is None:  # an older version
            continue
        owner: Any = import_module(module_name)
        *classes, name = path.split(".")
        for one in classes:
            owner = getattr(owner, one)
        function = getattr(owner, name)
        timed = clock.timed(stage, function)
        setattr(owner, name, timed)
        for module in [m for n, m in sys.modules.items() if n.startswith("zbuf_occlude")]:
            for known in [known for known, value in vars(module).items() if value is function]:
                setattr(module, known, timed)


def main() -> None:
    report, out, recipe_given, *meshes = sys.argv[1:]
    clock = Clock()
    from zbuf_occlude.cli.generate import smoke_test  # what the command imports
    from zbuf_occlude.datasets.generate import generate
    from zbuf_occlude.datasets.plan import DatasetConfig, Plan
    from zbuf_occlude.meshes.collection import MeshCollection

    config = DatasetConfig(**json.loads(recipe_given))
    smoke_test(config, require_gpu=False)
    watch(clock)
    plan = Plan(MeshCollection.from_paths(meshes).interleaved(), config)
    generate(plan, Path(out))
    clock.turn(enter="else")
    rows = [{"stage": n, "clock": c, "processors": p, "calls": k} for n, (c, p, k) in clock.spent.items()]
    Path(report).write_text(json.dumps(rows))


_BEGAN = time.perf_counter()

if __name__ == "__main__":
    main()
