"""Pictures of a dataset: the contact sheet (Figs. 10-11), and the gallery, a page where clouds are turned by hand.

The contact sheet shows some clouds from a fixed viewpoint and from their own camera's; of pairs also the complete
clouds, and both over each other. The gallery is one self-contained HTML page, classes x views.
"""

import html
from colorsys import hsv_to_rgb
from importlib import import_module
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import escape_control
from zbuf_occlude.datasets.plan import DatasetConfig
from zbuf_occlude.datasets.records import Records, object_positions
from zbuf_occlude.datasets.source import CloudReader
from zbuf_occlude.drawing.marks import area_of_mark, marks_of, paint, picture_frame
from zbuf_occlude.drawing.pages import asset, coloured, json_for_page, pack_cloud
from zbuf_occlude.views import Views

if find_spec("PIL") is not None:
    import_module("PIL.ImageDraw")  # imported while workers start, so that nothing waits for it at the end

COLUMNS = 8
"""Clouds of the contact sheet."""
LOOKED_THROUGH, CONSIDERED = 256, 2048
"""Number of clouds of each split from which those of the sheet and of the gallery are chosen."""
FIXED = Views(np.radians([35.0]), np.radians([25.0]), np.array([4.0])).eyes[0]
"""The fixed viewpoint, about a cloud whose longest side is 1."""
TELLING_ANGLE = np.radians(115.0)
"""Preferred angles between camera and fixed viewpoint: the missing far side shows."""
PANEL, TITLE = 240, 26
"""Pixels of a cloud's picture, each side, and of the height of a line above it."""
MARGIN = 1.08
FINER = 3
"""Pixels are painted this many times finer, then averaged, so that marks are round."""
A_POINT = 110 / 72
"""Pixels of a typographic point."""
BLACK, GREY, GHOST = (0, 0, 0), (90, 90, 90), (222, 222, 222)
GHOST_POINTS = 1000
"""Maximum number of hidden points drawn."""
COMPLETE_POINTS = 2048
"""Number of points drawn of a complete cloud."""

RADIUS = 0.55
"""Distance of the farthest point from a cloud's centre, in the viewer's units. A tile shows a cloud whole however it is
turned."""
VIEWS, POINTS = 6, 2048
"""Clouds of each class in the gallery, and at most this many points of each."""
RAINBOW = [tuple(round(255 * c) for c in hsv_to_rgb(0.68 * (1 - i / 63), 0.85, 0.8)) for i in range(64)]
"""From low to high: blue, green, red."""
LEVELS = (6, 6, 6)
"""Number of levels of red, green and blue in the page; grey is among the colours."""
PAINTS = [
    tuple(np.round(255 * np.array(each) / (np.array(LEVELS) - 1)).astype(int).tolist()) for each in np.ndindex(LEVELS)
]
COLOURS = (
    (61, 111, 180), (213, 94, 0), (0, 140, 105), (176, 96, 150), (150, 120, 20), (70, 150, 200), (180, 60, 60),
    (110, 110, 120),
)  # fmt: skip


def write_contact_sheet(path: Path, source: CloudReader) -> bool:
    """Draw one cloud of each class (of up to eight classes) from the first clouds, of the first split if it has all.

    A column is a cloud: from the fixed viewpoint; where there are complete clouds the complete one, and the partial one
    over it, pale; from its camera. Return whether the sheet was drawn: without Pillow (extra `report`) there is none.
    """
    if find_spec("PIL") is None:
        return False
    from PIL import Image, ImageDraw  # late: Pillow is an extra

    clouds = _clouds_of_all_classes(source)
    labels = clouds["label"][:, 0]
    columns = [_panels(clouds[index], source) for index in _telling(labels, _towards(clouds, source))]
    picture = Image.new("RGB", (len(columns) * PANEL, len(columns[0]) * (TITLE + PANEL)), "white")
    draw = ImageDraw.Draw(picture)
    for column, panels in enumerate(columns):
        for row, (title, panel) in enumerate(panels):
            finer = Image.frombuffer("RGBX", panel.shape, panel, "raw", "RGBX", 0, 1)
            picture.paste(finer.reduce(FINER).convert("RGB"), (column * PANEL, _top(row)))
            text, font = _written(title, 12 if row else 15)
            place = ((column + 0.5) * PANEL, _top(row) - TITLE / 2)
            draw.text(place, text, GREY if row else BLACK, font, anchor="mm")
    atomic.write(path, lambda file: picture.save(file, format="PNG"))
    return True


