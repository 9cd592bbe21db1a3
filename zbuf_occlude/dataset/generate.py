"""Generate a dataset in a folder: batches of meshes are made, and the files of each group written when its batches are.

    for job, result in workers.do(todo):                # ("batch", 17) or ("file", 3)
        todo.extend_first(schedule.done(job, result))   # the files of a group that is complete; its record at its end

The same call again resumes: a batch is done when its file is in the work folder, a group when its record is there.
"""

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from zbuf_occlude.dataset.batch import Batch, Named, batch_path, clouds_of_file, make_batch, read_batch
from zbuf_occlude.dataset.export import export_here, stored_plan
from zbuf_occlude.dataset.folder import (
    MANIFEST,
    STORED,
    claim,
    locked,
    read_manifest,
    remove,
    remove_work,
    sha256_of,
)
from zbuf_occlude.dataset.formats import PACKED, find_format
from zbuf_occlude.dataset.group import Group, check_origins, group_path, read_group, worth_another_try
from zbuf_occlude.dataset.manifest import finish
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.limits import GivenUp, Limits
from zbuf_occlude.provenance import Origin
from zbuf_occlude.visibility import find_method
from zbuf_occlude.workers import Run, run_here

_LOG = logging.getLogger(__name__)

Job = tuple[Literal["batch", "file"], int]


@dataclass(frozen=True)
class Making:
    """The task of making a dataset.

    Parameters
    ----------
    plan : Plan
    out : Path
    needs_gl : bool
        Whether batches are made, and their method renders.
    """

    plan: Plan
    out: Path
    needs_gl: bool

    def do(
        self,
        job: Job,
        gl: Any,
        lost: Mapping[int, GivenUp] = MappingProxyType({}),
        on_mesh: Callable[[int | None], None] = lambda mesh_id: None,
    ) -> Named | None:
        """Make a batch, or write a file; return the file, None of one that no cloud is for."""
        what, number = job
        if what == "batch":
            make_batch(self.plan, number, self.out, gl, lost=lost, on_mesh=on_mesh)
            return None
        return write_file(self.plan, number, self.out)


def write_file(plan: Plan, number: int, out: Path) -> Named | None:
    """Write a final file from the batches of its group; nothing where no cloud is for it.

    Raises
    ------
    DatasetError
        A batch is missing or damaged.
    """
    file, module = plan.files[number], find_format(plan.format).load()
    records = clouds_of_file(plan, out, number)
    if not len(records):
        return None
    path = out / module.file_name(file.split, file.number)
    module.write(path, records, plan, file.number)
    return Named(path.name, path.stat().st_size, sha256_of(path))


