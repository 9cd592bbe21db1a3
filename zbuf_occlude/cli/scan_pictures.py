"""Pictures of scans: the range image as the sensor sees it, and the cloud from aside, coloured by range or object."""

from pathlib import Path

import numpy as np

from zbuf_occlude.arrays import BoolArray, FloatArray
from zbuf_occlude.sensors import Scan, Sensor

SURROUNDINGS = 4.0
"""Of the object's own radius: how far about it the cloud is drawn."""


def draw_scan(path: Path, scan: Scan, sensor: Sensor) -> None:
    """Write a PNG: returns by azimuth and elevation, and the cloud from aside and from above."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from zbuf_occlude.drawing.pictures import draw_cloud

    figure = Figure(figsize=(13, 4.4), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    image, by_range, by_object = figure.subplots(1, 3)
    towards = scan.positions - scan.origin
    middle = np.median(towards, axis=0) if len(scan) else np.array([1.0, 0.0, 0.0])
    turned = np.arctan2(towards[:, 1], towards[:, 0]) - np.arctan2(middle[1], middle[0])
    azimuth = np.degrees((turned + np.pi) % (2 * np.pi) - np.pi)
    elevation = np.degrees(np.arcsin(np.clip(towards[:, 2] / np.maximum(scan.ranges, 1e-9), -1, 1)))
    size = float(np.clip(20_000 / max(len(scan), 1), 0.3, 12.0))
    marks = image.scatter(azimuth, elevation, c=scan.ranges, s=size, cmap="turbo", linewidths=0)
    image.invert_xaxis()
    image.set_xlabel("azimuth from the middle, degrees")
    image.set_ylabel("elevation, degrees")
    image.set_title(f"{len(scan):,} returns of {sensor.name}, coloured by range", fontsize=10)
    figure.colorbar(marks, ax=image, label="metres")
    shown, centre, radius = around_the_object(scan)
    size = float(np.clip(20_000 / max(shown.sum(), 1), 0.3, 12.0))
    for axes, values, title in ((by_range, scan.ranges, "by range"), (by_object, scan.instances, "by object")):
        axes.set_axis_off()
        axes.set_title(title + ("" if shown.all() else ", about the object"), fontsize=10)
        if shown.any():
            away = scan.origin - centre
            angle = np.arctan2(away[1], away[0]) + np.radians(50.0)
            eye = centre + 3.5 * radius * np.array([np.cos(angle), np.sin(angle), 0.45])
            colour = colours(values[shown])
            draw_cloud(axes, scan.positions[shown], eye=eye, target=centre, values=colour, radius=radius, size=size)
    figure.savefig(path, format="png", dpi=110)


def around_the_object(scan: Scan) -> tuple[BoolArray, FloatArray, float]:
    """Return which returns are near the object, the middle of its own, and the radius about it that holds them.

    All returns where it has none, or where little else was met: a car in 150 m of ground would be a dot.
    """
    positions = scan.positions
    if not len(positions):
        return np.zeros(0, dtype=bool), np.zeros(3), 1.0
    centre, whole = (positions.min(axis=0) + positions.max(axis=0)) / 2, np.linalg.norm(np.ptp(positions, axis=0)) / 2
    own = positions[scan.instances == 0]
    if len(own):
        radius = SURROUNDINGS * float(np.linalg.norm(np.ptp(own, axis=0))) / 2
        if 0.0 < radius < whole:
            centre = (own.min(axis=0) + own.max(axis=0)) / 2
            return np.linalg.norm(positions - centre, axis=1) <= radius, centre, radius
    return np.ones(len(positions), dtype=bool), centre, float(whole) or 1.0


def colours(values: np.ndarray) -> np.ndarray:
    """Return an RGB colour in [0, 1] per value: whole numbers by turns, others along a scale."""
    from matplotlib import colormaps

    if np.issubdtype(values.dtype, np.integer):
        return np.asarray(colormaps["tab20"](values % 20)[:, :3])
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 1.0)
    return np.asarray(colormaps["turbo"]((values - low) / max(high - low, 1e-9))[:, :3])
