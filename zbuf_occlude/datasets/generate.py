"""Generate a dataset in a folder: workers make its shards; lists, picture and manifest are written when all are done.

The same call again resumes: a shard that is done is not made again. The manifest, written last, says how the dataset
was made, what failed and how wrong it is.
"""

import logging
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from zbuf_occlude.base.errors import DatasetError, OptionError
from zbuf_occlude.base.provenance import versions
from zbuf_occlude.datasets.counts import FEW
from zbuf_occlude.datasets.export import check_sources, export, finish_folder, frame_in_words
from zbuf_occlude.datasets.folder import (
    checksums,
    claim_folder,
    contains_plan,
    damaged,
    leftover_work,
    locked,
    read_command,
    read_manifest,
    removable,
    remove,
    remove_files,
    unfinish,
    write_names,
)
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.datasets.packed import QUANT_LEVELS
from zbuf_occlude.datasets.plan import Plan
from zbuf_occlude.datasets.shard import ShardReport, data_folder, make_shard, read_shard, read_shards, sidecar_path
from zbuf_occlude.datasets.workers import Run, run_here
from zbuf_occlude.engines.gl.devices import explain_software_fallback
from zbuf_occlude.visibility import find_method

SHOWN = 16
"""Maximum number of files whose clouds the picture is drawn of."""

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class GenerateTask:
    """The task of making a dataset: a job is the number of a shard."""

    plan: Plan
    out: Path

    @property
    def needs_gl(self) -> bool:
        """True where the method renders."""
        return find_method(self.plan.config.method).needs_gl

    def do(
        self,
        job: int,
        gl: Any,
        lost: Mapping[int, str] = MappingProxyType({}),
        on_mesh: Callable[[int | None], None] = lambda mesh_id: None,
    ) -> None:
        """Make a shard."""
        make_shard(self.plan, job, self.out, gl, lost=lost, on_mesh=on_mesh)


def generate(
    plan: Plan,
    out: Path,
    *,
    run: Run | None = None,
    overwrite: bool = False,
    retry_failed: bool = False,
    share: tuple[int, int] = (0, 1),
    command: Mapping[str, Any] = MappingProxyType({}),
    progress: Callable[[int], None] = lambda clouds: None,
) -> dict[str, Any]:
    """Make the dataset of a plan in a folder.

    Parameters
    ----------
    plan : Plan
    out : Path
        Created where missing. A folder with the same plan is resumed.
    run : callable, optional
        Engine that does the jobs; `run_here`, in this process, by default.
    overwrite : bool
        Remove the dataset in the folder first. Other files in it are an error, and nothing is removed.
    retry_failed : bool
        Make the shards again in which a mesh failed.
    share : (int, int)
        (i, n): make only the shards of the i-th (from 0) of n machines; `merge` finishes the dataset when all are done.
    command : mapping
        Options of the command line, by name, for the manifest: `generate --config` reads them from there.
    progress : callable
        Called with the number of planned clouds of each shard that is done, at once for shards of an earlier run.

    Returns
    -------
    dict
        The manifest; {} for a share of the dataset.

    Raises
    ------
    DatasetError
        The folder holds another plan's dataset, or files that are not a dataset, or another run is making it; a mesh
        has another size than when its clouds were made; no mesh could be used.
    GlError
        The method needs GL and there is none.
    OptionError, UnavailableError
        The format cannot hold such a plan, or lacks a package here.
    """
    find_format(plan.format).check(plan)
    if overwrite and share != (0, 1):
        raise OptionError(
            "--overwrite must go with the whole dataset; a share of it would remove what other shares have made. "
            f"Leave it out, and remove {out} before the first share."
        )
    if overwrite and removable(out):
        remove(out)
    elif (
        contains_plan(plan, out)
        and (finished := read_manifest(out))
        and not _faults(plan, finished, out, retry_failed)
        and not leftover_work(out, plan)
    ):
        progress(plan.n_clouds)
        return finished
    with locked(out, shared=share != (0, 1)):
        claim_folder(plan, out, command)
        if (finished := read_manifest(out)) is not None:
            faults = _faults(plan, finished, out, retry_failed)
            if not faults:
                if share == (0, 1):  # else other shares may be at work
                    remove_files(out, leftover_work(out, plan))
                progress(plan.n_clouds)
                return finished
            for fault in faults:
                _LOG.warning("%s", fault)
            unfinish(out)
        began, shards = time.perf_counter(), range(share[0], len(plan.shards), share[1])

        def done(job: int, result: Any = None) -> None:
            progress(len(plan.shards[job]) * plan.clouds_per_mesh)

        if jobs := list(_unfinished(plan, out, shards, retry_failed, done)):
            (run or run_here)(GenerateTask(plan, out), jobs, done)
        return finish_dataset(plan, out, time.perf_counter() - began) if share == (0, 1) else {}


