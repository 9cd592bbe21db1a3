"""A shard: the clouds of a few meshes in one file, and the sidecar, written last, that says it is done."""

import hashlib
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Protocol

from zbuf_occlude.arrays import BoolArray
from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.counts import Counts
from zbuf_occlude.dataset.folder import SHARDS, sha256_of
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.packed import Archives, PackedStore, shard_name
from zbuf_occlude.dataset.pipeline import occlude
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.records import RecordStore, source_of_records
from zbuf_occlude.dataset.scans import scan_views
from zbuf_occlude.dataset.source import Source
from zbuf_occlude.errors import ArgumentError, DatasetError, MeshError
from zbuf_occlude.limits import GivenUp, Limits
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.origin import Origin
from zbuf_occlude.sampling import SurfacePoints
from zbuf_occlude.views import Views


class Store(Protocol):
    """Collects what is kept of the meshes of a shard, and writes it as one file."""

    suffix: ClassVar[str]

    def keep(self, points: SurfacePoints, mask: BoolArray, views: Views, key: str, variation: int) -> Any:
        """Take what is to be kept of one sampling of a mesh (`pipeline.Keep`)."""

    def add(self, mesh_id: int, mesh: Mesh, kept: list[Any]) -> None:
        """Take in what was kept of all samplings of a mesh; none of a mesh that failed half way."""

    def write(self, path: Path) -> None:
        """Write the file, whole or not at all."""


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
    n_bytes : int
        Of its data.
    sha256 : str
        Of its data.
    """

    fingerprint: str
    shard: int
    counts: Counts
    failures: Mapping[str, str]
    given_up: Mapping[str, Limits]
    origins: Mapping[str, Origin]
    renderer: str
    seconds: float
    n_bytes: int
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
            }
        )


def new_store(plan: Plan) -> Store:
    """Return what collects the clouds of a plan's shards, by its format."""
    return PackedStore(plan) if find_format(plan.format).keeps_points else RecordStore(plan)


def source_of_shards(plan: Plan, paths: list[Path]) -> Source:
    """Return the clouds of finished shards, in the order in which their files are to hold them."""
    return Archives(plan, paths).source() if find_format(plan.format).keeps_points else source_of_records(plan, paths)


def data_path(plan: Plan, out: Path, shard: int) -> Path:
    """Where a shard's clouds are kept until the final files are made; of `packed`, where they stay."""
    row = find_format(plan.format)
    if row.all_points:
        return out / shard_name(shard)
    return out / SHARDS / f"{shard:06d}{(PackedStore if row.keeps_points else RecordStore).suffix}"


def sidecar_path(out: Path, shard: int) -> Path:
    """Where a shard's sidecar is; without it the shard is not done."""
    return out / SHARDS / f"{shard:06d}.json"


def look_at(plan: Plan, out: Path, shard: int, *, closely: bool = False) -> tuple[Sidecar | None, str]:
    """Return the sidecar of a shard that is done; of any other None and, where there are pieces of it, what is wrong.

    Parameters
    ----------
    plan : Plan
    out : Path
    shard : int
    closely : bool
        Read its data too, for their checksum; else only their size is looked at.

    Raises
    ------
    DatasetError
        The shard belongs to another plan.
    """
    path, data = sidecar_path(out, shard), data_path(plan, out, shard)
    try:
        document = json.loads(path.read_bytes())
        if document.pop("seal") != _seal(document):
            return None, f"its {path.name} is damaged"
        sidecar = Sidecar.from_document(document)
    except FileNotFoundError:
        return None, ""
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return None, f"its {path.name} is damaged"
    if sidecar.fingerprint != plan.fingerprint:
        raise DatasetError(f"{path} must belong to plan {plan.fingerprint}; it is of plan {sidecar.fingerprint}.")
    if not data.is_file():
        return None, f"its {data.name} is missing"
    if data.stat().st_size != sidecar.n_bytes or (closely and sha256_of(data) != sidecar.sha256):
        return None, f"its {data.name} is damaged"
    return sidecar, ""


def read_sidecar(plan: Plan, out: Path, shard: int) -> Sidecar | None:
    """Return the sidecar of a shard that is done, None for one that is to be made; raises as `look_at` does."""
    return look_at(plan, out, shard)[0]


def _seal(document: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()


def run_shard(
    plan: Plan,
    shard: int,
    out: Path,
    gl: Any,
    *,
    lost: Mapping[int, GivenUp] = MappingProxyType({}),
    on_mesh: Callable[[int], None] = lambda mesh_id: None,
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
        Told the index of each mesh before it is begun.

    Notes
    -----
    A mesh that cannot be used is recorded under ``failures`` with its reason; the shard goes on.
    """
    began = time.perf_counter()
    store = new_store(plan)
    counts, renderer = Counts(), "none"
    failures: dict[str, str] = {}
    origins: dict[str, Origin] = {}
    for mesh_id in plan.shards[shard]:
        entry = plan.meshes[mesh_id]
        on_mesh(mesh_id)
        try:
            if mesh_id in lost:
                raise MeshError(lost[mesh_id].reason)
            mesh = entry.load()
            views = plan.views_of(entry.key)
            if plan.recipe.setup is None:
                kept, of_mesh, renderer_of_mesh = occlude(
                    mesh, plan.recipe, views, entry.key, gl, store.keep, plan.n_checked
                )
            else:
                kept, of_mesh, renderer_of_mesh = scan_views(mesh, entry.label, plan, entry.key, store.keep)
        except (MeshError, ArgumentError) as error:  # the options have been tried: it is the mesh's numbers
            failures[entry.key], origins[entry.key] = str(error), entry.origin_of_failure()
            continue
        except MemoryError:
            failures[entry.key] = f"the mesh must fit in memory; {entry.key} does not. Simplify it."
            origins[entry.key] = entry.origin_of_failure()
            continue
        store.add(mesh_id, mesh, kept)
        counts, renderer, origins[entry.key] = counts + of_mesh, renderer_of_mesh, mesh.origin
    data = data_path(plan, out, shard)
    (out / SHARDS).mkdir(exist_ok=True)
    store.write(data)
    sidecar = Sidecar(
        fingerprint=plan.fingerprint,
        shard=shard,
        counts=counts,
        failures=failures,
        given_up={plan.meshes[i].key: lost[i].limits for i in plan.shards[shard] if i in lost},
        origins=origins,
        renderer=renderer,
        seconds=time.perf_counter() - began,
        n_bytes=data.stat().st_size,
        sha256=sha256_of(data),
    )
    document = sidecar.document
    atomic.write_json(sidecar_path(out, shard), {**document, "seal": _seal(document)})
    return sidecar