def _panels(record: Any, source: CloudReader) -> list[tuple[str, NDArray[np.uint32]]]:
    """Return the titles and pictures of a cloud, from top to bottom."""
    whole = _complete_cloud(record, source)
    positions, camera, up, whole = upright(record, source.plan.config, whole)
    values = record["color"] / 255.0 if "color" in record.dtype.names else None
    name, (azimuth, elevation) = source.plan.classes[record["label"][0]], np.degrees(record["view"][:2])
    none, all_points = positions[:0], np.concatenate([positions, whole])
    panels = [(name, _drawn(positions, FIXED, None, values, none, all_points))]
    if len(whole):
        panels[0] = (f"{name}: partial", panels[0][1])
        panels.append(("complete", _drawn(whole, FIXED, None, None, none, all_points)))
        panels.append(("partial over complete", _drawn(positions, FIXED, None, values, whole, all_points)))
    title = f"from azimuth {azimuth:.0f}°, elevation {elevation:.0f}°"
    return [*panels, (title, _drawn(positions, camera, up, values, none, positions))]


def _clouds_of_all_classes(source: CloudReader) -> Records:
    """Return the first clouds of the first split, and of further splits until all classes are met."""
    clouds: list[Records] = []
    for split in source.order:
        clouds.extend(islice(source.batches(split, LOOKED_THROUGH), 1))
        if len(np.unique(np.concatenate([some["label"] for some in clouds]))) == len(source.plan.classes):
            break
    return np.concatenate(clouds)


def _top(row: int) -> int:
    """Return the top of the panels of a row, in pixels."""
    return TITLE + row * (TITLE + PANEL)


def _drawn(
    positions: FloatArray,
    eye: FloatArray,
    up: FloatArray | None,
    values: FloatArray | None,
    ghost: FloatArray,
    framed: FloatArray,
) -> NDArray[np.uint32]:
    """Return the picture of a cloud over a pale one, RGBA, `FINER` times as fine as it will be.

    The points `framed` fit into it.
    """
    panel = np.full((PANEL * FINER, PANEL * FINER), 0xFFFFFFFF, dtype=np.uint32)
    places, colours = marks_of(positions, eye=eye, target=np.zeros(3), up=up, values=values)
    behind, _ = marks_of(ghost, eye=eye, target=np.zeros(3), up=up)
    middle, half = picture_frame(marks_of(framed, eye=eye, target=np.zeros(3), up=up)[0], None)
    half *= MARGIN
    for some, tints in ((behind, np.broadcast_to(np.array(GHOST) / 255.0, (len(behind), 3))), (places, colours)):
        if len(some):
            diameter = np.sqrt(area_of_mark(some, half, PANEL / A_POINT)) * A_POINT * FINER
            paint(panel, ((some - middle) * (1.0, -1.0) / half + 1.0) / 2.0 * len(panel), float(diameter), tints)
    return panel


def _written(text: str, size: int) -> tuple[str, Any]:
    """Return a text and a font that has its characters, of a size at which it fits; else the text as Python escapes."""
    from PIL import ImageFont

    file: str | None = None
    font: Any
    if not text.replace("°", "").isascii() and find_spec("matplotlib") is not None:
        from zbuf_occlude.drawing.pictures import font_file_for  # late: matplotlib takes half a second

        file = font_file_for(text)
    if file is None:
        text, font = text.encode("latin-1", "backslashreplace").decode("latin-1"), ImageFont.load_default(size)
    else:
        font = ImageFont.truetype(file, size)
    fits = (PANEL - 10) / max(font.getlength(text), 1.0)
    return text, font if fits >= 1.0 else font.font_variant(size=max(6, int(size * fits)))


