"""The contact sheet: some clouds of a dataset, from a fixed viewpoint and from their own camera's (Figs. 10-11)."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.views import Views

COLUMNS = 8
CONSIDERED = 1024
"""The clouds shown are chosen among so many."""
FIXED = Views(np.radians([35.0]), np.radians([25.0]), np.array([4.0])).eyes[0]
"""The fixed viewpoint, about a cloud whose longest side is 1."""
TELLING_ANGLE = np.radians(115.0)
"""Between camera and fixed viewpoint: far enough round to show that the far side is missing."""


def write_contact_sheet(path: Path, source: Source) -> bool:
    """Draw one cloud of each class (of up to eight classes) from the first clouds of the first split.

    Parameters
    ----------
    path : Path
        The PNG.
    source : Source

    Returns
    -------
    bool
        Whether it was drawn: without matplotlib (extra `report`) there is no picture, and a dataset all the same.
    """
    if find_spec("matplotlib") is None:
        return False
    from zbuf_occlude.drawing import draw_cloud, new_figure, set_title  # late: matplotlib is an extra

    classes, in_camera_frame = source.plan.classes, source.plan.recipe.frame == "camera"
    clouds = next(source.batches(next(iter(source.order)), CONSIDERED))
    labels = clouds["label"][:, 0]
    shown = choose(labels, clouds["pose"])
    figure, axes = new_figure(2, len(shown), panel=2.2)
    for column, index in enumerate(shown):
        positions, camera, up = upright(clouds[index], in_camera_frame)
        top, bottom = axes[:, column]
        draw_cloud(top, positions, eye=FIXED, target=(0.0, 0.0, 0.0))
        draw_cloud(bottom, positions, eye=camera, target=(0.0, 0.0, 0.0), up=up)
        azimuth, elevation = np.degrees(clouds[index]["view"][:2])
        set_title(top, classes[labels[index]], fontsize=10)
        bottom.set_title(f"az {azimuth:.0f}°, el {elevation:.0f}°", fontsize=8, color="0.35")
    figure.suptitle("Above: from a fixed viewpoint. Below: from the camera of each cloud.", fontsize=9, color="0.35")
    atomic.write(path, lambda file: figure.savefig(file, format="png", dpi=110))
    return True


def choose(labels: NDArray[Any], poses: FloatArray) -> list[int]:
    """Choose a cloud of each class whose camera stands far round from the fixed viewpoint, not too high or low."""
    towards = poses[:, 2, :3]  # the third row of a view matrix points from the target to the eye
    angle = np.arccos(np.clip(towards @ (FIXED / np.linalg.norm(FIXED)), -1, 1))
    awkward = np.abs(angle - TELLING_ANGLE) + np.maximum(0, np.abs(np.arcsin(np.clip(towards[:, 2], -1, 1))) - 0.8)
    present = np.unique(labels)
    picked = present[np.linspace(0, len(present) - 1, min(COLUMNS, len(present))).astype(int)]
    return [int(np.flatnonzero(labels == label)[awkward[labels == label].argmin()]) for label in picked]


def upright(cloud: Any, in_camera_frame: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a cloud in the object's axes, centred, longest side 1, with its camera's position and up there."""
    pose, positions = cloud["pose"], cloud["data"] / cloud["factor"] + cloud["centre"]
    rotation, translation = pose[:3, :3], pose[:3, 3]
    if in_camera_frame:
        positions = (positions - translation) @ rotation
    low, high = positions.min(axis=0), positions.max(axis=0)
    centre, longest = (low + high) / 2, float((high - low).max()) or 1.0  # 1: all points are in one place
    eye = -rotation.T @ translation
    return (positions - centre) / longest, (eye - centre) / longest, rotation[1]
