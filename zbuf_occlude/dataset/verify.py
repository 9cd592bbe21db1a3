"""Verify a finished dataset: checksums, counts, readability, by all workers; and a few clouds against their meshes."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.dataset.folder import checksum, read_finished
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.generate import run_here
from zbuf_occlude.dataset.jobs import Run
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.dataset.ragged import all_finite
from zbuf_occlude.dataset.verify_meshes import ask_oracle, scan_again
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.meshes.collection import MeshCollection

ASKED_FILES = 64
"""The clouds held against their meshes are of this many files, chosen at random, where there are more."""


@dataclass
class Verdict:
    """What was looked at, and what was wrong with it.

    Attributes
    ----------
    n_files, n_clouds : int
        Read whole.
    n_checked : int
        Points asked again of the oracle; 0 when the meshes were not at hand.
    false_visible : float or None
        The fraction of them that the oracle says are hidden.
    faults : list of str
        One line each; empty: the dataset is what its manifest says.
    """

    n_files: int
    n_clouds: int
    n_checked: int
    false_visible: float | None
    faults: list[str]


class Found(NamedTuple):
    """What a job found out: its faults, and the clouds that it read of each split."""

    faults: list[str]
    n_clouds: dict[str, int]


@dataclass(frozen=True)
class Verifying:
    """The task of verifying a dataset: each job is a file, its checksum and then its clouds.

    Parameters
    ----------
    plan : Plan
    out : Path
    files : mapping of split to list of file names
        As in the manifest.
    sha256 : mapping of file name to checksum
    """

    plan: Plan
    out: Path
    files: Mapping[str, list[str]]
    sha256: Mapping[str, str]

    needs_gl = False

    @cached_property
    def jobs(self) -> list[dict[str, list[str]]]:
        """For each job the files that it looks at, by split; where files hold a split whole, all of a split."""
        row = find_format(self.plan.format)
        if row.one_file:
            return [{split: names} for split, names in self.files.items()]
        jobs: dict[str, dict[str, list[str]]] = {}
        for split, names in self.files.items():
            for name in names:
                jobs.setdefault(name, {})[split] = [name]
        return list(jobs.values())

    def do(self, job: int, gl: Any = None, lost: Any = None, on_mesh: Any = None) -> Found:
        """Look at the files of a job."""
        files = self.jobs[job]
        faults = self.damaged({name for of_split in files.values() for name in of_split}, of_data=True)
        if faults:
            return Found(faults, {})
        try:
            return self._read(files)
        except DatasetError as error:  # written so, or else a checksum had told
            return Found([str(error)], {})

    def damaged(self, names: Iterable[str], *, of_data: bool = False) -> list[str]:
        """Return what is wrong with files, by their checksums."""
        faults = []
        for name in sorted(names):
            if not (self.out / name).is_file():
                faults.append(f"{name} must be there; it is missing.")
                continue
            try:
                digest = checksum(self.out, name, of_data=of_data)
            except DatasetError as error:
                faults.append(str(error))
                continue
            if digest != (expected := self.sha256.get(name, digest)):  # an earlier version's has none of lists
                faults.append(f"{name} must have the checksum {expected[:12]}...; it has {digest[:12]}...")
        return faults

    def _read(self, files: dict[str, list[str]]) -> Found:
        """Read every cloud; note what cannot be a cloud of this dataset."""
        source = find_format(self.plan.format).load().read(self.out, self.plan, files)
        faults, n_clouds = [], Counter[str]()
        for split in source.order:
            for records in source.batches(split, in_any_order=True):
                n_clouds[split] += len(records)
                if not all_finite(records["data"]):
                    faults.append(f"all positions must be finite; some of split {split} are not.")
                if "normals" in self.plan.recipe.attributes:
                    lengths = np.linalg.norm(np.concatenate(records["normal"]), axis=1)
                    if not (np.abs(lengths - 1.0) < 1e-3).all():
                        faults.append(f"all normals must be of length 1; some of split {split} are not.")
                if records["n_visible"].min() < 1:
                    faults.append(f"every cloud must come from a visible point; some of split {split} do not.")
        return Found(faults, dict(n_clouds))


def verify(
    out: Path,
    meshes: MeshCollection | None,
    *,
    n_samples: int = 50,
    run: Run | None = None,
    part: tuple[int, int] = (0, 1),
    progress: Callable[[int], None] = lambda n: None,
) -> Verdict:
    """Check a finished dataset against its manifest and, where its meshes are at hand, against the oracle.

    Parameters
    ----------
    out : Path
    meshes : MeshCollection or None
        With the keys of the dataset's meshes; None leaves the oracle out.
    n_samples : int
        Clouds asked again of the oracle, chosen at random by the dataset's seed.
    run : callable, optional
        The engine; `run_here`, in this process, by default.
    part : (int, int)
        (i, n): look at every n-th file only, from the i-th on; the number of clouds is then not compared.
    progress : callable
        Told the number of clouds read, as they are read.

    Raises
    ------
    DatasetError
        There is no finished dataset in the folder.
    """
    plan, manifest = read_finished(out)
    task = Verifying(plan, out, manifest["files"], manifest["sha256"])
    data = {name for of_split in task.files.values() for name in of_split}
    found: dict[int, Found] = {-1: Found(task.damaged(manifest["sha256"].keys() - data), {})}

    def done(job: int, result: Found) -> tuple[int, ...]:
        found[job] = result
        progress(sum(result.n_clouds.values()))
        return ()

    jobs = task.jobs
    mine = list(range(part[0], len(jobs), part[1]))
    if mine:
        (run or run_here)(task, mine, done)
    faults = list(dict.fromkeys(fault for job in sorted(found) for fault in found[job].faults))
    n_clouds = sum((Counter(each.n_clouds) for each in found.values()), Counter[str]())
    if part == (0, 1) and not faults:
        for split, expected in manifest["counts"]["clouds_by_split"].items():
            if n_clouds[split] != expected:
                faults.append(f"split {split} must have {expected} clouds; it has {n_clouds[split]}.")
    n_checked, rate = 0, None
    if mine and not faults and meshes is not None:
        files: dict[str, list[str]] = {}
        chosen = np.random.default_rng(plan.recipe.seed).permutation(mine)[:ASKED_FILES]
        for job in sorted(chosen.tolist()):
            for split, names in jobs[job].items():
                files.setdefault(split, []).extend(names)
        source = find_format(plan.format).load().read(out, plan, files)
        if plan.recipe.setup is None:
            n_checked, rate = ask_oracle(source, plan, manifest, meshes, n_samples, faults)
        elif not plan.recipe.complete:  # whole objects are no scans
            n_checked = scan_again(source, plan, meshes, n_samples, faults)
    names = {name for job in mine for of_split in jobs[job].values() for name in of_split}
    return Verdict(len(names), sum(n_clouds.values()), n_checked, rate, faults)