def _towards(records: Records, source: CloudReader) -> FloatArray:
    """Return the directions (n, 3) from the targets of cameras to their eyes: the third rows of their poses."""
    return np.asarray(records["pose"][:, 2, :3] * _sign(source.plan.config))


def _telling(labels: NDArray[Any], towards: FloatArray) -> list[int]:
    """Choose a cloud of each class whose camera stands far round from the fixed viewpoint, not too high or low.

    `towards` (n, 3) are the directions to the cameras.
    """
    angle = np.arccos(np.clip(towards @ (FIXED / np.linalg.norm(FIXED)), -1, 1))
    awkward = np.abs(angle - TELLING_ANGLE) + np.maximum(0, np.abs(np.arcsin(np.clip(towards[:, 2], -1, 1))) - 0.8)
    present = np.unique(labels)
    picked = present[np.linspace(0, len(present) - 1, min(COLUMNS, len(present))).astype(int)]
    return [int(np.flatnonzero(labels == label)[awkward[labels == label].argmin()]) for label in picked]


def _complete_cloud(record: Any, source: CloudReader) -> FloatArray:
    """Return points (m, 3) of the complete cloud of a cloud's object, in its axes; none where none is kept."""
    if source.complete is None or source.plan.config.complete:
        return np.empty((0, 3))
    return object_positions(source.complete(record, COMPLETE_POINTS), record["pose"], source.plan.config)


def hidden_part(record: Any, source: CloudReader) -> FloatArray:
    """Return points (m, 3) of a cloud's object that its camera does not see, in the object's axes.

    Where the dataset does not keep hidden points, they are those of the complete cloud, or none.
    """
    if source.block is None or source.plan.config.scan is not None:
        return _complete_cloud(record, source)[:GHOST_POINTS]
    block = source.block(int(record["mesh_id"]), int(record["variation"]))
    hidden = np.flatnonzero(~block.mask[int(record["view_id"])])
    return block.points.positions[np.random.default_rng(0).permutation(hidden)[:GHOST_POINTS]]


