"""The cores that this process may use: by affinity, and by the processor time of its control groups."""

import math
import os
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

PROCESS, MOUNTED = Path("/proc/self/cgroup"), Path("/sys/fs/cgroup")
"""The control groups of this process, and the folder of all."""


def n_cores() -> int:
    """Return the number of cores that this process may use."""
    n = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(n, n_by_quota() or n)


@cache
def n_by_quota(process: Path = PROCESS, mounted: Path = MOUNTED) -> int | None:
    """Return the cores' worth of time that control groups allow this process, rounded up; None for no limit.

    Docker's --cpus, Kubernetes' limits and SLURM set such quotas. Groups of version 1 and 2 are read, with those that
    they are in. A quota that is not visible from inside a container is not known.
    """
    quotas = [quota for group in _groups(process, mounted) for quota in _quotas_of(group)]
    return max(1, math.ceil(min(quotas))) if quotas else None


def _groups(process: Path, mounted: Path) -> Iterator[Path]:
    """Yield the folders of the control groups that limit the processor time of a process."""
    with suppress(OSError):
        for line in process.read_text(encoding="utf-8", errors="surrogateescape").splitlines():
            _, _, rest = line.partition(":")
            controllers, _, path = rest.partition(":")
            if controllers and "cpu" not in controllers.split(","):
                continue
            for top in (mounted / "cpu", mounted / controllers) if controllers else (mounted, mounted / "unified"):
                own = top / path.lstrip("/")
                yield own
                yield from (above for above in own.parents if top in (above, *above.parents))


def _quotas_of(group: Path) -> Iterator[float]:
    """Yield the cores' worth of time that a control group allows, if it sets a limit."""
    for names in (("cpu.max",), ("cpu.cfs_quota_us", "cpu.cfs_period_us")):
        with suppress(OSError, ValueError, ArithmeticError):
            time, period = " ".join((group / name).read_text(encoding="utf-8") for name in names).split()
            if time.isdecimal() and int(time) > 0:  # neither "max" nor -1
                yield int(time) / int(period)
