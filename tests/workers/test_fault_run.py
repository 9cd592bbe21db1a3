"""A small `benchmarks/fault_run.py`: a worker, the whole run, and the run that writes its final files are killed."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SMALL = [
    "--limit",
    "48",
    "--views",
    "ring:75@30",
    "--points",
    "100",
    "--sample-size",
    "16",
    "--method",
    "oracle",
    "--workers",
    "2",
]


@pytest.mark.long
def test_a_run_killed_three_times_makes_the_same_bytes() -> None:
    command = [sys.executable, "benchmarks/fault_run.py", "--kills", "3", "--every", "1", "--format", "packed", *SMALL]
    outcome = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=500, check=False)
    assert outcome.returncode == 0, outcome.stdout + outcome.stderr
    for kind in ("a worker", "the whole run", "the whole run, writing the final files"):
        assert f"  1 x {kind}\n" in outcome.stdout
    assert "the data equal the undisturbed runs'" in outcome.stdout
