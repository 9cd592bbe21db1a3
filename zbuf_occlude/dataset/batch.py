"""A batch: a few meshes made into clouds at a time, kept in one file of the work folder until they are in final files.

The file begins with a line of JSON, what is known of the batch (`Batch`); then come its clouds, those of each final
file together. It appears under its name when it is whole, so a batch is done when its file is there.
"""

import io
import json
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic, ragged
from zbuf_occlude.dataset.atomic import reading
from zbuf_occlude.dataset.clouds import gather_clouds, record_type
from zbuf_occlude.dataset.counts import Counts
from zbuf_occlude.dataset.folder import WORK, sha256_of
from zbuf_occlude.dataset.formats import PACKED
from zbuf_occlude.dataset.formats.packed import Archive, archive_name
from zbuf_occlude.dataset.pipeline import Sampling, count_mesh, sampled_views
from zbuf_occlude.dataset.placement import CLOUDS_PER_FILE
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.scans import scan
from zbuf_occlude.errors import ArgumentError, DatasetError, MeshError
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.limits import GivenUp, Limits
from zbuf_occlude.provenance import Origin

REMEDY = "Run the same `zbuf-occlude generate` again."
Records = NDArray[Any]


class Piece(NamedTuple):
    """Where the clouds of one final file lie in a batch's file, behind its first line."""

    begin: int
    n_bytes: int
    crc32: int


class Named(NamedTuple):
    """A final file, and how to recognise it."""

    name: str
    n_bytes: int
    sha256: str


@dataclass(frozen=True)
class Batch:
    """What is known of a batch that is done.

    Parameters
    ----------
    fingerprint : str
        Of its plan.
    counts : Counts
    failures : mapping of mesh key to reason
    given_up : mapping of mesh key to Limits
        Of the failures that exceeded limits, or ended their workers: the limits then.
    origins : mapping of mesh key to Origin
        What every mesh was made of.
    renderer : str
    seconds : float
        That making it took.
    n_clouds : mapping of split to int
    pieces : mapping of file number to Piece
        Where its clouds lie; none in the format packed.
    archive : Named or None
        The final file of a batch in the format packed.
    """

    fingerprint: str
    counts: Counts
    failures: Mapping[str, str]
    given_up: Mapping[str, Limits]
    origins: Mapping[str, Origin]
    renderer: str
    seconds: float
    n_clouds: Mapping[str, int]
    pieces: Mapping[int, Piece]
    archive: Named | None

    @property
    def document(self) -> dict[str, Any]:
        """Plain data, for JSON."""
        return {
            **self.__dict__,
            "counts": self.counts.document,
            "given_up": {key: limits.document for key, limits in self.given_up.items()},
            "origins": {key: origin.document for key, origin in self.origins.items()},
        }

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> "Batch":
        """Read back what `document` gave."""
        read: dict[str, Any] = {
            "counts": Counts.from_document(document["counts"]),
            "given_up": {key: Limits(*limits) for key, limits in document["given_up"].items()},
            "origins": {key: Origin.from_document(each) for key, each in document["origins"].items()},
            "pieces": {int(file): Piece(*piece) for file, piece in document["pieces"].items()},
            "archive": document["archive"] and Named(*document["archive"]),
        }
        return cls(**{**document, **read})


class Clouds:
    """Collects the clouds of a batch: their records, drawn already."""

    def __init__(self, plan: Plan) -> None:
        self._plan, self._records = plan, list[Records]()

    def keep(self, sampling: Sampling, key: str, variation: int) -> Records:
        """Draw the clouds of one sampling of a mesh."""
        return gather_clouds(sampling.points, sampling.mask, sampling.views, self._plan.recipe, key, variation)

    def add(self, mesh_id: int, mesh: Mesh, kept: list[Records]) -> None:
        """Take all clouds of a mesh."""
        label = self._plan.classes.index(self._plan.meshes[mesh_id].label)
        for records in kept:
            records["mesh_id"], records["label"] = mesh_id, label
            self._records += [records[row : row + 1] for row in range(len(records))]

    def pieces(self) -> dict[int, list[memoryview]]:
        """Return the bytes of the clouds of each file; nothing is copied unless they are ragged."""
        files, _ = _places(self._plan, self._records)
        found: dict[int, list[memoryview]] = {}
        for file in np.unique(files).tolist():
            some = [self._records[i] for i in np.flatnonzero(files == file).tolist()]
            if self._plan.recipe.sample_size is not None:
                found[file] = [record.view(np.uint8).data for record in some]
            else:
                buffer = io.BytesIO()
                ragged.save(buffer, np.concatenate(some), self._plan.recipe)
                found[file] = [buffer.getbuffer()]
        return found


