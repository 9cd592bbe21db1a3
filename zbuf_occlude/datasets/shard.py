"""Shards: whole meshes made into clouds in memory, the final files of these clouds, and a sidecar that reports on them.

The sidecar ``shards/NNNNNN.json`` is written last. A shard is done when its sidecar is there and its files have their
sizes.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import float32_fault
from zbuf_occlude.base.atomic import FileDigest
from zbuf_occlude.base.errors import ArgumentError, DatasetError, MeshError
from zbuf_occlude.base.provenance import MeshSource
from zbuf_occlude.datasets.counts import Blank, QualityCounts
from zbuf_occlude.datasets.folder import SHARDS, SOURCE, Each, Kinds, has_size, read_object
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.datasets.pipeline import Sampling, count_mesh, samplings
from zbuf_occlude.datasets.plan import Plan
from zbuf_occlude.datasets.records import Records, gather_clouds, record_type, stored_bounds
from zbuf_occlude.geometry.mesh import Mesh

_OF_COUNTS: Kinds = {each.name: type(each.default) for each in fields(QualityCounts)} | {
    "clear_range": (int, float),
    "worst": (list, type(None)),
    "faces_dropped": Each(dict, int),
}
_OF_SIDECAR: Kinds = {
    "fingerprint": str,
    "counts": _OF_COUNTS,
    "failures": Each(dict, str),
    "blank": Each(dict, [int, int, int, str]),
    "sources": Each(dict, SOURCE),
    "renderers": Each(list, str),
    "seconds": (int, float),
    "n_clouds": Each(dict, int),
    "files": Each(dict, Each(list, [str, int, str])),
}
"""Schema of a sidecar."""


@dataclass(frozen=True)
class ShardReport:
    """The report on a shard, or on all shards of a dataset; meshes are named by their keys."""

    fingerprint: str  # of the plan
    counts: QualityCounts = field(default_factory=QualityCounts)
    failures: Mapping[str, str] = field(default_factory=dict)  # reasons
    blank: Mapping[str, Blank] = field(default_factory=dict)  # views without a cloud
    sources: Mapping[str, MeshSource] = field(default_factory=dict)  # of the meshes that did not fail
    renderers: list[str] = field(default_factory=list)
    seconds: float = 0.0
    n_clouds: Mapping[str, int] = field(default_factory=dict)  # by split
    files: Mapping[str, list[FileDigest]] = field(default_factory=dict)  # by split

    @classmethod
    def of_all(cls, fingerprint: str, reports: Iterable["ShardReport"]) -> "ShardReport":
        """Add up the reports on some shards."""
        parts, n_clouds, files = list(reports), Counter[str](), dict[str, list[FileDigest]]()
        for part in parts:
            n_clouds.update(part.n_clouds)
            for split, of_split in part.files.items():
                files.setdefault(split, []).extend(of_split)
        return cls(
            fingerprint,
            sum((part.counts for part in parts), QualityCounts()),
            {key: reason for part in parts for key, reason in part.failures.items()},
            {key: blank for part in parts for key, blank in part.blank.items()},
            {key: source for part in parts for key, source in part.sources.items()},
            sorted({renderer for part in parts for renderer in part.renderers}),
            sum(part.seconds for part in parts),
            n_clouds,
            files,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain data."""
        return asdict(self)

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "ShardReport":
        """Read back what `to_dict` gave, of the schema `_OF_SIDECAR`."""
        read: dict[str, Any] = {
            "counts": QualityCounts.from_dict(document["counts"]),
            "blank": {key: Blank(*each) for key, each in document["blank"].items()},
            "sources": {key: MeshSource.from_dict(each) for key, each in document["sources"].items()},
            "files": {split: [FileDigest(*file) for file in files] for split, files in document["files"].items()},
        }
        return cls(**{**document, **read})


class RecordShard:
    """The clouds of a shard as records, for the formats that hold records."""

    def __init__(self, plan: Plan) -> None:
        self._plan, self._records = plan, list[Records]()

    def keep(self, sampling: Sampling, key: str, variation: int) -> Records:
        """Draw the clouds of one sampling of a mesh."""
        return gather_clouds(
            sampling.points,
            sampling.mask,
            sampling.views,
            sampling.longest_side,
            self._plan.config,
            key,
            variation,
        )

    def add(self, mesh_id: int, mesh: Mesh, kept: list[Records]) -> None:
        """Take all clouds of a mesh."""
        label = self._plan.classes.index(self._plan.meshes[mesh_id].label)
        for records in kept:
            records["mesh_id"], records["label"] = mesh_id, label
            self._records.append(records)

    def write(self, out: Path, shard: int) -> list[FileDigest]:
        """Write the files of the shard that have clouds; remove others, which an interrupted run may have left."""
        plan, module, written = self._plan, find_format(self._plan.format).storage.load(), list[FileDigest]()
        arrays = [np.empty(0, record_type(plan.config)), *self._records]
        ids = (np.concatenate([each[name] for each in arrays]) for name in ("mesh_id", "variation", "view_id"))
        files, rows = plan.places(*ids)
        array_of = np.repeat(np.arange(len(arrays)), list(map(len, arrays)))
        row_of = np.concatenate([np.arange(len(each)) for each in arrays])
        for number in plan.files_of(shard):
            file, mine = plan.files[number], np.flatnonzero(files == number)
            path = out / module.file_name(file.split, file.number)
            if not len(mine):
                path.unlink(missing_ok=True)
                continue
            mine = mine[np.argsort(rows[mine])]
            records = np.empty(len(mine), record_type(plan.config))
            for array in np.unique(array_of[mine]).tolist():
                here = array_of[mine] == array
                records[here] = arrays[array][row_of[mine[here]]]
            written.append(module.write(path, records, plan, file.number))
        return written


