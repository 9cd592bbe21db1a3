"""Generate a dataset in a folder: batches of meshes are made, and the files of each group written when its batches are.

    for job, result in workers.do(todo):                # ("batch", 17) or ("file", 3)
        todo.extend_first(schedule.done(job, result))   # the files of a group that is complete; its record at its end

The same call again resumes: a batch is done when its file is in the work folder, a group when its record is there. The
manifest, written last, says how the dataset was made, what failed and how wrong it is.
"""

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.batch import (
    BatchReport,
    FileDigest,
    batch_path,
    check_origins,
    clouds_of_file,
    group_path,
    make_batch,
    read_groups,
    read_outcome,
    should_retry,
)
from zbuf_occlude.dataset.counts import FEW
from zbuf_occlude.dataset.export import export_here, frame_in_words, stored_plan
from zbuf_occlude.dataset.folder import (
    CONTACT_SHEET,
    MANIFEST,
    STORED,
    checksums,
    claim_folder,
    contains_plan,
    damaged,
    locked,
    read_manifest,
    removable,
    remove,
    remove_work,
    sizes,
    unfinish,
    write_names,
)
from zbuf_occlude.dataset.formats import PACKED, find_format
from zbuf_occlude.dataset.gallery import write_contact_sheet
from zbuf_occlude.dataset.packed import QUANT_LEVELS
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.gl.devices import explain_software_fallback
from zbuf_occlude.limits import GivenUp, Limits
from zbuf_occlude.provenance import MeshSource, versions
from zbuf_occlude.visibility import find_method
from zbuf_occlude.workers import Run, run_here

SHOWN = 16
"""The picture is drawn of the clouds of at most this many files."""

_LOG = logging.getLogger(__name__)

Job = tuple[Literal["batch", "file"], int]


@dataclass(frozen=True)
class GenerateTask:
    """The task of making a dataset; `needs_gl` where batches are made, and their method renders."""

    plan: Plan
    out: Path
    needs_gl: bool

    def do(
        self,
        job: Job,
        gl: Any,
        lost: Mapping[int, GivenUp] = MappingProxyType({}),
        on_mesh: Callable[[int | None], None] = lambda mesh_id: None,
    ) -> FileDigest | None:
        """Make a batch, or write a file; return the file, None of one that no cloud is for."""
        what, number = job
        if what == "batch":
            make_batch(self.plan, number, self.out, gl, lost=lost, on_mesh=on_mesh)
            return None
        return write_file(self.plan, number, self.out)


def write_file(plan: Plan, number: int, out: Path) -> FileDigest | None:
    """Write a final file, if it has clouds, from its group's batches; DatasetError where one is missing or damaged."""
    file, module = plan.files[number], find_format(plan.format).load()
    records = clouds_of_file(plan, out, number)
    if not len(records):
        return None
    path = out / module.file_name(file.split, file.number)
    module.write(path, records, plan, file.number)
    return FileDigest.of(path)


