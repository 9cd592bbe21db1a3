"""What a dataset of very many meshes costs besides their clouds: plan, half of it, resume, status, verify.

    python benchmarks/scale.py [N ...] [--points 16] [--workers 2]

For each number of meshes (10,000 and 30,000 when none is given) as many files of a tetrahedron lie in class folders,
and the commands run as a person would run them, one cloud of each mesh:

    half      generate --shard 0/2
    resume    generate: what is done is found, the other half made
    status    status
    verify    verify
    again     generate, when the dataset is finished

Printed are each command's seconds of clock and processors, and the greatest memory of one of its processes.
"""

import sys
import tempfile
from pathlib import Path

from common import cost_of, run

TETRAHEDRON = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n3 0 2 3\n3 1 2 3\n"
N_CLASSES = 40


def lay_out(meshes: Path, n: int) -> None:
    """Write the mesh files, 1,000 at most in a folder, a tenth of them for testing."""
    for i in range(n):
        folder = meshes / f"class{i % N_CLASSES}_{i // 20_000}" / ("test" if i // N_CLASSES % 10 == 0 else "train")
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"solid_{i:06d}.off").write_text(TETRAHEDRON)


def main(*numbers: int, points: int = 16, workers: int = 2) -> None:
    for n in numbers or (10_000, 30_000):
        with tempfile.TemporaryDirectory() as name:
            meshes, out = Path(name, "meshes"), Path(name, "out")
            lay_out(meshes, n)
            make = ("generate", meshes, "--method", "oracle", "--views", "ring:1@30", "--points", points)
            make += ("--sample-size", points, "--workers", workers, "--out", out)
            commands = {"half": (*make, "--shard", "0/2"), "status": ("status", out), "resume": make}
            commands |= {"verify": ("verify", out), "again": make}
            print(f"{n:,} meshes:", flush=True)
            for what, arguments in commands.items():
                command = [sys.executable, "-m", "zbuf_occlude", *map(str, arguments)]
                clock, processors, megabytes = cost_of(command, out)
                print(f"{what:>8}: {clock:.1f} s, {processors:.1f} s of processors, {megabytes:.0f} MB", flush=True)


if __name__ == "__main__":
    run(main, __doc__)
