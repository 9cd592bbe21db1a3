"""Verify a finished dataset: checksums, counts, readability, by all workers; and a few clouds against their meshes."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.dataset.folder import checksum, read_finished
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.generate import run_here
from zbuf_occlude.dataset.jobs import Run
from zbuf_occlude.dataset.plan import CLOUDS_PER_FILE, Plan
from zbuf_occlude.dataset.ragged import all_finite
from zbuf_occlude.dataset.source import Source
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


class Look(NamedTuple):
    """What a job looks at.

    Parameters
    ----------
    names : list of str
        Files whose checksums are compared.
    files : mapping of split to list of file names
        Those that clouds are then read of.
    share : (int, int)
        (i, n): the i-th of n runs of these clouds.
    """

    names: list[str]
    files: Mapping[str, list[str]]
    share: tuple[int, int] = (0, 1)


@dataclass(frozen=True)
class Verifying:
    """The task of verifying a dataset: each job is a file, its checksum and then its clouds.

    Of files that hold a split whole others make the checksums, and each job reads some of their clouds.

    Parameters
    ----------
    plan : Plan
    out : Path
    files : mapping of split to list of file names
        As in the manifest.
    n_clouds : mapping of split to int
    sha256 : mapping of file name to checksum
    """

    plan: Plan
    out: Path
    files: Mapping[str, list[str]]
    n_clouds: Mapping[str, int]
    sha256: Mapping[str, str]
    _opened: dict[tuple[str, ...], Source] = field(default_factory=dict, init=False, repr=False)

    needs_gl = False

    @cached_property
    def jobs(self) -> list[Look]:
        """What each job looks at."""
        by_name: dict[str, dict[str, list[str]]] = {}
        for split, names in self.files.items():
            for name in names:
                by_name.setdefault(name, {})[split] = [name]
        if not find_format(self.plan.format).one_file:
            return [Look([name], files) for name, files in by_name.items()]
        runs = {split: -(-n // CLOUDS_PER_FILE) for split, n in self.n_clouds.items()}
        readings = [Look([], {split: self.files[split]}, (i, n)) for split, n in runs.items() for i in range(n)]
        return [*(Look([name], {}) for name in by_name), *readings]

    def do(self, job: int, gl: Any = None, lost: Any = None, on_mesh: Any = None) -> Found:
        """Look at the files of a job."""
        names, files, share = self.jobs[job]
        if faults := self.damaged(names, of_data=True):
            return Found(faults, {})
        try:
            return self._read(files, share) if files else Found([], {})
        except DatasetError as error:  # written so, or else a checksum tells
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

    def _read(self, files: Mapping[str, list[str]], share: tuple[int, int]) -> Found:
        """Read every cloud of a share; note what cannot be a cloud of this dataset."""
        source = self._open(files)
        faults, n_clouds = [], Counter[str]()
        for split, numbers in source.order.items():
            begin, end = (i * len(numbers) // share[1] for i in (share[0], share[0] + 1))
            for records in replace(source, order={split: numbers[begin:end]}).batches(split, in_any_order=True):
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

    def _open(self, files: Mapping[str, list[str]]) -> Source:
        """Return the clouds of some files, which are opened once by whoever reads one run of them after the other."""
        key = tuple(name for names in files.values() for name in names)
        if key not in self._opened:
            self._opened.clear()
            self._opened[key] = find_format(self.plan.format).load().read(self.out, self.plan, dict(files))
        return self._opened[key]


def verify(
    out: Path,
    meshes: MeshCollection | None,
    *,
    n_samples: int = 50,
    run: Run | None = None,
    share: tuple[int, int] = (0, 1),
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
    share : (int, int)
        (i, n): look at every n-th file only, from the i-th on; the number of clouds is then not compared.
    progress : callable
        Told the number of clouds read, as they are read.

    Raises
    ------
    DatasetError
        There is no finished dataset in the folder.
    """
    plan, manifest = read_finished(out)
    task = Verifying(plan, out, manifest["files"], manifest["counts"]["clouds_by_split"], manifest["sha256"])
    data = {name for of_split in task.files.values() for name in of_split}
    found: dict[int, Found] = {-1: Found(task.damaged(manifest["sha256"].keys() - data), {})}

    def done(job: int, result: Found) -> tuple[int, ...]:
        found[job] = result
        progress(sum(result.n_clouds.values()))
        return ()

    jobs = task.jobs
    mine = list(range(share[0], len(jobs), share[1]))
    if mine:
        (run or run_here)(task, mine, done)
    faults = list(dict.fromkeys(fault for job in sorted(found) for fault in found[job].faults))
    n_clouds = sum((Counter(each.n_clouds) for each in found.values()), Counter[str]())
    if share == (0, 1) and not faults:
        for split, expected in manifest["counts"]["clouds_by_split"].items():
            if n_clouds[split] != expected:
                faults.append(f"split {split} must have {expected} clouds; it has {n_clouds[split]}.")
    n_checked, rate = 0, None
    if mine and not faults and meshes is not None:
        source = find_format(plan.format).load().read(out, plan, _some_files([jobs[job] for job in mine], plan))
        if plan.recipe.setup is None:
            n_checked, rate = ask_oracle(source, plan, manifest, meshes, n_samples, faults)
        elif not plan.recipe.complete:  # whole objects are no scans
            n_checked = scan_again(source, plan, meshes, n_samples, faults)
    names = {name for job in mine for name in jobs[job].names}
    return Verdict(len(names), sum(n_clouds.values()), n_checked, rate, faults)


def _some_files(looks: list[Look], plan: Plan) -> dict[str, list[str]]:
    """Choose the files of which clouds are held against their meshes, by split."""
    read = {tuple(name for names in look.files.values() for name in names): look.files for look in looks if look.files}
    distinct, files = list(read.values()), dict[str, list[str]]()
    for i in sorted(np.random.default_rng(plan.recipe.seed).permutation(len(distinct))[:ASKED_FILES].tolist()):
        for split, names in distinct[i].items():
            files.setdefault(split, []).extend(names)
    return files
