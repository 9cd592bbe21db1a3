"""Windows and reach of the LiDARs, scored on real cars: `zbuf-occlude compare-drives` on a part of the sweeps.

    python benchmarks/real_lidar.py LOG [--sensor NAME] [--sweeps even|odd] [--scores] [--out FILE.md]

LOG, --sensor, --out: as of `zbuf-occlude compare-drives`.
--sweeps: only files of even or odd numbers. On KITTI's even ones the windows of built-in vehicles were fitted.
--scores: by how much other reaches and windows miss the cars, instead of the report.
"""

import sys
from pathlib import Path

import numpy as np
from common import run

from zbuf_occlude.base.errors import OccludeError
from zbuf_occlude.studies.compare.drive_comparison import DRAWS, Sighting, compare_drive, drawn_returns
from zbuf_occlude.studies.compare.drive_report import drive_report

PARITIES = {"all": None, "even": 0, "odd": 1}
"""Remainders of the numbers of sweeps, by name."""
SCORED = (10.0, 50.0)
"""Metres. KITTI's nearer cars are cut by the image's edge, and their boxes guessed there."""
REACHES, WINDOWS = (110.0, 120.0, 130.0, 140.0), (0.01, 0.02, 0.05, 0.1, 0.2, 1.0)


def score_of(sightings: list[Sighting], simulated: np.ndarray) -> float:
    """Return the CRPS (Gneiting and Raftery 2007) of log(1 + returns): the mean of the mean of each 10 m."""
    real, made = np.log1p([one.real for one in sightings]), np.log1p(np.sort(simulated, axis=0))
    weights = (2.0 * np.arange(1, DRAWS + 1) - DRAWS - 1.0) / DRAWS**2
    each = np.abs(made - real).mean(axis=0) - weights @ made
    tens = np.array([one.distance // 10.0 for one in sightings])
    return float(np.mean([each[tens == ten].mean() for ten in np.unique(tens)]))


def scored(sightings: list[Sighting]) -> list[str]:
    """Say the score of the cars at `SCORED` by reach and by the factor of the darkest windows."""
    cars = [one for one in sightings if one.group == "cars" and SCORED[0] <= one.distance < SCORED[1]]
    if not cars:
        return ["There are no cars to score."]
    rows = [[score_of(cars, drawn_returns(cars, reach, darkest)) for darkest in WINDOWS] for reach in REACHES]
    return [
        f"{len(cars)} cars; columns: factor of the darkest windows.",
        "",
        "| reach, m | " + " | ".join(f"{darkest:g}" for darkest in WINDOWS) + " |",
        "| --- " * (len(WINDOWS) + 1) + "|",
        *(
            f"| {reach:g} | " + " | ".join(f"{x:.3f}" for x in row) + " |"
            for reach, row in zip(REACHES, rows, strict=True)
        ),
    ]


def main(
    log: Path, *, sensor: str | None = None, sweeps: str = "all", scores: bool = False, out: Path | None = None
) -> None:
    try:
        found = compare_drive(log, sensor, parity=PARITIES[sweeps])
    except OccludeError as error:
        raise SystemExit(f"error: {error}") from None
    for reason in found.skipped:
        print(f"skipped: {reason}", file=sys.stderr, flush=True)
    lines = scored(found.sightings) if scores else drive_report(found)
    print("\n".join(lines))
    if out is not None:
        out.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    run(main, __doc__, sweeps=PARITIES)
