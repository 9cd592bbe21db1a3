"""Hand-made results and real scans, and a study small enough for a test."""

import struct
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.studies.learn.evaluation import Confusion
from zbuf_occlude.studies.paper.design import (
    AUGMENTATION,
    CLOUDS,
    ELEVATION,
    GENERATED,
    HSR,
    ORIGINAL,
    QUICK,
    TEST_ELEVATIONS,
)
from zbuf_occlude.studies.paper.results import Result

TINY = replace(
    QUICK,
    name="tiny",
    summary="of a test",
    models=("voxnet",),
    seeds=(0, 1),
    passes=16,
    real_passes=16,
    epochs=1,
    batch_size=32,
    n_validation=4,
    elevation_epochs=1,
    elevation_each=5,
    azimuths=1,
    elevation_sampled=150,
    elevation_points=32,
    augmentation_models=("voxnet",),
    shares=(2, 1, 1),
    sampled=150,
    n_points=(32,),
    views=2,
)
"""About ten classifiers of a second each."""

DOCUMENT = {
    "n_parameters": 1000, "n_training": 40, "epochs": 3, "seconds": 1.5, "machine": "a machine", "device": "cpu",
}  # fmt: skip


def write_bin(path: Path, points: np.ndarray) -> None:
    """Write points field by field, as the description of Sydney Urban Objects defines them."""
    rows = [
        struct.pack("<qBBfffffi", 1320370833971539 + i, 52, 7, *point, 0.5, 9.25, i) for i, point in enumerate(points)
    ]
    path.write_bytes(b"".join(rows))


def write_csv(path: Path, points: np.ndarray) -> None:
    lines = [f"20111104T010203.{i:06d},52,7,{x:.6f},{y:.6f},{z:.6f},0.5,9.25,{i}" for i, (x, y, z) in enumerate(points)]
    path.write_text("\n".join(lines) + "\n")


def write_sydney(root: Path, scans: Mapping[str, np.ndarray]) -> Path:
    """Write scans by their names CLASS.NUMBER.FRAME, trees as CSV, those of number n into fold n % 4; return `root`."""
    for name in ("objects", "folds"):
        (root / name).mkdir(parents=True)
    folds: list[list[str]] = [[], [], [], []]
    for name, points in scans.items():
        if name.startswith("tree"):
            write_csv(root / "objects" / f"{name}.csv", points)
        else:
            write_bin(root / "objects" / f"{name}.bin", points)
        folds[int(name.split(".")[1]) % 4].append(f"{name}.bin\n")
    for fold, lines in enumerate(folds):
        (root / "folds" / f"fold{fold}.txt").write_text("".join(lines))
    return root


def confusion(accuracy: float, n: int = 200, truth: tuple[str, ...] = ("bed", "car")) -> Confusion:
    """Return the confusion matrix of `n` clouds of two classes with an accuracy."""
    right = round(accuracy * n / 2)
    wrong = n // 2 - right
    return Confusion(truth, ("bed", "car"), np.array([[right, wrong], [wrong, right]]))


def result(experiment: str, tests: dict[str, Confusion], **facts: Any) -> Result:
    """Return a result with the shortest document that a report needs."""
    budget = {} if experiment == ELEVATION else {"budget": CLOUDS}
    return Result(experiment, {"seed": 0, **budget, **facts}, tests, DOCUMENT)


def study_of_augmentation() -> list[Result]:
    """Return results of two seeds of VoxNet and one of PointNet; accuracies of seeds differ by 0.01."""
    table = {1: (0.80, 0.75), 2: (0.85, 0.45), 3: (0.90, 0.80)}
    rows = []
    for model, seeds in (("voxnet", (0, 1)), ("pointnet", (0,))):
        for training_set, (original, generated) in table.items():
            for seed in seeds:
                tests = {ORIGINAL: confusion(original + 0.01 * seed), GENERATED: confusion(generated + 0.01 * seed)}
                rows.append(result(AUGMENTATION, tests, model=model, set=training_set, points=1024, seed=seed))
    return rows


def study_of_methods() -> list[Result]:
    """Return results of VoxNet on clouds by a grid and by a depth buffer."""
    grid, depth = "occupancy_grid:n=64", "depth_buffer"
    rows = []
    for seed in (0, 1):
        for method, shares in ((grid, (0.7, 0.6, 0.65)), (depth, (0.72, 0.74, 0.6))):
            tests = {ORIGINAL: confusion(0.5)}
            names = (GENERATED, f"{GENERATED}:{depth}", f"{GENERATED}:{grid}")
            tests |= {name: confusion(share + 0.02 * seed) for name, share in zip(names, shares, strict=True)}
            rows.append(result(HSR, tests, model="voxnet", method=method, points=1024, seed=seed))
    return rows


def study_of_elevation() -> list[Result]:
    """Return results of one seed of VoxNet: 80 % everywhere, 60 % at 0, 20 points less with objects held out."""
    rows = []
    for split, less in (("elevations", 0.0), ("objects", 0.2)):
        tests = {str(e): confusion((0.6 if e == 0 else 0.8) - less) for e in TEST_ELEVATIONS}
        rows.append(result(ELEVATION, tests, model="voxnet", split=split))
    return rows
