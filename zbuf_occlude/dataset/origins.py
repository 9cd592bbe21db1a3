"""Whether meshes are still what clouds were made of, and whether those that failed may be made now."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from zbuf_occlude.dataset.damage import REMEDY
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.shard import Sidecar
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.limits import Limits
from zbuf_occlude.meshes.collection import MeshEntry
from zbuf_occlude.origin import Origin


def check_origins(entries: Iterable[MeshEntry], origins: Mapping[str, Origin], out: Path) -> None:
    """Check that meshes are what data in a folder were made of; `origins` are what they were, by their keys.

    Raises
    ------
    DatasetError
        One is not.
    """
    for entry in entries:
        then = origins.get(entry.key)
        if then is None or (now := entry.origin_now(then)).sha256 == then.sha256:
            continue
        what = f"sha256 {now.sha256[:12]}..." if now.sha256 else "no longer readable"
        raise DatasetError(
            f"{entry.key} must be what the data in {out} were made of, sha256 {then.sha256[:12]}...; it is {what}. "
            "Put it back, choose another folder, or make all clouds again with --overwrite."
        )


def origins_of_made(sidecar: Sidecar) -> dict[str, Origin]:
    """Return what the meshes of a shard that did not fail were made of."""
    return {key: origin for key, origin in sidecar.origins.items() if key not in sidecar.failures}


def worth_another_try(plan: Plan, sidecar: Sidecar, limits: Limits) -> list[str]:
    """Return the keys of a shard's failures whose cause may be gone: another file, or wider limits."""
    entries = [plan.meshes[i] for i in plan.shards[sidecar.shard]]
    return [
        entry.key
        for entry in entries
        if entry.key in sidecar.failures
        and _may_be_made_now(entry, sidecar.origins[entry.key], sidecar.given_up.get(entry.key), limits)
    ]


def tries(sidecars: list[Sidecar]) -> dict[str, Any]:
    """Return, as plain data by key, what showed of each mesh that failed, and its limits where those were the cause."""
    return {
        key: {
            "origin": sidecar.origins[key].document,
            "limits": sidecar.given_up[key].document if key in sidecar.given_up else None,
        }
        for sidecar in sidecars
        for key in sidecar.failures
    }


def check_finished(plan: Plan, manifest: Mapping[str, Any], limits: Limits, out: Path) -> None:
    """Check that a finished dataset is what its plan would give now.

    Raises
    ------
    DatasetError
        A file is missing, a mesh is another than its clouds were made of, or one that failed may be made now.

    Notes
    -----
    Files are not read; `verify` does that.
    """
    if lost := next((name for name in sorted(manifest["sha256"]) if not (out / name).exists()), None):
        raise DatasetError(f"{out / lost} must be there; it is missing. {REMEDY}")
    made = {key: Origin.from_document(document) for key, document in manifest.get("origins", {}).items()}
    check_origins(plan.meshes, made, out)
    again = list(_failed_that_may_be_made(plan, manifest.get("tries", {}), limits))
    if again:
        more = f", and so may {len(again) - 1} more" if len(again) > 1 else ""
        raise DatasetError(
            f"a finished dataset must hold all that its meshes give; {again[0]} failed when {out} was made, and may be "
            f"made now: its file, or what a mesh may take, is another{more}. Make all clouds again with --overwrite, "
            "or those meshes' in another folder."
        )


def _failed_that_may_be_made(plan: Plan, documents: Mapping[str, Any], limits: Limits) -> Iterator[str]:
    for entry in plan.meshes:
        if (document := documents.get(entry.key)) is not None:
            given_up = Limits(*document["limits"]) if document["limits"] else None
            if _may_be_made_now(entry, Origin.from_document(document["origin"]), given_up, limits):
                yield entry.key


def _may_be_made_now(entry: MeshEntry, then: Origin, given_up: Limits | None, limits: Limits) -> bool:
    return (given_up is not None and limits.allow_more_than(given_up)) or entry.origin_of_failure() != then
