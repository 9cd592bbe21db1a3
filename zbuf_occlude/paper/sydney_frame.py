"""Which way is up in the Sydney scans: found from the scans themselves, and a picture of some to look at."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.paper.sydney import UPS, VEHICLES, find_scans, largest_scan, read_scan

TOP_HEAVY = ("tree", "traffic_sign", "traffic_lights")
"""Classes that are wider above than below: a crown on a trunk, a plate or lights on a pole."""
ASSUMED = "-z"
"""Taken where the scans do not say: x forward, y right, z down, as vehicles' frames of that group are."""
LEAST_POINTS, LEAST_HEIGHT = 30, 0.5
"""A scan with fewer points, or lower (metres), does not vote."""
SURE = 3.0
"""Standard deviations that the votes must be away from a coin's."""
SHOWN = ("car", "4wd", "truck", "tree", "traffic_sign", "pedestrian")


@dataclass(frozen=True)
class Frame:
    """Which way the scans' z axis points, and how that is known.

    Parameters
    ----------
    up : str
        One of `UPS`: the direction of the files that is up.
    votes : dict of str to (int, int)
        For "vehicles" and "tops" how many scans say z, and how many -z; empty when a person said it.
    """

    up: str
    votes: dict[str, tuple[int, int]]

    @property
    def said(self) -> str:
        """How it is known, in a sentence."""
        if not self.votes:
            return f"{self.up} of the files is up, as --sydney-up says."
        (vehicles_z, vehicles_down), (tops_z, tops_down) = self.votes["vehicles"], self.votes["tops"]
        how = (
            f"wider below than above are {vehicles_down} vehicles if -z is up, {vehicles_z} if z is; wider above than "
            f"below {tops_down} trees, signs and lights if -z is up, {tops_z} if z is."
        )
        known = decided(self.votes)
        return f"{self.up} of the files is up, " + (f"found from the scans: {how}" if known else f"assumed: {how}")

    @property
    def document(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return {"up": self.up, "said": self.said}


def find_frame(root: Path) -> Frame:
    """Find out which way is up, from all scans of the folds.

    Parameters
    ----------
    root : Path
        As for `find_scans`.

    Returns
    -------
    Frame
        `ASSUMED` where the scans do not say clearly.

    Raises
    ------
    DatasetError
        As `find_scans` and `read_scan`.

    Notes
    -----
    A vehicle is longer below, where bonnet and boot are, than its cabin; what stands on a trunk or a pole is wider than
    it. Neither needs to know where the scanner was. That there are more points below does not say it: of simulated
    scans of cars only five of twelve have. Each scan is a vote, and the votes must be `SURE` standard deviations away
    from those of a coin.
    """
    counts = Counter((kind_of(scan.label), vote(read_scan(scan.path, "z"), scan.label)) for scan in find_scans(root))
    votes = {kind: (counts[kind, 1], counts[kind, -1]) for kind in ("vehicles", "tops")}
    return Frame(decided(votes) or ASSUMED, votes)


def decided(votes: dict[str, tuple[int, int]]) -> str:
    """Return the direction that the votes are clear about, or nothing."""
    for_z, for_down = np.sum(list(votes.values()), axis=0)
    if abs(for_z - for_down) <= SURE * np.sqrt(for_z + for_down):
        return ""
    return UPS[0] if for_z > for_down else UPS[1]


def kind_of(label: str) -> str:
    """Return what a class's scans can say: vehicles, tops, or nothing."""
    return "vehicles" if label in VEHICLES else "tops" if label in TOP_HEAVY else ""


def vote(points: FloatArray, label: str) -> int:
    """Say which way is up in a scan: 1 for z, -1 for -z, 0 where it does not say.

    Parameters
    ----------
    points : (n, 3) float64
        As in the file, metres.
    label : str
        Its class.
    """
    heights = points[:, 2] - (points[:, 2].min() + points[:, 2].max()) / 2.0
    if len(points) < LEAST_POINTS or np.ptp(heights) < LEAST_HEIGHT or not kind_of(label):
        return 0
    above, below = points[heights > 0.0], points[heights < 0.0]
    wider_above = int(np.sign(width(above) - width(below)))
    return -wider_above if label in VEHICLES else wider_above


def width(points: FloatArray) -> float:
    """Return how far points lie apart on the ground, root mean square; 0 without any."""
    return float(np.sqrt(points[:, :2].var(axis=0).sum())) if len(points) else 0.0


def picture_of_scans(root: Path, up: str) -> Figure:
    """Draw the largest scan of some classes from the side, up as taken: wheels and trunks belong below."""
    figure = Figure(figsize=(11.0, 2.6), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    for axes, label in zip(figure.subplots(1, len(SHOWN)), SHOWN, strict=True):
        axes.set_axis_off()
        axes.set_aspect("equal", "datalim")
        if any(scan.label == label for scan in find_scans(root)):
            points = read_scan(largest_scan(root, label).path, up)
            ground = points[:, :2] - points[:, :2].mean(axis=0)
            along = np.linalg.svd(ground, full_matrices=False)[2][0]  # its longest direction lies across the picture
            axes.plot(ground @ along, points[:, 2], linestyle="none", marker=".", markersize=1.5, color="#0072b2")
        axes.set_title(label, fontsize=10)
    return figure
