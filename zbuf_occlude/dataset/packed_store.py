"""What a shard of a packed dataset collects, and its archive; `dataset/packed.py` says what is in it."""

import json
import zipfile
import zlib
from pathlib import Path
from typing import IO, ClassVar

import numpy as np

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.clouds import ScanPoints
from zbuf_occlude.dataset.packed_scans import pack_scans
from zbuf_occlude.dataset.packing import (
    Grid,
    pack_colors,
    pack_faces,
    pack_mask,
    pack_normals,
    pack_steps,
)
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.records import Run
from zbuf_occlude.dataset.scans import standing_points
from zbuf_occlude.geometry.colors import GREY
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints
from zbuf_occlude.sensors.capture import stand
from zbuf_occlude.views import Views


def shard_name(shard: int) -> str:
    """Return what a shard's archive is called in the dataset's folder."""
    return f"packed-{shard:06d}.zip"


class PackedStore:
    """Collects the points and bits of a shard."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._members: list[tuple[str, bytes]] = []

    suffix: ClassVar[str] = ".zip"

    def keep(
        self, points: SurfacePoints, mask: BoolArray, views: Views, key: str, variation: int
    ) -> tuple[SurfacePoints, bytes, list[int]]:
        """Keep one sampling of a mesh, or its scans: the points, bits or scans as bytes, the views that see nothing."""
        seen = pack_scans(points, mask, views) if isinstance(points, ScanPoints) else pack_mask(mask)
        return points, seen, np.flatnonzero(~mask.any(axis=1)).tolist()

    def add(self, mesh_id: int, mesh: Mesh, kept: list[tuple[SurfacePoints, bytes, list[int]]]) -> None:
        """Take in what was kept of all samplings of a mesh."""
        entry, recipe = self._plan.meshes[mesh_id], self._plan.recipe
        kind, samples = "visible", [points for points, _, _ in kept]
        if recipe.setup is not None:
            kind = "scans"
            samples = [standing_points(mesh, entry.label, recipe, entry.key, i) for i in range(len(kept))]
            mesh, _ = stand(mesh, entry.label, recipe.setup)
        grid = Grid.of_box(mesh.bounds)
        facts = {
            "key": entry.key,
            "label": entry.label,
            "split": entry.split,
            "n_points": list(map(len, samples)),
            "low": grid.low.tolist(),
            "step": grid.step,
            "centre": mesh.centre.tolist(),
            "longest_side": mesh.longest_side,
            "blind": [blind for _, _, blind in kept],
        }
        self._members.append((f"{mesh_id:06d}/mesh.json", json.dumps(facts).encode()))
        for variation, (points, (_, seen, _)) in enumerate(zip(samples, kept, strict=True)):
            name = f"{mesh_id:06d}/{variation}"
            self._members.append((f"{name}.steps", pack_steps(grid.rounded(points.positions))))
            self._members.append((f"{name}.faces", pack_faces(points.face_ids)))
            self._members.append((f"{name}.{kind}", seen))
            if "normals" in recipe.attributes:
                self._members.append((f"{name}.normals", pack_normals(points.normals)))
            if "colors" in recipe.attributes:
                colors = np.full((len(points), 3), GREY, np.uint8) if points.colors is None else points.colors
                self._members.append((f"{name}.colors", pack_colors(colors)))

    def write(self, path: Path, shard: int) -> list[Run]:
        """Write the archive, which is one run; times in it are fixed, so the same clouds give the same bytes."""

        def fill(file: IO[bytes]) -> None:
            with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
                for name, content in self._members:
                    member = zipfile.ZipInfo(name)
                    member.compress_type = zipfile.ZIP_DEFLATED
                    archive.writestr(member, content)

        atomic.write(path, fill)
        return [(path.stat().st_size, zlib.crc32(path.read_bytes()))]
