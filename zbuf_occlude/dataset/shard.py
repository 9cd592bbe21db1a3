"""A shard: the clouds of a few meshes in one file, and the sidecar, written last, that says it is done."""

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.dataset.counts import Counts
from zbuf_occlude.dataset.damage import reading
from zbuf_occlude.dataset.folder import SHARDS, sha256_of
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.packed_files import PackedFiles
from zbuf_occlude.dataset.packed_store import PackedStore, shard_name
from zbuf_occlude.dataset.pipeline import occlude
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.records import REMEDY, RecordStore, Run, are_whole, read_run
from zbuf_occlude.dataset.scans import scan_views
from zbuf_occlude.dataset.sealed import read_sealed, write_sealed
from zbuf_occlude.errors import ArgumentError, MeshError
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.geometry.sampling import SurfacePoints
from zbuf_occlude.limits import GivenUp, Limits
from zbuf_occlude.origin import Origin
from zbuf_occlude.views import Views


class Store(Protocol):
    """Collects what is kept of the meshes of a shard, and writes it as one file."""

    suffix: ClassVar[str]

    def keep(self, points: SurfacePoints, mask: BoolArray, views: Views, key: str, variation: int) -> Any:
        """Take what is to be kept of one sampling of a mesh (`pipeline.Keep`)."""

    def add(self, mesh_id: int, mesh: Mesh, kept: list[Any]) -> None:
        """Take in what was kept of all samplings of a mesh; none of a mesh that failed half way."""

    def write(self, path: Path, shard: int) -> list[Run]:
        """Write the file of a shard, whole or not at all; return the runs that it consists of."""


@dataclass(frozen=True)
class Sidecar:
    """What is known of a finished shard.

    Parameters
    ----------
    fingerprint : str
        Of its plan.
    shard : int
    counts : Counts
    failures : mapping of mesh key to reason
    given_up : mapping of mesh key to Limits
        Of the failures those that no worker survived, and the limits that they had.
    origins : mapping of mesh key to Origin
        What every mesh was made of.
    renderer : str
    seconds : float
        That making it took.
    n_clouds : mapping of split to int
    n_whole : mapping of split to int
        Meshes that every view sees.
    runs : list of (int, int)
        The bytes and the CRC-32 of what its data consist of: of records, what goes into each part made of them.
    sha256 : str
        Of data that are a final file; empty of others.
    """

    fingerprint: str
    shard: int
    counts: Counts
    failures: Mapping[str, str]
    given_up: Mapping[str, Limits]
    origins: Mapping[str, Origin]
    renderer: str
    seconds: float
    n_clouds: Mapping[str, int]
    n_whole: Mapping[str, int]
    runs: list[Run]
    sha256: str

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
    def from_document(cls, document: Mapping[str, Any]) -> "Sidecar":
        """Read back what `document` gave."""
        return cls(
            **{
                **document,
                "counts": Counts.from_document(document["counts"]),
                "given_up": {key: Limits(*limits) for key, limits in document["given_up"].items()},
                "origins": {key: Origin.from_document(each) for key, each in document["origins"].items()},
                "runs": [(int(n_bytes), int(checksum)) for n_bytes, checksum in document["runs"]],
            }
        )


def new_store(plan: Plan) -> Store:
    """Return what collects the clouds of a plan's shards, by its format."""
    return PackedStore(plan) if find_format(plan.format).keeps_points else RecordStore(plan)


class Made(NamedTuple):
    """All clouds of a shard: by mesh, variation, view; and what says whole objects, where they were kept."""

    records: NDArray[Any]
    complete: Callable[[int, int], Any] | None


def read_shard(plan: Plan, path: Path, runs: list[Run]) -> Made:
    """Read all clouds of a shard of a format that wants whole objects.

    Raises
    ------
    DatasetError
        They cannot be read, or are not what was written.
    """
    if not find_format(plan.format).keeps_points:
        return Made(read_run(path, plan, 0, runs[0]), None)
    with reading(path, REMEDY):
        if not are_whole(path, runs):
            raise ValueError("its checksum is another")
    files = PackedFiles(plan, [path])
    return Made(files.take(np.arange(len(files.mesh_ids))), files.complete)


def data_path(plan: Plan, out: Path, shard: int) -> Path:
    """Where a shard's clouds are kept until the final files are made; of `packed`, where they stay."""
    row = find_format(plan.format)
    if row.all_points:
        return out / shard_name(shard)
    return out / SHARDS / f"{shard:06d}{(PackedStore if row.keeps_points else RecordStore).suffix}"


def sidecar_path(out: Path, shard: int) -> Path:
    """Where a shard's sidecar is; without it the shard is not done."""
    return out / SHARDS / f"{shard:06d}.json"