class Schedule:
    """What is still to be done in a dataset's folder.

    Parameters
    ----------
    plan : Plan
    out : Path
    groups : range
        Those to be made here.
    limits : Limits
        Failures within narrower limits are tried again.
    on_batch, on_file : callable
        Called with the number of clouds planned in each batch that is done, and with 1 for each file that is written;
        at once for those of a run before.

    Attributes
    ----------
    todo : list of Job
        The jobs to begin with.
    made : float
        `time.perf_counter()` when the last batch was done.

    Raises
    ------
    DatasetError
        A mesh is another than what its clouds were made of.
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
        self._has_files = plan.format != PACKED
        self._batches_left, self._files_left = dict[int, int](), dict[int, int]()
        self._written: dict[int, Named] = {}
        self.todo: list[Job] = []
        self.made = time.perf_counter()
        for group in groups:
            if self._is_done(group):
                self._progress(plan.batches.of_groups[group])
                on_file(len(plan.files.of_group(group)) * self._has_files)
                continue
            missing = [batch for batch in plan.batches.of_groups[group] if not self._is_made(batch)]
            self._batches_left[group] = len(missing)
            self.todo += [("batch", batch) for batch in missing] or self._files_of(group)

    def done(self, job: Job, result: Named | None) -> list[Job]:
        """Take note of a job that is done; return the jobs that can be done now."""
        what, number = job
        if what == "file":
            return self._file_written(number, result)
        self._progress(range(number, number + 1))
        self.made = time.perf_counter()
        group = self.plan.batches.group_of(number)
        self._batches_left[group] -= 1
        return [] if self._batches_left[group] else self._files_of(group)

    def _files_of(self, group: int) -> list[Job]:
        """Return the jobs of a group whose batches are all made."""
        files = list(self.plan.files.of_group(group)) if self._has_files else []
        self._files_left[group] = len(files)
        if not files:
            self._record(group)
        return [("file", file) for file in files]

    def _file_written(self, number: int, file: Named | None) -> list[Job]:
        if file is not None:
            self._written[number] = file
        self._on_file(1)
        group = self.plan.files[number].group
        self._files_left[group] -= 1
        if not self._files_left[group]:
            self._record(group)
        return []

    def _record(self, group: int) -> None:
        """Write the record of a group, whose files are written; its batches are not needed any more."""
        plan, found, files = self.plan, list[Batch](), dict[str, list[Named]]()
        for number in plan.batches.of_groups[group]:
            batch, fault = read_batch(plan, self.out, number)
            if batch is None:
                raise DatasetError(f"batch {number} of {self.out} must be done; it is not{fault and f': {fault}'}.")
            found.append(batch)
            for split in batch.n_clouds if batch.archive is not None else ():
                files.setdefault(split, []).append(batch.archive)  # type: ignore[arg-type]  # not None
        for number in plan.files.of_group(group):
            if number in self._written:
                files.setdefault(plan.files[number].split, []).append(self._written.pop(number))
        Group.of_batches(plan, found, files).write(self.out, group)
        for number in plan.batches.of_groups[group]:
            batch_path(self.out, number).unlink(missing_ok=True)

    def _progress(self, batches: range) -> None:
        self._on_batch(sum(len(self.plan.batches[i]) for i in batches) * self.plan.clouds_per_mesh)

    def _is_done(self, number: int) -> bool:
        group, fault = read_group(self.plan, self.out, number)
        if group is not None:
            mesh_ids = self.plan.groups[number].tolist()
            check_origins([self.plan.meshes[i] for i in mesh_ids], group.made, self.out)
            again = worth_another_try(self.plan, mesh_ids, group, self._limits)
            fault = f"{again[0]}, which failed, is tried again" if again else ""
        if fault:
            _LOG.warning("group %d is made again: %s", number, fault)
            group_path(self.out, number).unlink(missing_ok=True)
        return group is not None and not fault

    def _is_made(self, number: int) -> bool:
        batch, fault = read_batch(self.plan, self.out, number, closely=True)
        if batch is not None:
            mesh_ids = self.plan.batches[number]
            made = {key: origin for key, origin in batch.origins.items() if key not in batch.failures}
            check_origins([self.plan.meshes[i] for i in mesh_ids], made, self.out)
            again = worth_another_try(self.plan, mesh_ids, batch, self._limits)
            fault = f"{again[0]}, which failed, is tried again" if again else ""
        if fault:
            _LOG.warning("batch %d is made again: %s", number, fault)
        if batch is not None and not fault:
            self._progress(range(number, number + 1))
        return batch is not None and not fault


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
    row = find_format(plan.format)
    row.check(plan)
    if overwrite:
        remove(out)
    claim(plan, out)
    began, limits = time.perf_counter(), limits or Limits()
    if (finished := read_manifest(out)) is not None:
        if is_sound(plan, finished, out, limits):
            progress(plan.n_clouds)
            remove_work(out, plan)
            return finished
        (out / MANIFEST).unlink()
    if row.exported_from:
        stored = generate(
            stored_plan(plan), out / STORED, run=run, share=share, limits=limits, progress=progress, written=written
        )
        return export_here(plan, out, stored) if share == (0, 1) else {}
    groups = range(share[0], len(plan.groups), share[1])
    with locked(out, groups):
        schedule = Schedule(plan, out, groups, limits, progress, written)
        if schedule.todo:
            makes_meshes = any(what == "batch" for what, _ in schedule.todo)
            needs_gl = makes_meshes and find_method(plan.recipe.method).needs_gl
            (run or run_here)(Making(plan, out, needs_gl), list(schedule.todo), schedule.done)
    if share != (0, 1):
        return {}
    return finish(plan, out, {"making": schedule.made - began, "writing": time.perf_counter() - schedule.made})


def merge(plan: Plan, out: Path) -> dict[str, Any]:
    """Finish a dataset whose groups were made by several machines: names, lists, picture, manifest, which is returned.

    Raises
    ------
    DatasetError
        A group is not done, a mesh has changed since it was used, or no mesh has a cloud.
    """
    if (finished := read_manifest(out)) is not None:
        return finished
    with locked(out, range(1), wait=True):
        if (finished := read_manifest(out)) is not None:  # another was faster
            return finished
        if not find_format(plan.format).exported_from:
            return finish(plan, out, {})
        stored = stored_plan(plan)
        return export_here(plan, out, read_manifest(out / STORED) or finish(stored, out / STORED, {}))


def is_sound(plan: Plan, manifest: Mapping[str, Any], out: Path, limits: Limits) -> bool:
    """Whether a finished dataset is what its plan would give now, as far as that shows without reading its files.

    Raises
    ------
    DatasetError
        A mesh is another than what its clouds were made of.
    """
    if lost := next((name for name in sorted(manifest["sha256"]) if not (out / name).exists()), None):
        _LOG.warning("%s is missing, and is made again", out / lost)
        return False
    made = {key: Origin.from_document(document) for key, document in manifest.get("origins", {}).items()}
    check_origins(plan.meshes, made, out)
    for entry in plan.meshes:
        if (tried := manifest.get("tries", {}).get(entry.key)) is not None:
            wider = tried["limits"] is not None and limits.allow_more_than(Limits(*tried["limits"]))
            if wider or entry.origin_of_failure() != Origin.from_document(tried["origin"]):
                _LOG.warning("%s, which failed, is tried again", entry.key)
                return False
    return True


def progress_of(plan: Plan, out: Path) -> dict[str, Any]:
    """Return how far a dataset is that is not finished, as plain data for `zbuf-occlude status`."""
    if find_format(plan.format).exported_from:
        return progress_of(stored_plan(plan), out / STORED)
    n_batches = n_groups = n_clouds = 0
    seconds, failures, again = 0.0, dict[str, str](), dict[str, str]()
    for number, batches in enumerate(plan.batches.of_groups):
        group, fault = read_group(plan, out, number)
        if group is not None:
            n_groups += 1
            found: list[tuple[int, Batch | Group]] = [(len(batches), group)]
        else:
            made = [(batch, *read_batch(plan, out, batch)) for batch in batches]
            found = [(1, batch) for _, batch, _ in made if batch is not None]
            again |= {f"batch {i}": fault for i, _, fault in made if fault} | (
                {f"group {number}": fault} if fault else {}
            )
        for n, each in found:
            n_batches, n_clouds, seconds = n_batches + n, n_clouds + each.counts.n_clouds, seconds + each.seconds
            failures |= each.failures
    return {
        "batches_done": n_batches,
        "groups_done": n_groups,
        "clouds": n_clouds,
        "failures": failures,
        "to_make_again": again,
        "worker_seconds_left": (len(plan.batches) - n_batches) * seconds / n_batches if n_batches else None,
    }
