"""Batches: a few meshes made into clouds at a time; and what is known of batches and groups that are done.

A batch's clouds are kept in a file of the work folder until they are in final files. It begins with a line of JSON, its
`BatchReport`; then come the clouds, those of each final file together. A batch is done when its file, which appears
whole, is there. A group is done when ``groups/NUMBER.json``, the report of all its batches and its files, is there.
"""

import hashlib
import io
import json
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import reduce
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.atomic import reading
from zbuf_occlude.dataset.counts import Blank, QualityCounts
from zbuf_occlude.dataset.folder import GROUPS, WORK, is_as_written, sha256_of
from zbuf_occlude.dataset.formats import PACKED
from zbuf_occlude.dataset.packed import Archive, archive_name
from zbuf_occlude.dataset.pipeline import Sampling, count_mesh, samplings
from zbuf_occlude.dataset.plan import Numbers, Plan
from zbuf_occlude.dataset.records import Records, gather_clouds, read_archive, record_type, to_arrays
from zbuf_occlude.errors import ArgumentError, DatasetError, MeshError
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.limits import GivenUp, Limits
from zbuf_occlude.meshes.collection import MeshEntry
from zbuf_occlude.provenance import MeshSource

REMEDY = "Run the same `zbuf-occlude generate` again."


class ByteRange(NamedTuple):
    """Where the clouds of one final file lie in a batch's file, behind its first line."""

    begin: int
    n_bytes: int
    crc32: int


class FileDigest(NamedTuple):
    """A final file, and how to recognise it."""

    name: str
    n_bytes: int
    sha256: str

    @classmethod
    def of(cls, path: Path) -> "FileDigest":
        """Describe a file that was written."""
        return cls(path.name, path.stat().st_size, sha256_of(path))


@dataclass(frozen=True)
class BatchReport:
    """What came of a batch, or of all batches of a group; of meshes by their keys."""

    fingerprint: str  # of the plan
    counts: QualityCounts = field(default_factory=QualityCounts)
    failures: Mapping[str, str] = field(default_factory=dict)  # reasons
    given_up: Mapping[str, Limits] = field(default_factory=dict)  # of failures by limits, or that ended workers
    blank: Mapping[str, Blank] = field(default_factory=dict)  # what is known of views without a cloud
    origins: Mapping[str, MeshSource] = field(default_factory=dict)  # what every mesh was made of
    renderers: list[str] = field(default_factory=list)
    seconds: float = 0.0  # that making it took
    n_clouds: Mapping[str, int] = field(default_factory=dict)  # by split
    files: Mapping[str, list[FileDigest]] = field(
        default_factory=dict
    )  # final ones by split; an archive may be in several
    pieces: Mapping[int, ByteRange] = field(default_factory=dict)  # by file number; none in the format packed

    @classmethod
    def of_all(
        cls, fingerprint: str, parts: list["BatchReport"], files: Mapping[str, list[FileDigest]]
    ) -> "BatchReport":
        """Sum up batches or groups; `files` are those besides their own."""
        all_files = {split: list(of_split) for split, of_split in files.items()}
        for part in parts:
            for split, of_split in part.files.items():
                all_files.setdefault(split, []).extend(of_split)
        return cls(
            fingerprint,
            counts=sum((part.counts for part in parts), QualityCounts()),
            failures={key: reason for part in parts for key, reason in part.failures.items()},
            given_up={key: limits for part in parts for key, limits in part.given_up.items()},
            blank={key: blank for part in parts for key, blank in part.blank.items()},
            origins={key: origin for part in parts for key, origin in part.origins.items()},
            renderers=sorted({renderer for part in parts for renderer in part.renderers}),
            seconds=sum(part.seconds for part in parts),
            n_clouds=dict(sum((Counter(part.n_clouds) for part in parts), Counter())),
            files=all_files,
        )

    @property
    def made(self) -> dict[str, MeshSource]:
        """What the meshes that did not fail were made of, by key."""
        return {key: origin for key, origin in self.origins.items() if key not in self.failures}

    def write(self, path: Path, clouds: Iterable[bytes | memoryview] = (), *, synced: bool) -> None:
        """Write it, as a line of JSON with a checksum, and clouds behind it."""
        names = {file.name for of_split in self.files.values() for file in of_split}
        document = {
            **self.__dict__,
            "counts": self.counts.to_dict(),
            "given_up": {key: limits.to_dict() for key, limits in self.given_up.items()},
            "origins": {key: origin.to_dict() for key, origin in self.origins.items()},
            "pieces": {str(file): piece for file, piece in self.pieces.items()},
            "names": sorted(names),
        }
        line = json.dumps({**document, "checksum": _checksum(document)}).encode() + b"\n"
        path.parent.mkdir(exist_ok=True)
        atomic.write(path, lambda file: file.writelines([line, *clouds]), synced=synced)

    @classmethod
    def from_json(cls, line: bytes) -> "BatchReport":
        """Read back what `write` wrote; what is raised of damaged bytes is among `atomic.DAMAGES`."""
        document = json.loads(line)
        if document.pop("checksum") != _checksum(document):
            raise ValueError("its checksum differs")
        del document["names"]
        read: dict[str, Any] = {
            "counts": QualityCounts.from_dict(document["counts"]),
            "given_up": {key: Limits(*limits) for key, limits in document["given_up"].items()},
            "blank": {key: Blank(*each) for key, each in document["blank"].items()},
            "origins": {key: MeshSource.from_dict(each) for key, each in document["origins"].items()},
            "files": {split: [FileDigest(*file) for file in of_split] for split, of_split in document["files"].items()},
            "pieces": {int(file): ByteRange(*piece) for file, piece in document["pieces"].items()},
        }
        return cls(**{**document, **read})