def look_at(
    plan: Plan, out: Path, shard: int, *, closely: bool = False, n_runs: int | None = None
) -> tuple[Sidecar | None, str]:
    """Return the sidecar of a shard that is done; of any other None and, where there are pieces of it, what is wrong.

    Parameters
    ----------
    plan : Plan
    out : Path
    shard : int
    closely : bool
        Read its data too, for their checksums; else only their size is looked at.
    n_runs : int, optional
        Of its data only these first runs are needed, for the others are in files already.

    Raises
    ------
    DatasetError
        The shard belongs to another plan.
    """
    path, data = sidecar_path(out, shard), data_path(plan, out, shard)
    sidecar, fault = read_sealed(path, plan, Sidecar.from_document)
    if sidecar is None:
        return None, fault
    needed = sidecar.runs[:n_runs]
    if n_runs is not None and not any(n_bytes for n_bytes, _ in needed):
        return sidecar, ""
    if not data.is_file():
        return None, f"its {data.name} is missing"
    n_bytes, most = (sum(size for size, _ in runs) for runs in (needed, sidecar.runs))
    if not n_bytes <= data.stat().st_size <= most or (closely and not are_whole(data, needed)):
        return None, f"its {data.name} is damaged"
    return sidecar, ""


def make_mesh(plan: Plan, mesh_id: int, gl: Any, store: Store) -> tuple[Counts, str, Origin]:
    """Make all clouds of a mesh, and put them into a store; return what was counted, the renderer, and its origin.

    Raises
    ------
    MeshError, ArgumentError
        The mesh cannot be used.
    """
    entry = plan.meshes[mesh_id]
    mesh = entry.load()
    if plan.recipe.setup is None:
        views = plan.views_of(entry.key)
        kept, counts, renderer = occlude(mesh, plan.recipe, views, entry.key, gl, store.keep, plan.n_checked)
    else:
        kept, counts, renderer = scan_views(mesh, entry.label, plan, entry.key, store.keep)
    store.add(mesh_id, mesh, kept)
    return counts, renderer, mesh.origin


def run_shard(
    plan: Plan,
    shard: int,
    out: Path,
    gl: Any,
    *,
    lost: Mapping[int, GivenUp] = MappingProxyType({}),
    on_mesh: Callable[[int | None], None] = lambda mesh_id: None,
) -> Sidecar:
    """Make one shard, write its clouds and then its sidecar; return the sidecar.

    Parameters
    ----------
    plan : Plan
    shard : int
        Index into ``plan.shards``.
    out : Path
        The dataset's folder.
    gl : GlContext or None
    lost : mapping of mesh index to GivenUp
        Meshes that are given up: each is a failure with its reason, and not tried.
    on_mesh : callable
        Told the index of each mesh before it is begun, and None before the shard is written.

    Notes
    -----
    A mesh that cannot be used is recorded under ``failures`` with its reason; the shard goes on.
    """
    began = time.perf_counter()
    store = new_store(plan)
    counts, renderer, n_clouds, n_whole = Counts(), "none", Counter[str](), Counter[str]()
    failures: dict[str, str] = {}
    origins: dict[str, Origin] = {}
    for mesh_id in plan.shards[shard]:
        entry = plan.meshes[mesh_id]
        on_mesh(mesh_id)
        try:
            if mesh_id in lost:
                raise MeshError(lost[mesh_id].reason)
            of_mesh, renderer_of_mesh, origins[entry.key] = make_mesh(plan, mesh_id, gl, store)
        except (MeshError, ArgumentError) as error:  # the options have been tried: it is the mesh's numbers
            failures[entry.key], origins[entry.key] = str(error), entry.origin_of_failure()
            continue
        except MemoryError:
            failures[entry.key] = f"the mesh must fit in memory; {entry.key} does not. Simplify it."
            origins[entry.key] = entry.origin_of_failure()
            continue
        counts, renderer = counts + of_mesh, renderer_of_mesh
        n_clouds[entry.split] += of_mesh.n_clouds
        n_whole[entry.split] += of_mesh.n_clouds == plan.clouds_per_mesh
    on_mesh(None)
    data = data_path(plan, out, shard)
    (out / SHARDS).mkdir(exist_ok=True)
    runs = store.write(data, shard)
    sidecar = Sidecar(
        fingerprint=plan.fingerprint,
        shard=shard,
        counts=counts,
        failures=failures,
        given_up={plan.meshes[i].key: lost[i].limits for i in plan.shards[shard] if i in lost},
        origins=origins,
        renderer=renderer,
        seconds=time.perf_counter() - began,
        n_clouds=n_clouds,
        n_whole=n_whole,
        runs=runs,
        sha256=sha256_of(data) if find_format(plan.format).all_points else "",
    )
    write_sealed(sidecar_path(out, shard), sidecar.document, synced=False)
    return sidecar
