"""Where the second eye of the scanner of the Stanford bunny is: chosen on five of its scans, told on the other five.

    python benchmarks/line_laser.py [FOLDER]

FOLDER has bun_zipper.ply, bun.conf and the ten scans ($ZBUF_OCCLUDE_DATA/scans/bunny). Of each vertex of the mesh: is a
real point within twice the scans' spacing of it, and does the model predict so? The model: the laser's line meets it
from (x, 0.178, 1.3) in the scan's frame, below some incidence; one of two mirrors, turned to either side and upwards by
some angles, sees it too, below another incidence. What agrees best on the first five scans is taken.
"""

from itertools import product
from pathlib import Path

import numpy as np
from common import DATA, heads, row, run

import zbuf_occlude as zo
from zbuf_occlude.sensors import look_at
from zbuf_occlude.studies.compare.scan_comparison import compare_scans

CHOSEN_ON = ("bun000", "bun090", "bun270", "top3", "chin")
TOLD_ON = ("bun045", "bun180", "top2", "bun315", "ear_back")
AWAY = 1.25  # metres from the stage
SIDES, HEIGHTS = (20, 30, 40), (0, 10, 20)  # degrees
OWN_LIMITS, MIRROR_LIMITS = (76, 78, 80, 82, 84, 86, 90), (65, 70, 75, 80, 85)  # degrees of incidence


def main(folder: Path = DATA / "scans" / "bunny") -> None:
    mesh = zo.load_mesh(folder / "bun_zipper.ply")
    names = [*CHOSEN_ON, *TOLD_ON]
    mounted = look_at([0, 0.178, 1.3], [0, 0.178, 0], [0, 1, 0])

    def seen(**numbers: object) -> tuple[np.ndarray, np.ndarray]:
        """What a sensor predicts (scans, vertices), and what was scanned."""
        sensor = zo.sensors.make("cyberware-3030", noise=0, **numbers)
        scans = [folder / f"{name}.ply" for name in names]
        found = compare_scans(mesh, scans, sensor, poses=folder / "bun.conf", sensor_pose=mounted)
        cases = np.stack([each.cases for each in found])
        return cases <= 1, cases % 2 == 0

    heads("vertices predicted rightly", "on the five chosen on", "on the other five", "on all")
    none = {"incidence_max": 90, "baseline": 0, "baseline_incidence_max": 90}
    first, scanned = seen(**none)
    say("one eye", first == scanned)
    own = {limit: seen(**{**none, "incidence_max": limit})[0] for limit in OWN_LIMITS}
    best = max(own, key=lambda limit: share(own[limit] == scanned))
    say(f"one eye, incidence at most {best} degrees", own[best] == scanned)
    mirrors = {}
    for side, height, limit in product(SIDES, HEIGHTS, MIRROR_LIMITS):
        across, up = AWAY * np.tan(np.radians([side, height]))
        both = [[0, across, up], [0, -across, up]]
        mirrors[side, height, limit] = seen(**{**none, "baseline": both, "baseline_incidence_max": limit})[0]
    score = {
        (limit, *mirror): share((own[limit] & mirrors[mirror]) == scanned) for limit, mirror in product(own, mirrors)
    }
    limit, side, height, other = max(score, key=lambda key: score[key])
    agreed = (own[limit] & mirrors[side, height, other]) == scanned
    say(f"incidence at most {limit}; mirrors {side} degrees aside, {height} up, incidence at most {other}", agreed)


def share(agreed: np.ndarray) -> float:
    """Of the five scans that it is chosen on."""
    return float(agreed[: len(CHOSEN_ON)].mean())


def say(model: str, agreed: np.ndarray) -> None:
    row(model, *(f"{part:.2%}" for part in (share(agreed), agreed[len(CHOSEN_ON) :].mean(), agreed.mean())))


if __name__ == "__main__":
    run(main, __doc__)
