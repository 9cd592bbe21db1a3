"""The measurements behind the numbers of the pages: one row each, which `benchmarks/all.py` runs."""

from typing import NamedTuple

DATA = "../shared/data"
"""In a command as a page shows it; it is run with ZBUF_OCCLUDE_DATA in its place."""
PYTHON, COMMAND = "python", "zbuf-occlude"
FURNITURE, MODELNET, BUNNY = f"{DATA}/furniture", f"{DATA}/modelnet", f"{DATA}/scans/bunny"
OUT = "OUT"
"""In a command: a folder of the run's own."""


class Part(NamedTuple):
    """One measurement."""

    name: str  # what pages, figures.json and people call it
    command: str  # as a page shows it, words apart by spaces, `*` for any name; `OUT` is a folder of the run's own
    minutes: float  # on two idle cores, about
    cheaper: str = ""  # options added to it for less to do, on a busy machine
    reads: str = ""  # file under `OUT` that holds the result, in Markdown; by default what the command prints
    text: bool = False  # what is printed is columns of text, not Markdown

    @property
    def cheap(self) -> str:
        """The same command with less to do."""
        return f"{self.command} {self.cheaper}".strip()


PARTS = (
    Part("methods", f"python benchmarks/method_table.py {MODELNET}", 5, "--seconds 2 --row-seconds 10"),
    Part(
        "cells",
        f"python benchmarks/cells.py {FURNITURE} --quick --processors",
        5,
        "--repeats 1 --scene furniture?10,000",
    ),
    Part("random-scenes", "python benchmarks/random_scenes.py --scenes 3000 --seed 22", 8, "--scenes 100", text=True),
    Part(
        "random-rays",
        "python benchmarks/random_scenes.py --scenes 200 --seed 22 --question rays",
        12,
        "--scenes 100",
        text=True,
    ),
    Part("watertight", "python benchmarks/watertight.py --most-faces 1500", 3, "--most-faces 300"),
    Part(
        "depth-buffer-accuracy", "python benchmarks/depth_buffer_accuracy.py --repeats 3", 3, "--repeats 1 --every 10"
    ),
    Part("whole-job", f"python benchmarks/whole_job.py {FURNITURE} --stages", 4, "--repeats 1 --limit 20", text=True),
    Part(
        "whole-job-cold",
        f"python benchmarks/whole_job.py {FURNITURE} --method exact --repeats 0 --cold",
        1.5,
        text=True,
    ),
    Part(
        "all-methods",
        "python benchmarks/all_methods.py --seconds 0.5 --rounds 2",
        10,
        "--seconds 0.2 --rounds 1 --faces 340 2600 --points 2000",
    ),
    Part("own-surface", f"python benchmarks/own_surface.py {MODELNET}/*/train/*.off", 2),
    Part(
        "reference",
        f"python benchmarks/reference_check.py {MODELNET}/chair/train/chair_0003.off",
        2,
        "--points 100",
        text=True,
    ),
    Part("grid-errors", f"python benchmarks/object_space.py errors {MODELNET}/*/train/*.off", 2),
    Part("culling", f"python benchmarks/object_space.py culling {MODELNET}/chair/train/chair_0003.off", 1),
    Part("grid-time", "python benchmarks/object_space.py grid", 3, "--faces 4000"),
    Part("object-space-growth", "python benchmarks/object_space.py growth", 3),
    Part("modelnet-o", "python benchmarks/modelnet_o.py", 2, text=True),
    Part("preset-costs", "python benchmarks/dataset_costs.py presets", 2, "--limit 2"),
    Part("scan-costs", "python benchmarks/dataset_costs.py scans", 1, "--limit 2"),
    Part("drive-headings", f"python benchmarks/drive_headings.py {DATA}/kitti", 0.5),
    Part("line-laser", f"python benchmarks/line_laser.py {BUNNY}", 4),
    Part(
        "moving-camera",
        f"python benchmarks/moving_camera.py {FURNITURE}/armchair2__*.obj {FURNITURE}/bookcase__*.obj",
        1,
        "--places 4 --faces 10000",
    ),
    Part("on-the-fly", "python benchmarks/on_the_fly.py", 1, "--seconds 1 --meshes 4", text=True),
    Part("shape-distances", "python benchmarks/shape_distances.py", 5, "--members 8"),
    Part("areas", f"python benchmarks/dead_angle.py {MODELNET} {FURNITURE} --objects 8", 3),
    Part(
        "study",
        "zbuf-occlude paper table3 --quick --budget clouds --budget epochs --out OUT/study",
        45,
        "--models voxnet --seeds 2 --objects 8 --points 128",
        reads="study/study.md",
    ),
    Part(
        "study-voxels",
        "zbuf-occlude paper elevation --quick --models voxnet --seeds 11 --voxels 30 --out OUT/voxels",
        18,
        "--seeds 1 --objects 8 --points 128",
        reads="voxels/study.md",
    ),
    Part(
        "study-plain",
        "zbuf-occlude paper elevation --quick --models voxnet --seeds 11 --out OUT/plain",
        18,
        "--seeds 1 --objects 8 --points 128",
        reads="plain/study.md",
    ),
    Part(
        "realism",
        "zbuf-occlude paper realism --quick --objects 8 --out OUT/realism",
        6,
        "--objects 5 --seeds 1 --points 64",
        reads="realism/study.md",
    ),
)
