"""Shards of records: the clouds of a few meshes, drawn already, in a run for each of the parts made of them."""

import io
import zlib
from collections.abc import Iterable
from functools import reduce
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.dataset import atomic, ragged
from zbuf_occlude.dataset import plan as plans
from zbuf_occlude.dataset.clouds import gather_clouds, record_type
from zbuf_occlude.dataset.damage import reading
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.order import order_of
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.source import IDS, Numbers
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints
from zbuf_occlude.views import Views

REMEDY = "The same `zbuf-occlude generate` makes it again."

Run = tuple[int, int]
"""Of the records that go into one part: their bytes, and their CRC-32."""


class RecordStore:
    """Collects the clouds of a shard."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._kept = [np.empty(0, record_type(plan.recipe))]

    suffix: ClassVar[str] = ".records"

    def keep(self, points: SurfacePoints, mask: BoolArray, views: Views, key: str, variation: int) -> NDArray[Any]:
        """Draw the clouds of one sampling of a mesh."""
        return gather_clouds(points, mask, views, self._plan.recipe, key, variation)

    def add(self, mesh_id: int, mesh: Mesh, kept: list[NDArray[Any]]) -> None:
        """Take in what was kept of all samplings of a mesh."""
        label = self._plan.classes.index(self._plan.meshes[mesh_id].label)
        for records in kept:
            records["mesh_id"], records["label"] = mesh_id, label
            self._kept.append(records)

    def write(self, path: Path, shard: int) -> list[Run]:
        """Write the records, for each file of the shard's group a run of them; return the runs.

        Of formats that want whole objects, all are one run: by mesh, variation, view.
        """
        clouds = [records[row : row + 1] for records in self._kept for row in range(len(records))]
        if find_format(self._plan.format).whole_objects:
            return self._write_runs(path, [clouds])
        parts, places = _places(self._plan, _ids_of(self._kept))
        rows = np.lexsort((places, parts))
        ends = np.searchsorted(parts[rows], np.array(self._plan.parts_of(self._plan.group_of(shard))), side="right")
        return self._write_runs(path, [[clouds[row] for row in some] for some in np.split(rows, ends)[: len(ends)]])

    def _write_runs(self, path: Path, clouds: list[list[NDArray[Any]]]) -> list[Run]:
        runs = [_packed(some, self._plan) for some in clouds]
        pieces = chain.from_iterable(runs)
        atomic.write(path, lambda file: file.writelines(pieces), synced=False)  # their checksums are in the sidecar
        return [(sum(map(len, run)), reduce(lambda before, piece: zlib.crc32(piece, before), run, 0)) for run in runs]


def read_run(path: Path, plan: Plan, begin: int, run: Run) -> NDArray[Any]:
    """Read the records of a run that begins at this byte.

    Raises
    ------
    DatasetError
        They cannot be read, or are not what was written.
    """
    with reading(path, REMEDY), open(path, "rb") as file:
        file.seek(begin)
        content = file.read(run[0])
        if len(content) != run[0] or zlib.crc32(content) != run[1]:
            raise ValueError("its checksum is another")
        if plan.recipe.sample_size is None:
            return ragged.load(io.BytesIO(content), plan.recipe)
        return np.frombuffer(content, record_type(plan.recipe))


def _packed(clouds: list[NDArray[Any]], plan: Plan) -> list[memoryview]:
    """Return the bytes of some clouds, a record each, in pieces: of records where they are, nothing is copied."""
    if plan.recipe.sample_size is not None:
        return [record.view(np.uint8).data for record in clouds]
    file = io.BytesIO()
    if clouds:
        ragged.save(file, np.concatenate(clouds), plan.recipe)
    return [file.getbuffer()]


def are_whole(path: Path, runs: list[Run]) -> bool:
    """Whether the first runs of a file are what was written."""
    with open(path, "rb") as file:
        return all(zlib.crc32(file.read(n_bytes)) == checksum for n_bytes, checksum in runs)


def in_places(plan: Plan, pieces: Iterable[NDArray[Any]]) -> NDArray[Any]:
    """Return the records of one part in its order, given piece by piece, so that they are in memory once."""
    records = np.empty(plans.CLOUDS_PER_FILE, record_type(plan.recipe))
    is_there = np.zeros(len(records), bool)
    for piece in pieces:
        _, places = _places(plan, piece)
        records[places], is_there[places] = piece, True
    return records if is_there.all() else records[is_there]


def _ids_of(kept: list[NDArray[Any]]) -> NDArray[Any]:
    """Return what tells the clouds of some arrays of records apart, one after the other."""
    ids = np.empty(sum(map(len, kept)), IDS)
    for name in IDS.names or ():
        ids[name] = np.concatenate([records[name] for records in kept])
    return ids


def _places(plan: Plan, records: NDArray[Any]) -> tuple[Numbers, Numbers]:
    return order_of(plan).places(records["mesh_id"], records["variation"], records["view_id"])
