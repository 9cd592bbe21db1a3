"""What a dataset of very many meshes costs besides their clouds: plan, half of it, resume, status, verify.

    python benchmarks/scale.py [N ...] [--points 16] [--workers 2] [--json FILE]

For each number of meshes (10,000 and 30,000 when none is given) as many files of a tetrahedron lie in class folders,
and the commands run as a person would run them, one cloud of each mesh:

    half      generate --shard 0/2
    resume    generate: what is done is found, the other half made
    status    status
    verify    verify
    again     generate, when the dataset is finished

Printed are each command's seconds of clock and processors, and the greatest memory of one of its processes.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

TETRAHEDRON = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n3 0 2 3\n3 1 2 3\n"
N_CLASSES = 40


def lay_out(meshes: Path, n: int) -> None:
    """Write the mesh files, 1,000 at most in a folder, a tenth of them for testing."""
    for i in range(n):
        folder = meshes / f"class{i % N_CLASSES}_{i // 20_000}" / ("test" if i // N_CLASSES % 10 == 0 else "train")
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"solid_{i:06d}.off").write_text(TETRAHEDRON)


def measured(*arguments: object) -> dict[str, float]:
    """Run a command of zbuf-occlude to its end."""
    began = time.perf_counter()
    command = [sys.executable, "-m", "zbuf_occlude", *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    said = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)} must succeed; it ended with {process.returncode}: {said[-500:]}")
    return {
        "seconds": time.perf_counter() - began,
        "processors": usage.ru_utime + usage.ru_stime,
        "megabytes": usage.ru_maxrss / 1e3,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("numbers", nargs="*", type=int, default=[10_000, 30_000], metavar="N")
    parser.add_argument("--points", type=int, default=16)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path)
    known = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for n in known.numbers:
        with tempfile.TemporaryDirectory() as name:
            meshes, out = Path(name, "meshes"), Path(name, "out")
            lay_out(meshes, n)
            make = ("generate", meshes, "--method", "oracle", "--views", "ring:1@30", "--points", known.points)
            make += ("--sample-size", known.points, "--workers", known.workers, "--out", out)
            row: dict[str, Any] = {
                "meshes": n,
                "half": measured(*make, "--shard", "0/2"),
                "status": measured("status", out),
                "resume": measured(*make),
                "verify": measured("verify", out),
                "again": measured(*make),
            }
            rows.append(row)
            said = (f"{k} {v['seconds']:.1f} s {v['megabytes']:.0f} MB" for k, v in row.items() if k != "meshes")
            print(f"{n:,} meshes: " + ", ".join(said), flush=True)
    if known.json:
        known.json.write_text(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
