"""The cores that a process may use, by affinity and by control groups of both versions."""

import math
import os
from pathlib import Path

import pytest

from zbuf_occlude.base import limits
from zbuf_occlude.base.limits import n_cores

CPU_MAX, CFS_QUOTA, CFS_PERIOD = "cpu.max", "cpu.cfs_quota_us", "cpu.cfs_period_us"


@pytest.mark.parametrize(
    ("groups", "files", "cores"),
    [
        ("0::/\n", {CPU_MAX: "200000 100000\n"}, 2.0),
        ("0::/\n", {CPU_MAX: "max 100000\n"}, math.inf),
        ("0::/pod/job\n", {"pod/cpu.max": "150000 100000", "pod/job/cpu.max": "400000 100000"}, 1.5),
        ("0::/pod/job\n", {"pod/job/cpu.max": "50000 100000", "pod/cpu.max": "max 100000"}, 0.5),
        ("4:memory:/a\n1:cpu,cpuacct:/a\n", {f"cpu/a/{CFS_QUOTA}": "300000", f"cpu/a/{CFS_PERIOD}": "100000"}, 3.0),
        ("1:cpu:/a\n", {f"cpu/{CFS_QUOTA}": "-1", f"cpu/{CFS_PERIOD}": "100000"}, math.inf),
        ("4:memory:/a\n", {f"cpu/{CFS_QUOTA}": "100000", f"cpu/{CFS_PERIOD}": "100000"}, math.inf),
        ("0::/\n", {CPU_MAX: "no number"}, math.inf),
        ("no group", {}, math.inf),
        (None, {}, math.inf),
    ],
)
def test_the_least_quota_of_all_groups_counts(
    tmp_path: Path, groups: str | None, files: dict[str, str], cores: float
) -> None:
    process, mounted = tmp_path / "cgroup", tmp_path / "mounted"
    if groups is not None:
        process.write_text(groups)
    for name, text in files.items():
        (mounted / name).parent.mkdir(parents=True, exist_ok=True)
        (mounted / name).write_text(text)
    assert limits._quota(process, mounted) == cores


@pytest.mark.parametrize(("quota", "expected"), [(0.1, 1), (1.0, 1), (1.5, 2), (2.0, 2), (math.inf, 3)])
def test_the_cores_of_a_quota_are_rounded_up(monkeypatch: pytest.MonkeyPatch, quota: float, expected: int) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1, 2}, raising=False)
    monkeypatch.setattr(limits, "_quota", lambda: quota)
    assert n_cores() == expected