def new_store(plan: Plan) -> Any:
    """Return the store in which the plan's format collects the clouds of a shard."""
    return getattr(find_format(plan.format).storage.load(), "Shard", RecordShard)(plan)


class MadeMesh(NamedTuple):
    """The report on a mesh whose clouds were made."""

    counts: QualityCounts
    renderer: str
    source: MeshSource
    blank: Blank | None  # None where all views have a cloud


def make_mesh(plan: Plan, mesh_id: int, gl: Any, store: Any) -> MadeMesh:
    """Make all clouds of a mesh, and put them into a store.

    The store is left as it was where an error says that the mesh cannot be used, or memory does not suffice.
    """
    entry, config = plan.meshes[mesh_id], plan.config
    mesh = entry.load()
    counts, renderer, kept, blank = count_mesh(mesh, config), "none", list[Any](), list[tuple[int, int, str]]()
    for variation, sampling in enumerate(samplings(plan, mesh, mesh_id, gl)):
        bounds = stored_bounds(mesh, sampling.views.distance.max(), config)
        if config.scan is None and config.scale in ("metres", "mesh") and (reason := float32_fault(bounds)):
            raise MeshError(f"points in the unit of the mesh must suit float32; their {reason}. Give --scale object.")
        counts, renderer = counts + sampling.counts, sampling.renderer
        kept.append(store.keep(sampling, entry.key, variation))
        blank += [(variation, view, why) for view, why in sampling.blank.items()]
    store.add(mesh_id, mesh, kept)
    return MadeMesh(counts, renderer, mesh.origin, Blank(len(blank), *min(blank)) if blank else None)


def make_shard(
    plan: Plan,
    number: int,
    out: Path,
    gl: Any,
    *,
    lost: Mapping[int, str] = MappingProxyType({}),
    on_mesh: Callable[[int | None], None] = lambda mesh_id: None,
) -> None:
    """Make a shard of a plan: its files, then its sidecar; failures of meshes are recorded.

    Meshes in `lost` are left out as failures, with their reasons. `on_mesh` is called with the index of each
    mesh before it is begun, and with None before the files are written.
    """
    began, split, store = time.perf_counter(), plan.split_of_shard(number), new_store(plan)
    counts, renderer, blank = QualityCounts(), "none", dict[str, Blank]()
    failures, sources, n_clouds = dict[str, str](), dict[str, MeshSource](), 0
    for mesh_id in plan.shards[number].tolist():
        entry = plan.meshes[mesh_id]
        on_mesh(mesh_id)
        try:
            if mesh_id in lost:
                raise MeshError(lost[mesh_id])
            made = make_mesh(plan, mesh_id, gl, store)
        except (MeshError, ArgumentError) as error:  # options were checked before: the mesh is at fault
            failures[entry.key] = str(error)
            continue
        except MemoryError as error:
            detail = f" ({error})" if str(error) else ""
            failures[entry.key] = f"out of memory{detail}. Reduce points, density, views or variations."
            continue
        counts, renderer, sources[entry.key] = counts + made.counts, made.renderer, made.source
        n_clouds += made.counts.n_clouds
        if made.blank is not None:
            blank[entry.key] = made.blank
    on_mesh(None)
    folder = data_folder(plan, out)
    folder.mkdir(exist_ok=True)
    files = store.write(folder, number)
    report = ShardReport(
        plan.fingerprint,
        counts,
        failures,
        blank,
        sources,
        [renderer] if renderer != "none" else [],
        time.perf_counter() - began,
        {split: n_clouds} if files else {},
        {split: files} if files else {},
    )
    sidecar_path(out, number).parent.mkdir(exist_ok=True)
    atomic.write_json(sidecar_path(out, number), report.to_dict())


def data_folder(plan: Plan, out: Path) -> Path:
    """Return the folder of the files of shards: that of the sidecars where an export is made of them."""
    return out / SHARDS if find_format(plan.format).exported_from else out


def sidecar_path(out: Path, number: int) -> Path:
    """Return the path of a shard's sidecar."""
    return out / SHARDS / f"{number:06d}.json"


def read_shard(plan: Plan, out: Path, number: int) -> tuple[ShardReport | None, str]:
    """Return the report on a shard that is done, or else None, and its fault where it is damaged.

    A shard of another plan is a DatasetError.
    """
    path = sidecar_path(out, number)
    try:
        report = ShardReport.from_dict(read_object(path, _OF_SIDECAR))
    except FileNotFoundError:
        return None, ""
    except (ValueError, LookupError, TypeError, RecursionError):
        return None, f"{path.name} is damaged"
    if report.fingerprint != plan.fingerprint:
        raise DatasetError(f"{path} must belong to plan {plan.fingerprint}; it is of plan {report.fingerprint}.")
    for file in (file for files in report.files.values() for file in files):
        if not has_size(data_folder(plan, out) / file.name, file.n_bytes):
            return None, f"{file.name} is missing or damaged"
    return report, ""


def read_shards(plan: Plan, out: Path) -> Iterator[ShardReport]:
    """Yield the reports on all shards of a dataset; raise DatasetError where one is not done."""
    for number in range(len(plan.shards)):
        report, fault = read_shard(plan, out, number)
        if report is None:
            raise DatasetError(
                f"{out} must have all {len(plan.shards)} shards; shard {number} is not done{fault and f': {fault}'}. "
                "Run the `zbuf-occlude generate` that made the others first."
            )
        yield report
