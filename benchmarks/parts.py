"""The measurements behind the numbers of the pages: one row each, which `benchmarks/all.py` runs."""

from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DATA = "../shared/data"
"""In a command as a page shows it; it is run with ZBUF_OCCLUDE_DATA in its place."""
PYTHON, COMMAND = "python", "zbuf-occlude"
FURNITURE, MODELNET = f"{DATA}/furniture", f"{DATA}/modelnet"
OUT = "OUT"
"""In a command: a folder of the run's own."""


@dataclass(frozen=True)
class Part:
    """One measurement.

    Parameters
    ----------
    name : str
        What pages, figures.json and people call it.
    command : str
        As a page shows it, words apart by spaces, `*` for any name; `OUT` is a folder of the run's own.
    minutes : float
        On two idle cores, about.
    cheap : str
        The same command with less to do, for a busy machine.
    times : bool
        Whether it is about time: then it wants an idle machine.
    needs : str
        A folder or file that must be there.
    reads : str
        The file under `OUT` that holds the result, in Markdown; by default what the command prints.
    text : bool
        What is printed is columns of text, not Markdown.
    """

    name: str
    command: str
    minutes: float
    cheap: str
    times: bool = True
    needs: str = ""
    reads: str = ""
    text: bool = False


PARTS = (
    Part(
        "methods",
        f"python benchmarks/method_table.py {MODELNET}",
        5,
        f"python benchmarks/method_table.py {MODELNET} --seconds 2 --row-seconds 10",
        needs=MODELNET,
    ),
    Part(
        "fresh-meshes",
        f"python benchmarks/fresh_meshes.py {FURNITURE}",
        5,
        f"python benchmarks/fresh_meshes.py {FURNITURE} --limit 10 --repeats 1",
        needs=FURNITURE,
    ),
    Part(
        "fresh-meshes-small",
        f"python benchmarks/fresh_meshes.py {FURNITURE} --points 2048 --eyes 25",
        1,
        f"python benchmarks/fresh_meshes.py {FURNITURE} --limit 10 --points 2048 --eyes 25 --repeats 1",
        needs=FURNITURE,
    ),
    Part(
        "fresh-meshes-many",
        f"python benchmarks/fresh_meshes.py {FURNITURE} --points 100000 --limit 15",
        1,
        f"python benchmarks/fresh_meshes.py {FURNITURE} --limit 3 --points 100000 --repeats 1",
        needs=FURNITURE,
    ),
    Part(
        "random-scenes",
        "python benchmarks/random_scenes.py --scenes 6000 --seed 22",
        10,
        "python benchmarks/random_scenes.py --scenes 200 --seed 22",
        times=False,
        text=True,
    ),
    Part(
        "depth-buffer-accuracy",
        "python benchmarks/depth_buffer_accuracy.py --repeats 3",
        3,
        "python benchmarks/depth_buffer_accuracy.py --repeats 1 --every 10",
    ),
    Part(
        "whole-job",
        f"python benchmarks/whole_job.py {FURNITURE} --stages",
        4,
        f"python benchmarks/whole_job.py {FURNITURE} --repeats 1 --limit 20",
        needs=FURNITURE,
        text=True,
    ),
    Part(
        "whole-job-cold",
        f"python benchmarks/whole_job.py {FURNITURE} --method exact --repeats 0 --cold",
        1.5,
        f"python benchmarks/whole_job.py {FURNITURE} --method exact --repeats 0 --cold",
        needs=FURNITURE,
        text=True,
    ),
    Part(
        "all-methods",
        "python benchmarks/all_methods.py --seconds 0.5 --rounds 2",
        10,
        "python benchmarks/all_methods.py --seconds 0.2 --rounds 1 --faces 340 2600 --points 2000",
    ),
    Part(
        "own-surface",
        f"python benchmarks/own_surface.py {MODELNET}/*/train/*.off",
        2,
        "python benchmarks/own_surface.py",
        times=False,
        needs=MODELNET,
    ),
    Part(
        "judge",
        f"python benchmarks/judge_check.py {MODELNET}/chair/train/chair_0003.off",
        2,
        f"python benchmarks/judge_check.py {MODELNET}/chair/train/chair_0003.off --points 100",
        times=False,
        needs=MODELNET,
        text=True,
    ),
    Part(
        "grid-errors",
        f"python benchmarks/object_space.py errors {MODELNET}/*/train/*.off",
        2,
        "python benchmarks/object_space.py errors --faces 2000",
        times=False,
        needs=MODELNET,
    ),
    Part(
        "culling",
        f"python benchmarks/object_space.py culling {MODELNET}/chair/train/chair_0003.off",
        1,
        "python benchmarks/object_space.py culling --faces 340",
        needs=MODELNET,
    ),
    Part(
        "grid-time",
        "python benchmarks/object_space.py grid",
        3,
        "python benchmarks/object_space.py grid --faces 2000",
    ),
    Part(
        "object-space-growth",
        "python benchmarks/object_space.py growth",
        3,
        "python benchmarks/object_space.py growth",
    ),
    Part(
        "modelnet-o",
        "python benchmarks/modelnet_o.py",
        2,
        "python benchmarks/modelnet_o.py",
        text=True,
    ),
    Part(
        "preset-costs",
        "python benchmarks/dataset_costs.py presets",
        2,
        "python benchmarks/dataset_costs.py presets --limit 2",
    ),
    Part(
        "scan-costs",
        "python benchmarks/dataset_costs.py scans",
        1,
        "python benchmarks/dataset_costs.py scans --limit 2",
    ),
    Part(
        "on-the-fly",
        "python benchmarks/on_the_fly.py",
        1,
        "python benchmarks/on_the_fly.py --seconds 1 --meshes 4",
        text=True,
    ),
    Part(
        "shape-distances",
        "python benchmarks/shape_distances.py",
        5,
        "python benchmarks/shape_distances.py --members 8",
        times=False,
    ),
    Part(
        "first-hits",
        f"python benchmarks/first_hits.py {FURNITURE}",
        1,
        f"python benchmarks/first_hits.py {FURNITURE} --repeats 1",
        needs=FURNITURE,
        text=True,
    ),
    Part(
        "areas",
        f"python benchmarks/dead_angle.py {MODELNET} {FURNITURE} --objects 8",
        3,
        "python benchmarks/dead_angle.py --objects 8",
        times=False,
        needs=FURNITURE,
    ),
    Part(
        "study",
        "zbuf-occlude paper table3 --quick --budget clouds --budget epochs --out OUT/study",
        45,
        "zbuf-occlude paper table3 --quick --models voxnet --seeds 2 --objects 8 --points 128 --budget clouds "
        "--budget epochs --out OUT/study",
        times=False,
        reads="study/study.md",
    ),
    Part(
        "study-voxels",
        "zbuf-occlude paper elevation --quick --models voxnet --seeds 11 --voxels 30 --out OUT/voxels",
        18,
        "zbuf-occlude paper elevation --quick --models voxnet --seeds 1 --objects 8 --points 128 --voxels 30 "
        "--out OUT/voxels",
        times=False,
        reads="voxels/study.md",
    ),
    Part(
        "study-plain",
        "zbuf-occlude paper elevation --quick --models voxnet --seeds 11 --out OUT/plain",
        18,
        "zbuf-occlude paper elevation --quick --models voxnet --seeds 1 --objects 8 --points 128 --out OUT/plain",
        times=False,
        reads="plain/study.md",
    ),
    Part(
        "realism",
        "zbuf-occlude paper realism --quick --objects 8 --out OUT/realism",
        6,
        "zbuf-occlude paper realism --quick --objects 5 --seeds 1 --points 64 --out OUT/realism",
        times=False,
        reads="realism/study.md",
    ),
)
