"""semantic-kitti-api, unmodified, on a sequence of `zbuf-occlude drive`: what it counts, joins and scores.

    python benchmarks/semantic_kitti_api.py CHECKOUT [--sweeps N]

CHECKOUT is a clone of PRBonn/semantic-kitti-api. The rig has two LiDARs without noise and drives a curve. Its own
configuration is taken but for the list of sequences, which is this one.

content.py              labels that it knows: every point must have one
generate_sequential.py  clouds of five sweeps: points of the ground must be on it
evaluate_semantics.py   the labels as predictions of themselves: a mean IoU of 1 over the classes that are there

Exit status 1 where one of them fails.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import yaml
from common import heads, row, run

RIG = """sensors:
  - {name: top, sensor: mine.yaml, position: [0, 0, 1.8]}
  - {name: front, sensor: mine.yaml, position: [1.5, 0.5, 0.9], yaw: 20, pitch: 5}
"""
MINE = "kind: spinning\nelevations: {from: -25, to: 10, n: 32}\ncolumns: 900\nrange_max: 80\n"
ROAD = 40
OFF = 2e-3
"""Metres that a point of the ground may be off it: files are float32."""


def called(*command: object) -> str:
    """Return what a command says; end where it fails."""
    done = subprocess.run([sys.executable, *map(str, command)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"error: {command[0]} ended with {done.returncode}:\n{done.stdout[-800:]}{done.stderr[-800:]}")
    return done.stdout


def main(checkout: Path, *, sweeps: int = 10) -> int:
    """Drive, and call each program."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "mine.yaml").write_text(MINE)
        (folder / "rig.yaml").write_text(RIG)
        config = yaml.safe_load((checkout / "config/semantic-kitti.yaml").read_text())
        config["split"] = {"train": [0], "valid": [0], "test": [0]}
        (folder / "config.yaml").write_text(yaml.safe_dump(config))
        kitti, joined = folder / "kitti", folder / "joined"
        drive = ["-m", "zbuf_occlude", "drive", "--rig", folder / "rig.yaml", "--velocity", "8,0,0", "--turn", "15"]
        called(*drive, "--sweeps", sweeps, "--out", kitti)
        counted = called(checkout / "content.py", "-d", kitti, "-c", folder / "config.yaml")
        called(checkout / "generate_sequential.py", "-d", kitti, "-o", joined, "-s", 5)
        (kitti / "sequences/00/predictions").symlink_to(kitti / "sequences/00/labels")
        scored = called(checkout / "evaluate_semantics.py", "-d", kitti, "-dc", folder / "config.yaml", "-s", "valid")
        _, labels = of_sequence(kitti)
        together, their_labels = of_sequence(joined)
    n_points = sum(map(len, labels))
    total, wrong = int(re.findall(r"total (\d+)", counted)[-1]), counted.count("wrong label")
    off = [
        float(np.abs(cloud[label & 0xFFFF == ROAD, 2] + 1.8).max())
        for cloud, label in zip(together, their_labels, strict=True)
    ]
    intersections = [float(each) for each in re.findall(r"IoU class .* = ([\d.]+)", scored)]
    kinds = {int(kind) for label in labels for kind in np.unique(label & 0xFFFF)}
    heads("program", "found", "expected")
    row("content.py", f"{total:,} points, {wrong} wrong labels", f"{n_points:,}, 0")
    row(
        "generate_sequential.py",
        f"{len(together[-1]):,} points in 5 sweeps, ground within {max(off) * 1e3:.2f} mm",
        "2 mm",
    )
    row(
        "evaluate_semantics.py",
        f"IoU 1 of {sum(each == 1 for each in intersections)} classes",
        f"{len(mapped(config, kinds))}",
    )
    right = total == n_points and not wrong and max(off) < OFF
    right &= sum(each == 1 for each in intersections) == len(mapped(config, kinds))
    return int(not right)


def mapped(config: dict[str, dict[int, int]], kinds: set[int]) -> set[int]:
    """Return the classes of the evaluation that some labels are."""
    return {config["learning_map"][kind] for kind in kinds} - {0}


def of_sequence(dataset: Path) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the clouds (n, 4) and labels (n,) of sequence 00."""
    folder = dataset / "sequences/00"
    clouds = [np.fromfile(path, "<f4").reshape(-1, 4) for path in sorted((folder / "velodyne").iterdir())]
    return clouds, [np.fromfile(path, "<u4") for path in sorted((folder / "labels").iterdir())]


if __name__ == "__main__":
    run(main, __doc__)
