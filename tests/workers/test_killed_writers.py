"""Workers are killed while they write final files: nothing is lost, and no byte is another."""

import os
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.workers.test_merge import collection, files
from zbuf_occlude.dataset.generate import generate
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.workers import local
from zbuf_occlude.workers.local import run_jobs
from zbuf_occlude.limits import Limits

LIMITS = Limits(seconds=300, gigabytes=8)


def test_killed_writers_change_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recipe = Recipe(method="oracle", views="fibonacci:250", n_points=32, sample_size=2)
    plan = Plan(collection(50), recipe)  # 12,500 clouds in seven files
    generate(plan, tmp_path / "whole")
    out, killed = tmp_path / "out", []

    class Doomed(local.LocalWorker):
        def listen(self) -> list[Any]:
            messages = super().listen()
            if len(killed) < 3 and any(kind == "done" and value[0] >= len(plan.shards) for kind, value in messages):
                killed.append(self.process.pid)  # it has written something, and may be at the next
                os.kill(self.process.pid, 9)
            return messages

    monkeypatch.setattr(local, "LocalWorker", Doomed)
    generate(plan, out, run=partial(run_jobs, n_workers=2, limits=LIMITS))
    assert len(killed) == 3
    assert files(out) == files(tmp_path / "whole")
