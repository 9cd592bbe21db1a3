"""The cores and threads that a process may use, by affinity and by control groups of both versions."""

import os
from pathlib import Path

import numba
import pytest

from zbuf_occlude.base import cores
from zbuf_occlude.base.cores import n_by_quota, n_cores
from zbuf_occlude.base.jit import threads

CPU_MAX, CFS_QUOTA, CFS_PERIOD = "cpu.max", "cpu.cfs_quota_us", "cpu.cfs_period_us"


@pytest.mark.parametrize(
    ("groups", "files", "expected"),
    [
        ("0::/\n", {CPU_MAX: "200000 100000\n"}, 2),
        ("0::/\n", {CPU_MAX: "max 100000\n"}, None),
        ("0::/pod/job\n", {"pod/cpu.max": "150000 100000", "pod/job/cpu.max": "400000 100000"}, 2),
        ("0::/pod/job\n", {"pod/job/cpu.max": "50000 100000", "pod/cpu.max": "max 100000"}, 1),
        ("\nnonsense\n0::/\n", {CPU_MAX: "300000 100000"}, 3),
        ("0::/\n", {f"unified/{CPU_MAX}": "300000 100000"}, 3),
        ("4:memory:/a\n1:cpu,cpuacct:/a\n", {f"cpu/a/{CFS_QUOTA}": "300000", f"cpu/a/{CFS_PERIOD}": "100000"}, 3),
        ("1:cpu,cpuacct:/\n", {f"cpu,cpuacct/{CFS_QUOTA}": "300000", f"cpu,cpuacct/{CFS_PERIOD}": "100000"}, 3),
        ("1:cpu:/a\n", {f"cpu/{CFS_QUOTA}": "-1", f"cpu/{CFS_PERIOD}": "100000"}, None),
        ("4:memory:/a\n", {f"cpu/{CFS_QUOTA}": "100000", f"cpu/{CFS_PERIOD}": "100000"}, None),
        ("0::/\n", {CPU_MAX: "no number"}, None),
        ("0::/\n", {CPU_MAX: "100000 0"}, None),
        ("0::/\n", {CPU_MAX: "0 100000"}, None),
        ("no group", {}, None),
        (None, {}, None),
    ],
)
def test_the_least_quota_of_all_groups_counts(
    tmp_path: Path, groups: str | None, files: dict[str, str], expected: int | None
) -> None:
    process, mounted = tmp_path / "cgroup", tmp_path / "mounted"
    if groups is not None:
        process.write_text(groups)
    for name, text in files.items():
        (mounted / name).parent.mkdir(parents=True, exist_ok=True)
        (mounted / name).write_text(text)
    assert n_by_quota(process, mounted) == expected


@pytest.mark.parametrize(("quota", "expected"), [(1, 1), (2, 2), (7, 3), (None, 3)])
def test_a_quota_limits_the_cores_of_the_affinity(
    monkeypatch: pytest.MonkeyPatch, quota: int | None, expected: int
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1, 2}, raising=False)
    monkeypatch.setattr(cores, "n_by_quota", lambda: quota)
    assert n_cores() == expected


@pytest.mark.parametrize(("variable", "quota", "expected"), [("", 1, 1), ("", None, 4), ("4", 1, 4)])
def test_a_quota_limits_the_threads_unless_their_number_is_given(
    monkeypatch: pytest.MonkeyPatch, variable: str, quota: int | None, expected: int
) -> None:
    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", 4)
    monkeypatch.setattr(threads, "n_by_quota", lambda: quota)
    monkeypatch.setattr(threads, "_most", 0)
    monkeypatch.setenv("NUMBA_NUM_THREADS", variable)
    assert threads.n_threads() == expected
