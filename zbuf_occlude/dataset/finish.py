"""The end of a dataset, when all of its clouds are in files: what belongs to the whole of it, the manifest last."""

import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.claim import remove_shards
from zbuf_occlude.dataset.folder import CONTACT_SHEET, MANIFEST, MESH_KEYS, SHAPE_NAMES, checksums
from zbuf_occlude.dataset.formats import find_format, packed
from zbuf_occlude.dataset.manifest import summed_up
from zbuf_occlude.dataset.origins import check_origins, origins_of_made
from zbuf_occlude.dataset.parts import clouds_kept, look_at_part, n_parts, shared_names
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.shard import Sidecar, data_path, look_at
from zbuf_occlude.dataset.shared import publish
from zbuf_occlude.dataset.sheet import write_contact_sheet
from zbuf_occlude.errors import DatasetError

SHOWN = 16
"""The picture is drawn of this many packed files."""

Found = TypeVar("Found")


class Files(NamedTuple):
    """What was written: names and clouds of each split, checksums, and the names of files enough for a picture."""

    names: dict[str, list[str]]
    n_clouds: dict[str, int]
    sha256: Mapping[str, str]
    shown: dict[str, list[str]]


def finish(plan: Plan, out: Path, seconds: Mapping[str, float]) -> dict[str, Any]:
    """Write what belongs to the whole dataset; then remove what is left of the shards.

    Parameters
    ----------
    plan : Plan
    out : Path
    seconds : mapping of str to float
        Wall-clock times of what was done before.

    Returns
    -------
    dict
        The manifest.

    Raises
    ------
    DatasetError
        A shard or a part is missing or damaged, a mesh has changed since it was used, or no mesh has a cloud.
    """
    began, row = time.perf_counter(), find_format(plan.format)
    n_runs = None if row.all_points else 0  # of others the clouds are in files
    sidecars = [
        _found(out, f"shard {i}", look_at(plan, out, i, n_runs=n_runs), len(plan.shards))
        for i in range(len(plan.shards))
    ]
    check_origins(plan.meshes, {key: each for s in sidecars for key, each in origins_of_made(s).items()}, out)
    if not any(sum(clouds_kept(plan, sidecar).values()) for sidecar in sidecars):
        reasons = [reason for sidecar in sidecars for reason in sidecar.failures.values()]
        raise DatasetError(
            f"at least one mesh must give a cloud; none of {len(plan.meshes)} did. The first failed so: "
            f"{reasons[0] if reasons else _blind(plan)}"
        )
    files = _of_shards(plan, out, sidecars) if row.all_points else files_of(plan, out, range(n_parts(plan)))
    if not row.all_points:
        _check_all_there(out, files, _by_split(plan, [clouds_kept(plan, sidecar) for sidecar in sidecars]))
    write_names(plan, out)
    write_contact_sheet(out / CONTACT_SHEET, row.load().read(out, plan, files.shown))
    writing = seconds.get("writing", 0.0) + time.perf_counter() - began
    document = summed_up(plan, sidecars, files.names, files.n_clouds, {**seconds, "writing": writing})
    document["sha256"] = checksums(out, files.names, files.sha256)
    atomic.write_json(out / MANIFEST, document)
    remove_shards(plan, out)  # all that matters is done
    return document


def _blind(plan: Plan) -> str:
    """Say why there is no cloud where nothing failed, and what to do."""
    whole, setup = find_format(plan.format).whole_objects, plan.recipe.setup
    why = f"a view sees nothing, and {plan.format} keeps whole objects" if whole else "its views see nothing"
    if setup is None:
        return f"{why}. Choose other --views."
    sensor = setup.made_sensor
    reach = f"{sensor.imperfections.range_min:g} to {sensor.imperfections.range_max:g} m"
    return f"{why}; {sensor.name} measures at {reach}. Choose --views, --range and --size by that."


def write_names(plan: Plan, out: Path) -> None:
    """Write what labels and mesh ids stand for."""
    atomic.write_lines(out / SHAPE_NAMES, plan.classes)
    atomic.write_lines(out / MESH_KEYS, [entry.key for entry in plan.meshes])


def _of_shards(plan: Plan, out: Path, sidecars: list[Sidecar]) -> Files:
    """Return the files that the shards are."""
    names = packed.files_of(plan)
    sha256 = {data_path(plan, out, i).name: sidecar.sha256 for i, sidecar in enumerate(sidecars)}
    n_clouds = _by_split(plan, [sidecar.n_clouds for sidecar in sidecars])
    return Files(names, n_clouds, sha256, {split: of_split[:SHOWN] for split, of_split in names.items()})


def files_of(plan: Plan, out: Path, parts: Iterable[int]) -> Files:
    """Return the files of all parts, which have these numbers, and write what comes beside them.

    Raises
    ------
    DatasetError
        A part is missing or damaged.
    """
    row, parts = find_format(plan.format), list(parts)
    marks = [_found(out, f"part {i}", look_at_part(plan, out, i), len(parts)) for i in parts]
    n_clouds = _by_split(plan, [mark.n_clouds for mark in marks])
    names = {
        split: list(dict.fromkeys(name for mark in marks for name in mark.files.get(split, ()))) for split in n_clouds
    }
    for name in shared_names(plan):
        publish(out, name)
    names = row.finish(out, plan, names, n_clouds)
    sha256 = {name: digest for mark in marks for name, digest in mark.sha256.items()}
    return Files(names, n_clouds, sha256, {split: of_split[:1] for split, of_split in names.items()})


def _check_all_there(out: Path, files: Files, made: Mapping[str, int]) -> None:
    """Check that files hold the clouds that shards were made of; one may have been made twice, with another outcome."""
    if files.n_clouds != made:
        raise DatasetError(
            f"the files in {out} must hold the clouds that were made, {dict(made)}; they hold {files.n_clouds}. A mesh "
            "was made twice, and failed once. Make all clouds again with --overwrite."
        )


def _by_split(plan: Plan, counts: Iterable[Mapping[str, int]]) -> dict[str, int]:
    counts = list(counts)
    total = {split: sum(each.get(split, 0) for each in counts) for split in plan.splits}
    return {split: n_clouds for split, n_clouds in total.items() if n_clouds}


def _found(out: Path, what: str, looked: tuple[Found | None, str], n: int) -> Found:
    found, fault = looked
    if found is None:
        raise DatasetError(
            f"{out}: all {n} {what.split()[0]}s must be done; {what} is not{fault and f': {fault}'}. "
            "Run it first: the `zbuf-occlude generate` that made the others."
        )
    return found
