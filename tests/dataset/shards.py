"""Shards alone, without the files that are made of them."""

from pathlib import Path

from zbuf_occlude.dataset.generate import do, run_here
from zbuf_occlude.dataset.jobs import Jobs, Run
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.limits import Limits


def make_shards(plan: Plan, out: Path, run: Run = run_here, limits: Limits | None = None) -> None:
    """Make the shards of a plan that are not done."""
    do(Jobs(plan, out, range(len(plan.shards)), (), limits or Limits()), run)