class Schedule:
    """What is still to be done in a dataset's folder, of some groups.

    `todo` has the jobs to begin with. `on_batch` is called with the number of clouds planned in each batch that is
    done, and `on_file` with 1 for each file that is written; at once for those of a run before.
    """

    def __init__(
        self,
        plan: Plan,
        out: Path,
        groups: range,
        limits: Limits,
        on_batch: Callable[[int], None],
        on_file: Callable[[int], None],
    ) -> None:
        self.plan, self.out, self._limits = plan, out, limits
        self._on_batch, self._on_file = on_batch, on_file
        self._files_of = plan.files_of if plan.format != PACKED else [range(0)] * len(plan.groups)
        self._left = dict[int, int]()
        self._written = dict[int, FileDigest]()
        self.todo: list[Job] = []
        self.made = time.perf_counter()
        for group in groups:
            if self._is_done(f"group {group}", group_path(out, group), plan.groups[group].tolist(), closely=False):
                on_batch(len(plan.groups[group]) * plan.clouds_per_mesh)
                on_file(len(self._files_of[group]))
                continue
            group_path(out, group).unlink(missing_ok=True)
            missing: list[Job] = []
            for number in plan.batches_of[group]:
                mesh_ids = plan.batches[number].mesh_ids
                if self._is_done(f"batch {number}", batch_path(out, number), mesh_ids, closely=True):
                    on_batch(len(mesh_ids) * plan.clouds_per_mesh)
                else:
                    missing.append(("batch", number))
            self._left[group] = len(missing)
            self.todo += missing or self._begin_files(group)

    def done(self, job: Job, result: FileDigest | None) -> list[Job]:
        """Take note of a job that is done; return the jobs that can be done now."""
        what, number = job
        if what == "batch":
            group, mesh_ids = self.plan.batches[number]
            self._on_batch(len(mesh_ids) * self.plan.clouds_per_mesh)
            self.made = time.perf_counter()
        else:
            group = self.plan.files[number].group
            self._on_file(1)
            if result is not None:
                self._written[number] = result
        self._left[group] -= 1
        if self._left[group]:
            return []
        if what == "batch":
            return self._begin_files(group)
        self._record(group)
        return []

    def _begin_files(self, group: int) -> list[Job]:
        """Return the jobs of a group whose batches are all made; without any, the group is done."""
        files = self._files_of[group]
        self._left[group] = len(files)
        if not files:
            self._record(group)
        return [("file", file) for file in files]

    def _record(self, group: int) -> None:
        """Write the record of a group, whose files are written; its batches are not needed any more."""
        plan, batches, files = self.plan, list[BatchReport](), dict[str, list[FileDigest]]()
        for number in plan.batches_of[group]:
            batch, fault = read_outcome(plan, batch_path(self.out, number))
            if batch is None:
                raise DatasetError(f"batch {number} of {self.out} must be done; it is not{fault and f': {fault}'}.")
            batches.append(batch)
        for number in self._files_of[group]:
            if number in self._written:
                files.setdefault(plan.files[number].split, []).append(self._written.pop(number))
        BatchReport.of_all(plan.fingerprint, batches, files).write(group_path(self.out, group), synced=True)
        for number in plan.batches_of[group]:
            batch_path(self.out, number).unlink(missing_ok=True)

    def _is_done(self, what: str, path: Path, mesh_ids: list[int], *, closely: bool) -> bool:
        """Whether a batch or group is there, whole, and none of its failures is worth another try."""
        outcome, fault = read_outcome(self.plan, path, closely=closely)
        if outcome is not None:
            entries = [self.plan.meshes[i] for i in mesh_ids]
            check_origins(entries, outcome.made, self.out)
            again = [
                entry.key
                for entry in entries
                if entry.key in outcome.failures
                and should_retry(entry, outcome.origins[entry.key], outcome.given_up.get(entry.key), self._limits)
            ]
            fault = f"{again[0]}, which failed, is tried again" if again else ""
        if fault:
            _LOG.warning("%s is made again: %s", what, fault)
        return outcome is not None and not fault


def generate(
    plan: Plan,
    out: Path,
    *,
    run: Run | None = None,
    overwrite: bool = False,
    share: tuple[int, int] = (0, 1),
    limits: Limits | None = None,
    progress: Callable[[int], None] = lambda clouds: None,
    written: Callable[[int], None] = lambda files: None,
) -> dict[str, Any]:
    """Make the dataset of a plan in a folder.

    Parameters
    ----------
    plan : Plan
    out : Path
        Made when missing. A folder with the same plan is resumed: what is done is not made again.
    run : callable, optional
        Who does the jobs; `run_here`, in this process, by default.
    overwrite : bool
        Remove a dataset that is in the folder first; with anything else in it, nothing is removed and it is an error.
    share : (int, int)
        (i, n): make only the groups of the i-th (from 0) of n machines; `merge` finishes the dataset when all are done.
    limits : Limits, optional
        Those that `run` keeps: a mesh that failed within narrower ones is tried again.
    progress : callable
        Called with the number of clouds planned in each batch that is done, those of a run before at once.
    written : callable
        Called with the number of files that are written, likewise.

    Returns
    -------
    dict
        The manifest; of a share of the dataset, {}.

    Raises
    ------
    DatasetError
        The folder holds another plan's dataset, or files that are not a dataset, or another run is making it; a mesh is
        another than what its clouds were made of; no mesh could be used.
    GlError
        The method needs GL and there is none.
    OptionError, UnavailableError
        The format cannot hold such a plan, or not here.
    """
    row, limits = find_format(plan.format), limits or Limits()
    row.check(plan)
    groups = range(share[0], len(plan.groups), share[1])
    if overwrite and removable(out):
        with locked(out):
            remove(out)
    elif (
        contains_plan(plan, out)
        and (finished := read_manifest(out)) is not None
        and not _faults(plan, finished, out, limits)
    ):
        progress(plan.n_clouds)
        remove_work(out, plan)
        return finished
    with locked(out, None if share == (0, 1) else groups):
        claim_folder(plan, out)
        if (finished := read_manifest(out)) is not None:
            faults = _faults(plan, finished, out, limits)
            if not faults:  # another run has just ended
                return finished
            for fault in faults.values():
                _LOG.warning("%s", fault)
            unfinish(out)
            for name in faults.keys() & finished["sha256"].keys():
                (out / name).unlink(missing_ok=True)
        if row.exported_from:
            stored = generate(
                stored_plan(plan), out / STORED, run=run, share=share, limits=limits, progress=progress, written=written
            )
            return export_here(plan, out, stored) if share == (0, 1) else {}
        began, schedule = time.perf_counter(), Schedule(plan, out, groups, limits, progress, written)
        if schedule.todo:
            makes_meshes = any(what == "batch" for what, _ in schedule.todo)
            needs_gl = makes_meshes and find_method(plan.recipe.method).needs_gl
            (run or run_here)(GenerateTask(plan, out, needs_gl), list(schedule.todo), schedule.done)
        if share != (0, 1):
            return {}
        return finish(plan, out, {"making": schedule.made - began, "writing": time.perf_counter() - schedule.made})


