"""The contact sheet: some clouds of a dataset, from a fixed viewpoint and from their own camera's (Figs. 10-11)."""

from importlib import import_module
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.drawing.marks import area_of_mark, marks_of, paint, picture_frame
from zbuf_occlude.views import Views

if find_spec("PIL") is not None:
    import_module("PIL.ImageDraw")  # while workers begin, not in the end, when nothing else is done

COLUMNS = 8
CONSIDERED = 256
"""The clouds shown are chosen among this many."""
FIXED = Views(np.radians([35.0]), np.radians([25.0]), np.array([4.0])).eyes[0]
"""The fixed viewpoint, about a cloud whose longest side is 1."""
TELLING_ANGLE = np.radians(115.0)
"""Between camera and fixed viewpoint: far enough round to show that the far side is missing."""

PANEL, TITLE = 240, 26
"""Pixels of a cloud's picture, each side, and of the height of a line above it."""
MARGIN = 1.08
FINER = 3
"""Pixels are painted this many times finer, then averaged, so that marks are round."""
A_POINT = 110 / 72
"""Pixels of a typographic point."""
BLACK, GREY = (0, 0, 0), (90, 90, 90)


def write_contact_sheet(path: Path, source: Source) -> bool:
    """Draw one cloud of each class (of up to eight classes) from the first clouds, of the first split if it has all.

    Parameters
    ----------
    path : Path
        The PNG.
    source : Source

    Returns
    -------
    bool
        Whether it was drawn: without Pillow (extra `report`) there is no picture, and a dataset all the same.
    """
    if find_spec("PIL") is None:
        return False
    from PIL import Image, ImageDraw  # late: Pillow is an extra

    classes, in_camera_frame = source.plan.classes, source.plan.recipe.frame == "camera"
    clouds = _clouds_of_all_classes(source)
    labels = clouds["label"][:, 0]
    shown = choose(labels, clouds["pose"])
    picture = Image.new("RGB", (len(shown) * PANEL, 2 * (TITLE + PANEL)), "white")
    for column, index in enumerate(shown):
        positions, camera, up = upright(clouds[index], in_camera_frame)
        values = clouds[index]["color"] / 255.0 if "color" in (clouds.dtype.names or ()) else None
        for row, (eye, above) in enumerate(((FIXED, None), (camera, up))):
            panel = _drawn(positions, eye, above, values)
            finer = Image.frombuffer("RGBX", panel.shape, panel, "raw", "RGBX", 0, 1)
            picture.paste(finer.reduce(FINER).convert("RGB"), (column * PANEL, _top(row)))
    draw = ImageDraw.Draw(picture)
    for column, index in enumerate(shown):
        azimuth, elevation = np.degrees(clouds[index]["view"][:2])
        lines = (
            (classes[labels[index]], 15, BLACK),
            (f"from azimuth {azimuth:.0f}, elevation {elevation:.0f}", 12, GREY),
        )
        for row, (line, size, colour) in enumerate(lines):
            text, font = _written(line, size)
            draw.text(((column + 0.5) * PANEL, _top(row) - TITLE / 2), text, colour, font, anchor="mm")
    atomic.write(path, lambda file: picture.save(file, format="PNG"))
    return True


def _clouds_of_all_classes(source: Source) -> NDArray[Any]:
    """The first clouds of the first split; of the others too, as long as a class is lacking."""
    clouds: list[NDArray[Any]] = []
    for split in source.order:
        clouds.extend(islice(source.batches(split, CONSIDERED), 1))
        if len(np.unique(np.concatenate([some["label"] for some in clouds]))) == len(source.plan.classes):
            break
    return np.concatenate(clouds)


def _top(row: int) -> int:
    """Where the panels of a row begin, in pixels from above."""
    return TITLE + row * (TITLE + PANEL)


def _drawn(
    positions: FloatArray, eye: FloatArray, up: FloatArray | None, values: FloatArray | None
) -> NDArray[np.uint32]:
    """Return the picture of a cloud, RGBA, `FINER` times as fine as it will be."""
    panel = np.full((PANEL * FINER, PANEL * FINER), 0xFFFFFFFF, dtype=np.uint32)
    places, colours = marks_of(positions, eye=eye, target=np.zeros(3), up=up, values=values)
    middle, half = picture_frame(places, None)
    half *= MARGIN
    diameter = np.sqrt(area_of_mark(places, half, PANEL / A_POINT)) * A_POINT * FINER
    pixels = ((places - middle) * (1.0, -1.0) / half + 1.0) / 2.0 * len(panel)
    paint(panel, pixels, float(diameter), colours)
    return panel


def _written(text: str, size: int) -> tuple[str, Any]:
    """Return a text and a font that has its characters, of a size at which it fits; else the text as Python escapes."""
    from PIL import ImageFont

    file: str | None = None
    font: Any
    if not text.isascii() and find_spec("matplotlib") is not None:
        from zbuf_occlude.drawing.pictures import font_file_for  # late: matplotlib takes half a second

        file = font_file_for(text)
    if file is None:
        text, font = text.encode("ascii", "backslashreplace").decode(), ImageFont.load_default(size)
    else:
        font = ImageFont.truetype(file, size)
    fits = (PANEL - 10) / max(font.getlength(text), 1.0)
    return text, font if fits >= 1.0 else font.font_variant(size=max(6, int(size * fits)))


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