def _checksum(document: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()


class CloudBuffer:
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
                np.savez(buffer, **to_arrays(np.concatenate(some), self._plan.recipe))  # type: ignore[arg-type]
                found[file] = [buffer.getbuffer()]
        return found


def _places(plan: Plan, records: list[Records]) -> tuple[Numbers, Numbers]:
    """Return the file and the row of each cloud of some arrays of records."""
    mesh_ids, variations, view_ids = (
        np.concatenate([np.empty(0, np.int32), *(each[name] for each in records)])
        for name in ("mesh_id", "variation", "view_id")
    )
    return plan.places(mesh_ids, variations, view_ids)


def new_store(plan: Plan) -> CloudBuffer | Archive:
    """Return what collects the clouds of a batch."""
    return Archive(plan) if plan.format == PACKED else CloudBuffer(plan)


class MadeMesh(NamedTuple):
    """What came of a mesh whose clouds were made."""

    counts: QualityCounts
    renderer: str
    origin: MeshSource
    blank: Blank | None  # None where all views have a cloud


def make_mesh(plan: Plan, mesh_id: int, gl: Any, store: CloudBuffer | Archive) -> MadeMesh:
    """Make all clouds of a mesh, and put them into a store.

    The store is left as it was where MeshError or ArgumentError says that the mesh cannot be used.
    """
    entry = plan.meshes[mesh_id]
    mesh = entry.load()
    counts, renderer, kept, blank = count_mesh(mesh, plan.recipe), "none", list[Any](), list[tuple[int, int, str]]()
    for variation, sampling in enumerate(samplings(plan, mesh, mesh_id, gl)):
        counts, renderer = counts + sampling.counts, sampling.renderer
        kept.append(store.keep(sampling, entry.key, variation))
        blank += [(variation, view, why) for view, why in sampling.blank.items()]
    store.add(mesh_id, mesh, kept)
    return MadeMesh(counts, renderer, mesh.origin, Blank(len(blank), *min(blank)) if blank else None)


def make_batch(
    plan: Plan,
    number: int,
    out: Path,
    gl: Any,
    *,
    lost: Mapping[int, GivenUp] = MappingProxyType({}),
    on_mesh: Callable[[int | None], None] = lambda mesh_id: None,
) -> None:
    """Make batch `number` of a plan, and write its file into the dataset's folder; failures of meshes are recorded.

    Meshes that are `lost` are failures and not tried again. `on_mesh` is called with the index of each mesh before it
    is begun, and with None before the batch is written.
    """
    began = time.perf_counter()
    store, counts, renderer, n_clouds, blank = (
        new_store(plan),
        QualityCounts(),
        "none",
        Counter[str](),
        dict[str, Blank](),
    )
    failures, origins, mesh_ids = dict[str, str](), dict[str, MeshSource](), plan.batches[number].mesh_ids
    for mesh_id in mesh_ids:
        entry = plan.meshes[mesh_id]
        on_mesh(mesh_id)
        try:
            if mesh_id in lost:
                raise MeshError(lost[mesh_id].reason)
            of_mesh, renderer, origins[entry.key], without = make_mesh(plan, mesh_id, gl, store)
        except (MeshError, ArgumentError) as error:  # options were tried before: it is the mesh's numbers
            failures[entry.key], origins[entry.key] = str(error), entry.origin_of_failure()
            continue
        counts += of_mesh
        blank |= {} if without is None else {entry.key: without}
        n_clouds[entry.split] += of_mesh.n_clouds
    on_mesh(None)
    files, contents, pieces, begin = (
        dict[str, list[FileDigest]](),
        dict[int, list[memoryview]](),
        dict[int, ByteRange](),
        0,
    )
    if isinstance(store, Archive):
        store.write(out / archive_name(number))
        files = {split: [FileDigest.of(out / archive_name(number))] for split in n_clouds}
    else:
        contents = store.pieces()
    for file, content in contents.items():
        crc32 = reduce(lambda before, part: zlib.crc32(part, before), content, 0)
        pieces[file] = ByteRange(begin, sum(map(len, content)), crc32)
        begin += pieces[file].n_bytes
    outcome = BatchReport(
        fingerprint=plan.fingerprint,
        counts=counts,
        failures=failures,
        given_up={plan.meshes[i].key: lost[i].limits for i in mesh_ids if i in lost},
        blank=blank,
        origins=origins,
        renderers=[renderer] if renderer != "none" else [],
        seconds=time.perf_counter() - began,
        n_clouds=n_clouds,
        files=files,
        pieces=pieces,
    )
    parts = (part for content in contents.values() for part in content)
    outcome.write(batch_path(out, number), parts, synced=False)  # it has checksums


def batch_path(out: Path, number: int) -> Path:
    """Return where a batch's file is while it is needed."""
    return out / WORK / f"{number:06d}.batch"


def group_path(out: Path, number: int) -> Path:
    """Return where what is known of a group is written."""
    return out / GROUPS / f"{number:06d}.json"


def read_outcome(plan: Plan, path: Path, *, closely: bool = False) -> tuple[BatchReport | None, str]:
    """Return the outcome of a batch or group that is done; else None and, where there is something, what is wrong.

    With `closely` the checksums of clouds and of all files are compared too, else of files that have changed since. One
    of another plan is a DatasetError.
    """
    try:
        with open(path, "rb") as file:
            outcome = BatchReport.from_json(file.readline())
            n_bytes = sum(piece.n_bytes for piece in outcome.pieces.values())
            if path.stat().st_size != file.tell() + n_bytes:
                raise ValueError("its size differs")
            for piece in outcome.pieces.values() if closely else ():
                if zlib.crc32(file.read(piece.n_bytes)) != piece.crc32:
                    raise ValueError("its checksum differs")
    except FileNotFoundError:
        return None, ""
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return None, f"{path.name} is damaged"
    if outcome.fingerprint != plan.fingerprint:
        raise DatasetError(f"{path} must belong to plan {plan.fingerprint}; it is of plan {outcome.fingerprint}.")
    since = 0 if closely else path.stat().st_mtime_ns
    for named in {named for of_split in outcome.files.values() for named in of_split}:
        if not is_as_written(path.parents[1] / named.name, named.n_bytes, named.sha256, since):
            return None, f"{named.name} is missing or damaged"
    return outcome, ""


def read_groups(plan: Plan, out: Path) -> Iterator[BatchReport]:
    """Yield the outcomes of all groups of a dataset; raise DatasetError where one is not done."""
    for number in range(len(plan.groups)):
        group, fault = read_outcome(plan, group_path(out, number))
        if group is None:
            raise DatasetError(
                f"{out} must have all {len(plan.groups)} groups of files; group {number} is not done"
                f"{fault and f': {fault}'}. Run the `zbuf-occlude generate` that made the others first."
            )
        yield group


def check_origins(entries: Iterable[MeshEntry], origins: Mapping[str, MeshSource], out: Path) -> None:
    """Raise DatasetError unless meshes are what data in a folder were made of, their `origins` by key."""
    for entry in entries:
        then = origins.get(entry.key)
        if then is None or (now := entry.origin_now(then)).sha256 == then.sha256:
            continue
        what = f"sha256 {now.sha256[:12]}..." if now.sha256 else "no longer readable"
        raise DatasetError(
            f"{entry.key} must be what the data in {out} were made of, sha256 {then.sha256[:12]}...; it is {what}. "
            "Put it back, choose another folder, or make all clouds again with --overwrite."
        )


def should_retry(entry: MeshEntry, origin: MeshSource, given_up: Limits | None, limits: Limits) -> bool:
    """Whether the cause of a mesh's failure may be gone: the file is another, or the limits are wider."""
    wider = given_up is not None and limits.allow_more_than(given_up)
    return wider or entry.origin_of_failure() != origin


def clouds_of_file(plan: Plan, out: Path, number: int) -> Records:
    """Return the clouds of a final file, in its order, from its batches; DatasetError if one is missing or damaged."""
    records = np.empty(plan.clouds_per_file, record_type(plan.recipe))
    is_filled = np.zeros(len(records), bool)
    for batch in plan.batches_of[plan.files[number].group]:
        piece = _read_piece(plan, batch_path(out, batch), number)
        _, rows = _places(plan, [piece])
        records[rows], is_filled[rows] = piece, True
    return records if is_filled.all() else records[is_filled]


def _read_piece(plan: Plan, path: Path, number: int) -> Records:
    with reading(path, REMEDY), open(path, "rb") as file:
        piece = BatchReport.from_json(file.readline()).pieces.get(number)
        if piece is None:
            return np.empty(0, record_type(plan.recipe))
        file.seek(piece.begin, io.SEEK_CUR)
        content = file.read(piece.n_bytes)
        if zlib.crc32(content) != piece.crc32:
            raise ValueError("its checksum differs")
        if plan.recipe.sample_size is None:
            return read_archive(io.BytesIO(content), plan.recipe)
        return np.frombuffer(content, record_type(plan.recipe))