def merge(plan: Plan, out: Path) -> dict[str, Any]:
    """Finish a dataset whose groups were made by several machines; DatasetError where a group is not done.

    Another process may do it too.
    """
    with locked(out, wait=True):
        if (finished := read_manifest(out)) is not None:
            if lost := damaged(out, finished):
                raise DatasetError(
                    f"{out / lost[0]} must be as it was written; it is missing or damaged. Make it again: the same "
                    "`zbuf-occlude generate`, without --shard."
                )
            return finished
        if not find_format(plan.format).exported_from:
            return finish(plan, out, {})
        stored = stored_plan(plan)
        return export_here(plan, out, read_manifest(out / STORED) or finish(stored, out / STORED, {}))


def _faults(plan: Plan, manifest: Mapping[str, Any], out: Path, limits: Limits) -> dict[str, str]:
    """Say of files and meshes of a finished dataset, by name, why they are made again.

    A mesh that is not what its clouds were made of is a DatasetError.
    """
    found = {name: f"{out / name} is missing or damaged, and is made again" for name in damaged(out, manifest)}
    made = {key: MeshSource.from_dict(document) for key, document in manifest.get("origins", {}).items()}
    check_origins(plan.meshes, made, out)
    for entry in plan.meshes:
        if (tried := manifest.get("tries", {}).get(entry.key)) is not None:
            given_up = None if tried["limits"] is None else Limits(*tried["limits"])
            if should_retry(entry, MeshSource.from_dict(tried["origin"]), given_up, limits):
                found[entry.key] = f"{entry.key}, which failed, is tried again"
    return found


def finish(plan: Plan, out: Path, seconds: Mapping[str, float]) -> dict[str, Any]:
    """Write what belongs to the whole dataset, the manifest last; return the manifest.

    Raises
    ------
    DatasetError
        A group is not done, a mesh has changed since it was used, or no mesh has a cloud.
    """
    began, module = time.perf_counter(), find_format(plan.format).load()
    whole = BatchReport.of_all(plan.fingerprint, list(read_groups(plan, out)), {})
    check_origins(plan.meshes, whole.made, out)
    if not any(whole.n_clouds.values()):
        raise DatasetError(_nothing_made(plan, whole))
    names = {split: [file.name for file in whole.files[split]] for split in plan.splits if split in whole.files}
    known = {file.name: file.sha256 for of_split in whole.files.values() for file in of_split}
    write_names(plan, out)
    getattr(module, "finish", lambda *arguments: None)(out, plan, names)
    shown = {split: of_split[:SHOWN] for split, of_split in names.items()}
    write_contact_sheet(out / CONTACT_SHEET, module.read(out, plan, shown))
    document = {
        **build_manifest(plan, whole, {**seconds, "finishing": time.perf_counter() - began}),
        "files": names,
        "sha256": (sha256 := checksums(out, known, known)),
        "bytes": sizes(out, sha256),
    }
    document["counts"]["clouds_by_split"] = {split: whole.n_clouds[split] for split in names}
    atomic.write_json(out / MANIFEST, document)
    remove_work(out, plan)
    return document