def upright(
    cloud: Any, config: DatasetConfig, others: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return a cloud, its camera's position and up, and `others`: in the object's axes, centred, longest side 1.

    Centre and longest side are those of all points together.
    """
    pose, positions = cloud["pose"], object_positions(cloud, cloud["pose"], config)
    together = np.concatenate([positions, others])
    low, high = together.min(axis=0), together.max(axis=0)
    centre, longest = (low + high) / 2, float((high - low).max()) or 1.0  # 1: all points are in one place
    eye, up = -pose[:3, :3].T @ pose[:3, 3], pose[1, :3] * _sign(config)
    return (positions - centre) / longest, (eye - centre) / longest, up, (others - centre) / longest


def _sign(config: DatasetConfig) -> float:
    """Return 1 where poses have OpenGL's y and z, -1 where they have OpenCV's."""
    return 1.0 if config.axes == "opengl" else -1.0


def write_gallery(path: Path, source: CloudReader, manifest: dict[str, Any], folder: Path) -> None:
    """Write the page of a dataset in a folder, which has this manifest."""
    classes = source.plan.classes
    considered = np.concatenate([next(source.batches(split, CONSIDERED)) for split in source.order])
    rows = []
    for label in np.unique(considered["label"]):
        of_class = considered[considered["label"][:, 0] == label]
        chosen = _far_apart(of_class, _towards(of_class, source))
        clouds = [_packed(record, source, COLOURS[int(label) % len(COLOURS)]) for record in chosen]
        rows.append({"name": classes[label], "clouds": clouds})
    counts, error = manifest["counts"], manifest["error"]
    facts = [
        f"{counts['clouds']:,} clouds of {counts['meshes']:,} meshes in {len(source.plan.meshes.classes)} classes",
        f"{counts['views']} views x {counts['variations']} variations",
        f"method {manifest['options']['method']}, renderer {manifest['renderer']}",
        f"seed {manifest['seed']}",
    ]
    if error["n_checked"]:
        facts.append(
            f"against the oracle on {error['n_checked']:,} pairs: {error['false_visible']:.3%} false visible, "
            f"{error['false_hidden']:.3%} false hidden"
        )
    page = Template(asset("gallery.html")).substitute(
        title=html.escape(escape_control(f"Occluded point clouds: {folder.absolute().name}")),
        style=asset("page.css"),
        facts=html.escape(escape_control("; ".join(facts)) + "."),
        viewer_script=asset("cloud_viewer.js"),
        data=json_for_page({"classes": rows}),
        page_script=asset("gallery.js"),
    )
    atomic.write(path, lambda file: file.write(page.encode()))


def _far_apart(records: Records, towards: FloatArray) -> Records:
    """Choose clouds of the object of a class with the most clouds, from directions far apart, highest first."""
    meshes, counts = np.unique(records["mesh_id"], return_counts=True)
    mine = records["mesh_id"] == meshes[counts.argmax()]
    own, towards = records[mine], towards[mine]
    chosen = [int(np.abs(towards[:, 2] - 0.5).argmin())]
    distance: FloatArray = np.full(len(own), np.inf)
    while len(chosen) < min(VIEWS, len(own)):
        distance = np.minimum(distance, np.linalg.norm(towards - towards[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    picked = own[chosen]
    return np.asarray(picked[np.argsort(-picked["view"][:, 1], kind="stable")])


def _packed(record: Any, source: CloudReader, colour: tuple[int, int, int]) -> dict[str, Any]:
    config = source.plan.config
    positions, eye, _, ghost = upright(record, config, hidden_part(record, source))
    positions, normals = positions[:POINTS], None
    farthest = float(np.linalg.norm(np.concatenate([positions, ghost]), axis=1).max()) or 1.0
    line = np.linspace(0.72, 1.0, 24)[:, None] * farthest * (eye / max(float(np.linalg.norm(eye)), 1e-9))
    if "normals" in config.attributes and "normal" in record.dtype.names:
        normals = record["normal"][:POINTS] @ (record["pose"][:3, :3] if config.frame == "camera" else np.eye(3))
        normals = np.concatenate([normals, np.zeros((len(ghost) + len(line), 3))])
    codes = np.repeat([0, 1, 2], [len(positions), len(ghost), len(line)])
    azimuth, elevation = np.degrees(record["view"][:2])
    return {
        **pack_cloud(
            np.concatenate([positions, ghost, line]),
            centre=np.zeros(3),
            longest=farthest / RADIUS,
            palette=[colour, GHOST, BLACK],
            codes=codes,
            normals=normals,
        ),
        "n_own": len(positions),
        "mesh": source.plan.meshes[int(record["mesh_id"])].key,
        "variation": int(record["variation"]),
        "azimuth": round(float(azimuth) % 360, 2),
        "elevation": round(float(elevation), 2),
        "seen": _seen(int(record["n_visible"]), float(record["visible_fraction"]), source),
        "colourings": _colourings(record),
    }


def _seen(n_visible: int, visible_fraction: float, source: CloudReader) -> str:
    """Return a text on what a camera sees, or what a sensor measures, of its object."""
    if source.plan.config.scan is None:
        return f"it sees {n_visible:,} points, {visible_fraction:.1%} of the object's"
    return f"it measures {n_visible:,} points; others hide {1.0 - visible_fraction:.1%} of the object"


def _colourings(record: Any) -> dict[str, Any]:
    """Return the codes of points and the legend of the codes, for each way to colour points."""
    found, names = {}, record.dtype.names
    if "color" in names:
        levels = np.round(record["color"][:POINTS] / 255.0 * (np.array(LEVELS) - 1)).astype(int)
        found["own colour"] = coloured(np.ravel_multi_index(levels.T, LEVELS), PAINTS)
    if "range" not in names:
        return found
    for name in ("range", "incidence", "ring"):
        values = record[name][:POINTS].astype(float)
        low, high = values.min(), values.max()
        codes = np.round((values - low) / max(high - low, 1e-9) * (len(RAINBOW) - 1))
        found[name] = coloured(codes, RAINBOW)
    found["instance"] = coloured(record["instance"][:POINTS] % len(COLOURS), list(COLOURS))
    return found
