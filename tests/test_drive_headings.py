"""benchmarks/drive_headings.py: angles of real boxes against KITTI's own, and the law found again in its own draws."""

import sys
from pathlib import Path

import numpy as np
import pytest

from tests.scenes import DATA
from zbuf_occlude import views
from zbuf_occlude.datasets.real.kitti import read_kitti

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

headings = pytest.importorskip("drive_headings")

KITTI = DATA / "kitti" / "training"


@pytest.mark.skipif(not KITTI.exists(), reason=f"{KITTI} is not there; set ZBUF_OCCLUDE_DATA")
@pytest.mark.parametrize("stem", ["000008", "000021"])
def test_azimuths_are_kittis_observation_angles(stem: str) -> None:
    """Alpha of a label is pi / 2 where the camera, 0.3 m before the LiDAR, sees the front."""
    sweep = read_kitti(KITTI / "velodyne" / f"{stem}.bin")
    rows = [line.split() for line in (KITTI / "label_2" / f"{stem}.txt").read_text().splitlines()]
    alphas = [np.degrees(float(row[3])) for row in rows if row[0] not in ("DontCare", "Misc")]
    found = headings.azimuths_in(sweep)
    assert len(found) == len(alphas) > 3
    differences = np.remainder(np.array(found) - np.array(alphas) + 90.0 + 180.0, 360.0) - 180.0
    assert np.abs(differences).max() < 4.0


@pytest.mark.parametrize("half_within", [8.0, 15.0, 30.0])
def test_the_likelihood_is_highest_where_views_were_drawn(half_within: float) -> None:
    eyes = views.drive(20_000, half_within=half_within, seed=5).eyes
    angles = np.degrees(np.arctan2(np.abs(eyes[:, 0]), np.abs(eyes[:, 1])))
    angles = angles[angles < headings.WIDEST]
    tried = np.arange(3.0, 60.0, 0.5)
    best = tried[np.argmax([headings.log_likelihood(angles, each) for each in tried])]
    assert abs(best - half_within) <= 1.0