def merge(plan: Plan, out: Path) -> dict[str, Any]:
    """Finish a dataset whose shards were made by several machines; DatasetError where a shard is not done.

    Another process may do it too.
    """
    with locked(out, wait=True):
        if (finished := read_manifest(out)) is None:
            return finish_dataset(plan, out, 0.0)
        if lost := damaged(out, finished):
            raise DatasetError(
                f"{out / lost[0]} must be as it was written; it is missing or damaged. Make it again: the same "
                "`zbuf-occlude generate`, without --shard."
            )
        return finished


def _faults(plan: Plan, manifest: Mapping[str, Any], out: Path, retry_failed: bool) -> list[str]:
    """Return the reasons to make parts of a finished dataset again; DatasetError where a mesh has another size."""
    check_sources(plan.meshes, manifest, out)
    faults = [f"{out / name} is missing or damaged, and is made again" for name in damaged(out, manifest)]
    return faults + [f"{key}, which failed, is tried again" for key in manifest["failures"] if retry_failed]


def _unfinished(
    plan: Plan, out: Path, shards: Iterable[int], retry_failed: bool, done: Callable[[int], object]
) -> Iterable[int]:
    """Yield the shards that are still to be made; call `done` with the others."""
    for number in shards:
        report, fault = read_shard(plan, out, number)
        if report is not None:
            origins = {key: source.to_dict() for key, source in report.sources.items()}
            check_sources((plan.meshes[i] for i in plan.shards[number].tolist()), {"origins": origins}, out)
            if not (retry_failed and report.failures):
                done(number)
                continue
            fault = f"{next(iter(report.failures))}, which failed, is tried again"
        if fault:
            _LOG.warning("shard %d is made again: %s", number, fault)
        sidecar_path(out, number).unlink(missing_ok=True)
        yield number


def finish_dataset(plan: Plan, out: Path, seconds: float) -> dict[str, Any]:
    """Write what belongs to the whole dataset, the manifest last; return the manifest.

    Parameters
    ----------
    plan : Plan
    out : Path
    seconds : float
        Seconds in which the shards were made, for the manifest.

    Raises
    ------
    DatasetError
        A shard is not done, or no mesh has a cloud.
    """
    row, whole = find_format(plan.format), ShardReport.of_all(plan.fingerprint, read_shards(plan, out))
    if not any(whole.n_clouds.values()):
        raise DatasetError(_nothing_made(plan, whole))
    names = {split: [file.name for file in whole.files[split]] for split in plan.splits if split in whole.files}
    about = {"command": read_command(out), **build_manifest(plan, whole, seconds)}
    module = row.storage.load()
    if row.exported_from:
        return export(plan, module.read(data_folder(plan, out), plan, names), out, about)
    write_names(plan, out)
    row.finish(out, plan, names)
    shown = {split: of_split[:SHOWN] for split, of_split in names.items()}
    known = {file.name: file.sha256 for of_split in whole.files.values() for file in of_split}
    return finish_folder(plan, module.read(out, plan, shown), out, about, names, checksums(out, known, known))