def _nothing_made(plan: Plan, whole: BatchReport) -> str:
    """Say why there is no cloud, and what to do."""
    setup = plan.recipe.setup
    if whole.failures:
        why = next(iter(whole.failures.values()))
    else:
        blank = next(iter(whole.blank.values()))
        why = f"{blank.said}. Choose other --views" + (", --range or --size." if setup else ".")
    return f"at least one mesh must give a cloud; none of {len(plan.meshes)} did. The first failed so: {why}"


def build_manifest(plan: Plan, whole: BatchReport, seconds: Mapping[str, float]) -> dict[str, Any]:
    """Return the manifest, but for what it says of files; `seconds` are of the steps of this run.

    ``error`` holds fractions of the checked pairs of view and point: *false_visible* (the dataset has the point, the
    oracle says hidden) and *false_hidden* (the other way round); of the checked views the share of those that are wrong
    in more than `counts.BAD_VIEW` of their checked points, and the worst. ``origins`` says what each mesh was made of,
    ``stacked`` how much of the surface has another sheet nearer than the method's tolerance, ``tries`` what was there
    of those that failed, and the limits they had. ``blank_views`` has the meshes of which views give no cloud,
    ``left_out`` those without any, ``cut_by_range`` the shares of the objects' returns beyond the sensor's limits.
    """
    counts = whole.counts
    return {
        "fingerprint": plan.fingerprint,
        "seed": plan.recipe.seed,
        "format": plan.format,
        "options": plan.document["recipe"],
        "versions": versions(),
        "renderer": ", ".join(whole.renderers) or "none",
        "renderer_remark": next(filter(None, map(explain_software_fallback, whole.renderers)), ""),
        "classes": plan.classes,
        **frame_in_words(plan),
        "counts": {
            "meshes": len(plan.meshes),
            "meshes_failed": len(whole.failures),
            "views": len(plan.views),
            "variations": plan.recipe.variations,
            "clouds": counts.n_clouds,
            "views_that_see_nothing": counts.n_blind_views,
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
        "tries": {
            key: {
                "origin": whole.origins[key].to_dict(),
                "limits": whole.given_up[key].to_dict() if key in whole.given_up else None,
            }
            for key in whole.failures
        },
        "blank_views": {key: blank._asdict() for key, blank in whole.blank.items()},
        "left_out": {key: blank.said for key, blank in whole.blank.items() if blank.n_views == plan.clouds_per_mesh},
        "cut_by_range": counts.cut,
        "origins": {key: origin.to_dict() for key, origin in whole.made.items()},
        # how far positions may be off along each axis, in longest sides; float32 alone is nothing beside it
        "rounding": 0.5 / QUANT_LEVELS if find_format(plan.format).keeps_points else 0.0,
        "error": counts.error,
        "stacked": counts.stacked,
        "seconds": {
            **{name: round(value, 3) for name, value in seconds.items()},
            "workers": round(whole.seconds, 3),
        },
    }


def progress_of(plan: Plan, out: Path) -> dict[str, Any]:
    """Return how far a dataset is that is not finished, as plain data for `zbuf-occlude status`."""
    if find_format(plan.format).exported_from:
        return progress_of(stored_plan(plan), out / STORED)
    n_batches = n_groups = 0
    found, again = list[BatchReport](), dict[str, str]()
    for number, batches in enumerate(plan.batches_of):
        group, fault = read_outcome(plan, group_path(out, number))
        if group is not None:
            n_batches, n_groups = n_batches + len(batches), n_groups + 1
            found.append(group)
            continue
        again |= {f"group {number}": fault} if fault else {}
        for i in batches:
            batch, fault = read_outcome(plan, batch_path(out, i))
            again |= {f"batch {i}": fault} if fault else {}
            if batch is not None:
                n_batches += 1
                found.append(batch)
    whole = BatchReport.of_all(plan.fingerprint, found, {})
    return {
        "batches_done": n_batches,
        "groups_done": n_groups,
        "clouds": whole.counts.n_clouds,
        "failures": dict(whole.failures),
        "to_make_again": again,
        "worker_seconds_left": (len(plan.batches) - n_batches) * whole.seconds / n_batches if n_batches else None,
    }