def _places(plan: Plan, records: list[Records]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the file and the row of each cloud of some arrays of records."""
    ids = [
        np.concatenate([np.empty(0, np.int32), *(each[name] for each in records)])
        for name in ("mesh_id", "variation", "view_id")
    ]
    return plan.placement.of(ids[0], ids[1], ids[2])


def samplings(plan: Plan, mesh: Mesh, mesh_id: int, gl: Any) -> Iterable[Sampling]:
    """Yield the samplings, or the scans, of a mesh."""
    entry = plan.meshes[mesh_id]
    if plan.recipe.setup is not None:
        return scan(mesh, entry.label, plan, entry.key)
    return sampled_views(mesh, plan.recipe, plan.views_of(entry.key), entry.key, gl, plan.n_checked)


def make_mesh(plan: Plan, mesh_id: int, gl: Any, store: Clouds | Archive) -> tuple[Counts, str, Origin]:
    """Make all clouds of a mesh, and put them into a store; return what was counted, the renderer, and its origin.

    Raises
    ------
    MeshError, ArgumentError
        The mesh cannot be used; the store is left as it was.
    """
    entry = plan.meshes[mesh_id]
    mesh = entry.load()
    counts, renderer, kept = count_mesh(mesh, plan.recipe), "none", list[Any]()
    for variation, sampling in enumerate(samplings(plan, mesh, mesh_id, gl)):
        counts, renderer = counts + sampling.counts, sampling.renderer
        kept.append(store.keep(sampling, entry.key, variation))
    store.add(mesh_id, mesh, kept)
    return counts, renderer, mesh.origin


def new_store(plan: Plan) -> Clouds | Archive:
    """Return what collects the clouds of a batch."""
    return Archive(plan) if plan.format == PACKED else Clouds(plan)


def make_batch(
    plan: Plan,
    number: int,
    out: Path,
    gl: Any,
    *,
    lost: Mapping[int, GivenUp] = MappingProxyType({}),
    on_mesh: Callable[[int | None], None] = lambda mesh_id: None,
) -> None:
    """Make one batch, and write its file.

    Parameters
    ----------
    plan : Plan
    number : int
        Index into ``plan.batches``.
    out : Path
        The dataset's folder.
    gl : GlContext or None
    lost : mapping of mesh index to GivenUp
        Meshes that are not tried again: each is a failure, with its reason.
    on_mesh : callable
        Called with the index of each mesh before it is begun, and with None before the batch is written.

    Notes
    -----
    A mesh that cannot be used is recorded under ``failures`` with its reason; the batch goes on.
    """
    began = time.perf_counter()
    store, counts, renderer, n_clouds = new_store(plan), Counts(), "none", Counter[str]()
    failures, origins = dict[str, str](), dict[str, Origin]()
    for mesh_id in plan.batches[number]:
        entry = plan.meshes[mesh_id]
        on_mesh(mesh_id)
        try:
            if mesh_id in lost:
                raise MeshError(lost[mesh_id].reason)
            of_mesh, renderer_of_mesh, origins[entry.key] = make_mesh(plan, mesh_id, gl, store)
        except (MeshError, ArgumentError) as error:  # options were tried before: it is the mesh's numbers
            failures[entry.key], origins[entry.key] = str(error), entry.origin_of_failure()
            continue
        counts, renderer = counts + of_mesh, renderer_of_mesh
        n_clouds[entry.split] += of_mesh.n_clouds
    on_mesh(None)
    archive, pieces = None, dict[int, list[memoryview]]()
    if isinstance(store, Archive):
        path = out / archive_name(number)
        store.write(path)
        archive = Named(path.name, path.stat().st_size, sha256_of(path))
    else:
        pieces = store.pieces()
    batch = Batch(
        fingerprint=plan.fingerprint,
        counts=counts,
        failures=failures,
        given_up={plan.meshes[i].key: lost[i].limits for i in plan.batches[number] if i in lost},
        origins=origins,
        renderer=renderer,
        seconds=time.perf_counter() - began,
        n_clouds=n_clouds,
        pieces=_laid_out(pieces),
        archive=archive,
    )
    line = json.dumps(batch.document).encode()
    header = b"%d %b\n" % (zlib.crc32(line), line)
    (out / WORK).mkdir(exist_ok=True)
    lines: list[bytes | memoryview] = [header, *(piece for of_file in pieces.values() for piece in of_file)]
    atomic.write(batch_path(out, number), lambda file: file.writelines(lines), synced=False)  # it has checksums


def _laid_out(pieces: Mapping[int, list[memoryview]]) -> dict[int, Piece]:
    found, begin = dict[int, Piece](), 0
    for file, of_file in pieces.items():
        n_bytes = sum(map(len, of_file))
        found[file] = Piece(begin, n_bytes, reduce(lambda before, piece: zlib.crc32(piece, before), of_file, 0))
        begin += n_bytes
    return found


def batch_path(out: Path, number: int) -> Path:
    """Return where a batch's file is while it is needed."""
    return out / WORK / f"{number:06d}.batch"


def read_batch(plan: Plan, out: Path, number: int, *, closely: bool = False) -> tuple[Batch | None, str]:
    """Return a batch that is done; of any other None and, where there is a damaged file of it, what is wrong.

    Parameters
    ----------
    plan : Plan
    out : Path
    number : int
    closely : bool
        Compare the checksums of its clouds too.

    Raises
    ------
    DatasetError
        It belongs to another plan.
    """
    path = batch_path(out, number)
    try:
        with open(path, "rb") as file:
            checksum, _, line = file.readline().partition(b" ")
            if zlib.crc32(line[:-1]) != int(checksum):
                return None, f"{path.name} is damaged"
            batch, begin = Batch.from_document(json.loads(line)), file.tell()
            n_bytes = sum(piece.n_bytes for piece in batch.pieces.values())
            if path.stat().st_size != begin + n_bytes:
                return None, f"{path.name} is damaged"
            for piece in batch.pieces.values() if closely else ():
                if zlib.crc32(file.read(piece.n_bytes)) != piece.crc32:
                    return None, f"{path.name} is damaged"
    except FileNotFoundError:
        return None, ""
    except (ValueError, LookupError, TypeError, AttributeError):
        return None, f"{path.name} is damaged"
    if batch.fingerprint != plan.fingerprint:
        raise DatasetError(f"{path} must belong to plan {plan.fingerprint}; it is of plan {batch.fingerprint}.")
    if batch.archive is not None and not is_there(out, batch.archive, closely=closely):
        return None, f"{batch.archive.name} is damaged or missing"
    return batch, ""


def is_there(out: Path, file: Named, *, closely: bool = False) -> bool:
    """Whether a file is there, with the size, and closely the checksum, that it had."""
    path = out / file.name
    return path.is_file() and path.stat().st_size == file.n_bytes and (not closely or sha256_of(path) == file.sha256)


def clouds_of_file(plan: Plan, out: Path, number: int) -> Records:
    """Return the clouds of a final file, in its order, from the batches of its group.

    Raises
    ------
    DatasetError
        A batch is missing or damaged.
    """
    records = np.empty(CLOUDS_PER_FILE, record_type(plan.recipe))
    is_filled = np.zeros(len(records), bool)
    for batch in plan.batches.of_groups[plan.files[number].group]:
        piece = _read_piece(plan, batch_path(out, batch), number)
        _, rows = _places(plan, [piece])
        records[rows], is_filled[rows] = piece, True
    return records if is_filled.all() else records[is_filled]


def _read_piece(plan: Plan, path: Path, number: int) -> Records:
    with reading(path, REMEDY), open(path, "rb") as file:
        piece = json.loads(file.readline().partition(b" ")[2])["pieces"].get(str(number))
        if piece is None:
            return np.empty(0, record_type(plan.recipe))
        begin, n_bytes, crc32 = piece
        file.seek(begin, io.SEEK_CUR)
        content = file.read(n_bytes)
        if zlib.crc32(content) != crc32:
            raise ValueError("its checksum differs")
        if plan.recipe.sample_size is None:
            return ragged.load(io.BytesIO(content), plan.recipe)
        return np.frombuffer(content, record_type(plan.recipe))
