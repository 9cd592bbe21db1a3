"""Why accuracy falls at elevation 0, or does not: what collections of shapes show from there. Markdown.

    python benchmarks/dead_angle.py [FOLDER ...] [--objects 40] [--voxels 30]

For the built-in shapes and the meshes of folders, and for each the same as surfaces of voxels: how much of the surface
is level or upright (within 10 degrees), and the areas of Fig. 12 that the visible part projects, in percent of an
object's own largest over all elevations, means over the objects (`visible_areas` of
`zbuf_occlude.studies.paper.elevation`).
"""

from collections.abc import Sequence

import numpy as np
from common import heads, row, run

from zbuf_occlude.datasets.presets import two_hundred
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.studies.paper.elevation import visible_areas
from zbuf_occlude.studies.paper.experiments import as_voxels

NEAR = np.sin(np.radians(10.0))


def main(*folders: str, objects: int = 40, voxels: int = 30) -> None:
    collections = {"built-in shapes": two_hundred(shapes.collection())}
    for folder in folders:
        collections[folder.rstrip("/").rpartition("/")[2]] = MeshCollection.from_paths(folder)
    heads("shapes", "objects", "level", "upright", "onto x-y at 0", "at ±10", "onto y-z at 0", "onto x-z at 0")
    for name, meshes in collections.items():
        chosen = meshes[:: max(1, len(meshes) // objects)][:objects]
        measure(name, chosen)
        measure(f"the same, {voxels}³ voxels", as_voxels(MeshCollection(chosen), voxels))


def measure(name: str, meshes: Sequence[MeshEntry]) -> None:
    """Print a row of the table."""
    level, upright = np.mean([leaning(entry) for entry in meshes], axis=0)
    elevations, shares = visible_areas(meshes)
    mean = dict(zip(elevations.tolist(), shares.mean(axis=0), strict=True))
    cells = [level, upright, mean[0][2], (mean[-10][2] + mean[10][2]) / 2, mean[0][0], mean[0][1]]
    row(name, len(meshes), *(f"{100 * cell:.0f} %" for cell in cells))


def leaning(entry: MeshEntry) -> tuple[float, float]:
    """Return which share of a mesh's area is level, and which upright."""
    mesh = entry.load()
    steep = np.abs(mesh.face_normals[:, 2]) / np.linalg.norm(mesh.face_normals, axis=1)
    level, upright = steep > np.sqrt(1 - NEAR**2), steep < NEAR
    return float(np.average(level, weights=mesh.areas)), float(np.average(upright, weights=mesh.areas))


if __name__ == "__main__":
    run(main, __doc__)
