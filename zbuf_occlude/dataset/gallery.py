"""The gallery of a dataset: one self-contained HTML page, classes x views, every cloud to be turned by hand."""

import html
from colorsys import hsv_to_rgb
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import FloatArray
from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.sheet import upright
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.drawing.pages import asset, coloured, json_for_page, pack_cloud, viewer_script
from zbuf_occlude.errors import printable

RAINBOW = [tuple(round(255 * c) for c in hsv_to_rgb(0.68 * (1 - i / 63), 0.85, 0.8)) for i in range(64)]
"""From low to high: blue, green, red."""
LEVELS = (6, 6, 6)
"""Of red, green and blue in the page; grey is among them."""
PAINTS = [
    tuple(np.round(255 * np.array(each) / (np.array(LEVELS) - 1)).astype(int).tolist()) for each in np.ndindex(LEVELS)
]
VIEWS = 6
"""Columns: clouds of each class."""
POINTS = 2048
"""At most this many points of each cloud."""
CONSIDERED = 2048
"""Clouds of each split among which those shown are chosen."""
COLOURS = (
    (61, 111, 180), (213, 94, 0), (0, 140, 105), (176, 96, 150), (150, 120, 20), (70, 150, 200), (180, 60, 60),
    (110, 110, 120),
)  # fmt: skip


def write_gallery(path: Path, source: Source, manifest: dict[str, Any], folder: Path) -> None:
    """Write the page.

    Parameters
    ----------
    path : Path
        The HTML file.
    source : Source
        The dataset's clouds.
    manifest : dict
    folder : Path
        Of the dataset, for its name.
    """
    classes = source.plan.classes
    considered = np.concatenate([next(source.batches(split, CONSIDERED)) for split in source.order])
    rows = []
    for label in np.unique(considered["label"]):
        chosen = choose(considered[considered["label"][:, 0] == label])
        clouds = [_packed(record, source, COLOURS[int(label) % len(COLOURS)]) for record in chosen]
        rows.append({"name": classes[label], "clouds": clouds})
    counts, error = manifest["counts"], manifest["error"]
    n_meshes = counts["meshes"] - counts["meshes_failed"]
    facts = [
        f"{counts['clouds']:,} clouds of {n_meshes:,} meshes in {len(source.plan.meshes.classes)} classes",
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
        title=html.escape(printable(f"Occluded point clouds: {folder.absolute().name}")),
        style=asset("page.css"),
        facts=html.escape(printable("; ".join(facts)) + "."),
        viewer_script=viewer_script(),
        data=json_for_page({"classes": rows}),
        page_script=asset("gallery.js"),
    )
    atomic.write(path, lambda file: file.write(page.encode()))


def choose(records: NDArray[Any]) -> NDArray[Any]:
    """Choose clouds of the object of a class that has the most here, from directions far apart, highest first."""
    meshes, counts = np.unique(records["mesh_id"], return_counts=True)
    own = records[records["mesh_id"] == meshes[counts.argmax()]]
    towards = own["pose"][:, 2, :3]  # the third row of a view matrix points from the target to the eye
    chosen = [int(np.abs(towards[:, 2] - 0.5).argmin())]
    distance: FloatArray = np.full(len(own), np.inf)
    while len(chosen) < min(VIEWS, len(own)):
        distance = np.minimum(distance, np.linalg.norm(towards - towards[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    picked = own[chosen]
    return np.asarray(picked[np.argsort(-picked["view"][:, 1], kind="stable")])


def _packed(record: Any, source: Source, colour: tuple[int, int, int]) -> dict[str, Any]:
    in_camera_frame = source.plan.recipe.frame == "camera"
    positions, _, _ = upright(record, in_camera_frame)
    normals = None
    if "normals" in source.plan.recipe.attributes:
        normals = record["normal"][:POINTS] @ (record["pose"][:3, :3] if in_camera_frame else np.eye(3))
    azimuth, elevation = np.degrees(record["view"][:2])
    return {
        **pack_cloud(positions[:POINTS], centre=np.zeros(3), longest=1.0, palette=[colour], normals=normals),
        "mesh": source.plan.meshes[int(record["mesh_id"])].key,
        "variation": int(record["variation"]),
        "azimuth": round(float(azimuth) % 360, 2),
        "elevation": round(float(elevation), 2),
        "n_visible": int(record["n_visible"]),
        "visible_fraction": float(record["visible_fraction"]),
        "colourings": _colourings(record),
    }


def _colourings(record: Any) -> dict[str, Any]:
    """Return for each thing that points may be coloured by their codes and what these look like."""
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