def _nothing_made(plan: Plan, whole: ShardReport) -> str:
    """Return the reason why there is no cloud, and the remedy."""
    scan = plan.config.scan
    if whole.failures:
        why = next(iter(whole.failures.values()))
    else:
        blank = next(iter(whole.blank.values()))
        why = f"{blank.said}. Choose other --views" + (", --range or --size." if scan else ".")
    return f"at least one mesh must give a cloud; none of {len(plan.meshes)} did. The first failed so: {why}"


def build_manifest(plan: Plan, whole: ShardReport, seconds: float) -> dict[str, Any]:
    """Return the manifest without its files; `seconds` are those in which this run made its shards.

    ``error`` holds fractions of the checked pairs of view and point: *false_visible* (the dataset has the point, the
    oracle says hidden) and *false_hidden* (the other way round); of the checked views the share of those that are wrong
    in more than `counts.BAD_VIEW` of their checked points, and the worst. ``origins`` has the source of each mesh.
    ``clouds`` counts those in the files, ``meshes`` the meshes that have any; other counts are of all that was made,
    also of what a layout leaves out. ``blank_views`` has the meshes with views that give no cloud, ``left_out`` the
    meshes without any cloud. ``scans_of_too_few_points`` counts scans left out for `ScanConfig.least_points`.
    ``cut_by_range`` has the shares of the objects' returns beyond the sensor's limits.
    """
    counts = whole.counts
    left_out = {key: blank.said for key, blank in whole.blank.items() if blank.n_views == plan.clouds_per_mesh}
    return {
        "fingerprint": plan.fingerprint,
        "seed": plan.config.seed,
        "format": plan.format,
        "options": plan.config.to_dict(),
        "versions": versions(),
        "renderer": ", ".join(whole.renderers) or "none",
        "renderer_remark": next(filter(None, map(explain_software_fallback, whole.renderers)), ""),
        "classes": plan.classes,
        **frame_in_words(plan),
        "counts": {
            "meshes": len(plan.meshes) - len(whole.failures) - len(left_out),
            "meshes_failed": len(whole.failures),
            "views": len(plan.views),
            "variations": plan.config.variations,
            "clouds": counts.n_clouds,
            "clouds_by_split": {split: n for split in plan.splits if (n := whole.n_clouds[split])},
            "views_that_see_nothing": counts.n_blind_views,
            "scans_of_too_few_points": counts.n_sparse,
            "views_inside_the_bounding_box": counts.n_inside,
            "cameras_raised_above_the_ground": counts.n_raised,
            "clouds_with_repeated_points": counts.n_with_repeats,
            f"clouds_of_fewer_than_{FEW}_distinct_points": counts.n_few,
            "faces_dropped": dict(counts.faces_dropped),
            "meshes_without_colors": counts.n_without_colors,
            "meshes_with_far_faces": counts.n_with_far_faces,
            "meshes_without_windows": counts.n_without_windows,
        },
        "failures": dict(whole.failures),
        "blank_views": {key: blank._asdict() for key, blank in whole.blank.items()},
        "left_out": left_out,
        "cut_by_range": counts.cut,
        "origins": {key: source.to_dict() for key, source in whole.sources.items()},
        # maximum error of positions along each axis, in longest sides; that of float32 is far smaller
        "rounding": 0.5 / QUANT_LEVELS if find_format(plan.format).keeps_points else 0.0,
        "error": counts.error,
        "seconds": {"making": round(seconds, 3), "workers": round(whole.seconds, 3)},
    }


def progress_of(plan: Plan, out: Path) -> dict[str, Any]:
    """Return the progress of an unfinished dataset, as plain data for `zbuf-occlude status`."""
    found, again = list[ShardReport](), dict[str, str]()
    for number in range(len(plan.shards)):
        report, fault = read_shard(plan, out, number)
        if report is not None:
            found.append(report)
        elif fault:
            again[f"shard {number}"] = fault
    whole = ShardReport.of_all(plan.fingerprint, found)
    n_done, n_left = len(found), len(plan.shards) - len(found)
    return {
        "shards_done": n_done,
        "clouds": whole.counts.n_clouds,
        "failures": dict(whole.failures),
        "to_make_again": again,
        "worker_seconds_left": n_left * whole.seconds / n_done if n_done else None,
    }
