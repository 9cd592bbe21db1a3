"""Headings of labelled road users as a car's LiDAR sees them, against the law of `--views drive:N`.

    python benchmarks/drive_headings.py LOG [LOG ...]

LOG: as of `zbuf-occlude compare-drives`. For each labelled road user the angle between its axis, front or rear, and the
direction to the sensor. KITTI labels only what its camera sees: a car that is parallel to the road is at most 41
degrees from its axis there. So only angles below `WIDEST` are compared, with the law cut off there. `half_within` is
fitted to them by maximum likelihood; its interval has the likelihood's ratio of 95 %. Objects that are labelled in
several sweeps count each time.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from common import heads, row, run

from zbuf_occlude.datasets.real.sweeps import Sweep, find_sweeps
from zbuf_occlude.views import HALF_WITHIN

ROAD_USERS = ("car", "van", "truck", "bus", "vehicle", "cycl", "pedestrian", "person", "rider", "tram", "trailer")
WIDEST = 41.0
"""Degrees: half the width of the picture in which KITTI's objects are labelled."""
LIKELIHOOD_RATIO = 1.92
"""Half of the 95 % quantile of the chi-squared distribution of one degree of freedom."""


def azimuths_in(sweep: Sweep) -> list[float]:
    """Return the azimuth of the sensor about each road user, degrees from its front, in -180..180."""
    found = []
    for box in sweep.boxes:
        if any(word in box.label.lower() for word in ROAD_USERS):
            (x, y), ahead = (sweep.middle - box.centre)[:2], box.rotation[:, 0]
            azimuth = np.arctan2(y, x) - np.arctan2(ahead[1], ahead[0])
            found.append(float(np.degrees(np.remainder(azimuth + np.pi, 2 * np.pi) - np.pi)))
    return found


def law(half_within: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return the distribution function of the angle to the axis, degrees, in closed form."""
    return lambda d: 2 / np.pi * np.arctan(np.tan(np.radians(d)) / np.tan(np.radians(half_within)))


def log_likelihood(angles: np.ndarray, half_within: float) -> float:
    """Return the logarithm of the likelihood of angles below `WIDEST` under the law cut off there."""
    narrow, d = np.tan(np.radians(half_within)), np.radians(angles)
    density = 2 / np.pi * narrow / ((narrow * np.cos(d)) ** 2 + np.sin(d) ** 2)
    return float(np.log(density / law(half_within)(np.array(WIDEST))).sum())


def main(*logs: Path) -> None:
    azimuths = np.abs([each for log in logs for load in find_sweeps(log)[1] for each in azimuths_in(load())])
    angles = np.minimum(azimuths, 180.0 - azimuths)
    n_all, n_rear, angles = len(angles), int((azimuths > 90.0).sum()), np.sort(angles[angles < WIDEST])
    tried = np.arange(3.0, 60.0, 0.1)
    likelihoods = np.array([log_likelihood(angles, half_within) for half_within in tried])
    likely = tried[likelihoods > likelihoods.max() - LIKELIHOOD_RATIO]

    def cut(d: np.ndarray) -> np.ndarray:
        return law(HALF_WITHIN)(d) / law(HALF_WITHIN)(np.array(WIDEST))

    heads("degrees to the axis", "observed", "law, cut off", "law, all round", words=0)
    for degrees in (5.0, 10.0, 15.0, 20.0, 30.0):
        shares = (angles < degrees).mean(), cut(np.array(degrees)), law(HALF_WITHIN)(np.array(degrees))
        row(f"{degrees:g}", *(f"{share:.0%}" for share in shares))
    n, expected = len(angles), cut(angles)
    distance = max((np.arange(1, n + 1) / n - expected).max(), (expected - np.arange(n) / n).max())
    print(
        f"\n{n_all} sightings, {n} within {WIDEST:g} degrees of their axis; {n_rear / n_all:.0%} seen from behind. "
        f"Fitted: half within {tried[likelihoods.argmax()]:.1f} degrees ({likely.min():.1f} to {likely.max():.1f}); "
        f"the law has {HALF_WITHIN:g}. Kolmogorov-Smirnov distance {distance:.2f}; by chance up to "
        f"{1.36 / np.sqrt(n):.2f} in 95 % of samples."
    )


if __name__ == "__main__":
    run(main, __doc__)
