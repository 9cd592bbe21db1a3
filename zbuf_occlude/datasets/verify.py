"""Verify a finished dataset: checksums, counts, readability, by all workers; and a few clouds against their meshes.

The oracle tests points of occluded clouds, scans are made again, and complete clouds are compared with samples of the
whole surface.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.errors import DatasetError, MeshError, OptionError
from zbuf_occlude.base.limits import Limits
from zbuf_occlude.base.provenance import MeshSource, seed_of
from zbuf_occlude.datasets.folder import read_finished, sha256_of
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.datasets.pipeline import samplings
from zbuf_occlude.datasets.plan import Plan
from zbuf_occlude.datasets.records import Records, gather_clouds, object_positions, stored_bounds
from zbuf_occlude.datasets.source import CloudReader
from zbuf_occlude.datasets.workers import Run, run_here
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.meshes.sampling import SurfacePoints, sample_surface
from zbuf_occlude.sensors.capture import in_metres

ASKED_FILES = 64
"""Maximum number of files, chosen at random, whose clouds are checked against their meshes."""
POINTS_PER_CLOUD = 64
"""Number of points of each checked cloud that the oracle checks."""
ROUNDING = 0.002
"""Fraction of false visible points that the rounding of positions may add outside the boundary band."""
DEVIATIONS = 5.0
"""Number of standard deviations that a measured fraction may exceed the manifest's by."""
SURFACE_POINTS, CHANCE = 20_000, 1e-9
"""Size of the sample of the whole surface, and the probability of a false alarm for each axis of a complete cloud."""
OFF_SURFACE = 1e-5
"""Distance of a point from its face that the rounding of float32 explains, in longest sides."""


@dataclass
class Verdict:
    """Result of a verification."""

    n_files: int  # read whole
    n_clouds: int  # read; of an export none
    n_checked: int  # points compared with their meshes; 0 without meshes
    false_visible: float | None  # the fraction of them that the oracle says are hidden
    faults: list[str]  # one line each; empty: the dataset is what its manifest says
    is_of_other_meshes: bool = False  # the fault is of the meshes given, and tells nothing of the dataset


class FileVerdict(NamedTuple):
    """The faults of a file, and the clouds of each split that were read in it."""

    faults: list[str]
    n_clouds: Mapping[str, int]


@dataclass(frozen=True)
class VerifyTask:
    """The task of verifying a dataset: a job is the name of a file, its checksum and then its clouds.

    `files` by split and `sha256` are as in the manifest; of an export `files` is empty.
    """

    plan: Plan
    out: Path
    files: Mapping[str, list[str]]
    sha256: Mapping[str, str]

    needs_gl = False

    def do(self, job: str, gl: Any, lost: Any = None, on_mesh: Any = None) -> FileVerdict:
        """Verify a file."""
        if not (self.out / job).is_file():
            return FileVerdict([f"{job} must be there; it is missing."], {})
        try:
            if (digest := sha256_of(self.out / job)) != self.sha256[job]:
                fault = f"{job} must have the checksum {self.sha256[job][:12]}...; it has {digest[:12]}..."
                return FileVerdict([fault], {})
            files = {split: [job] for split, names in self.files.items() if job in names}
            return self._read(files) if files else FileVerdict([], {})
        except DatasetError as error:  # it was written so, or else the checksum would differ
            return FileVerdict([str(error)], {})
        except OSError as error:
            return FileVerdict([f"{job} must be readable; it is not ({error.strerror or error})."], {})

    def _read(self, files: Mapping[str, list[str]]) -> FileVerdict:
        """Read every cloud of a file; report those that cannot be clouds of this dataset."""
        source: CloudReader = find_format(self.plan.format).load().read(self.out, self.plan, files)
        faults, n_clouds = [], Counter[str]()
        for split in source.order:
            for records in source.batches(split, in_any_order=True):
                n_clouds[split] += len(records)
                if not np.isfinite(np.concatenate(records["data"])).all():
                    faults.append(f"all positions must be finite; some of split {split} are not.")
                if "normals" in self.plan.config.attributes:
                    lengths = np.linalg.norm(np.concatenate(records["normal"]), axis=1)
                    if not (np.abs(lengths - 1.0) < 1e-3).all():
                        faults.append(f"all normals must be of length 1; some of split {split} are not.")
                if records["n_visible"].min() < 1:
                    faults.append(f"every cloud must come from a visible point; some of split {split} do not.")
        return FileVerdict(faults, n_clouds)


def verify(
    out: Path,
    meshes: MeshCollection | None,
    *,
    n_samples: int = 50,
    run: Run | None = None,
    share: tuple[int, int] = (0, 1),
    progress: Callable[[int, int], None] = lambda n, of: None,
) -> Verdict:
    """Check a finished dataset against its manifest and, where `meshes` are given, some clouds against these.

    Parameters
    ----------
    out : Path
    meshes : MeshCollection or None
        With the keys of the dataset's meshes, up axes and units as its plan says; None: no cloud is compared with them.
        Classes and splits are the plan's.
    n_samples : int
        Number of clouds compared with their meshes, chosen at random by the dataset's seed.
    run : callable, optional
        Engine that does the jobs; `run_here`, in this process, by default.
    share : (int, int)
        (i, n): look at every n-th file only, from the i-th on; the number of clouds is then not compared.
    progress : callable
        Called after each file with the number of files read, and of all.

    Raises
    ------
    DatasetError
        There is no finished dataset in the folder.
    """
    plan, manifest = read_finished(out)
    row, n_expected = find_format(plan.format), manifest["counts"]["clouds_by_split"]
    files = {} if row.exported_from else manifest["files"]
    task, found = VerifyTask(plan, out, files, manifest["sha256"]), dict[str, FileVerdict]()

    def done(job: str, result: FileVerdict) -> None:
        found[job] = result
        progress(len(found), len(jobs))

    data = {name for of_split in manifest["files"].values() for name in of_split}
    mine = sorted(data)[share[0] :: share[1]]
    jobs = [*mine, *sorted(task.sha256.keys() - data)[share[0] :: share[1]]]
    if jobs:
        (run or run_here)(task, jobs, done)
    faults = list(dict.fromkeys(fault for job in sorted(found) for fault in found[job].faults))
    n_clouds = sum((Counter(each.n_clouds) for each in found.values()), Counter[str]())
    if share == (0, 1) and not faults and files:
        for split, expected in n_expected.items():
            if n_clouds[split] != expected:
                faults.append(f"split {split} must have {expected} clouds; it has {n_clouds[split]}.")
    verdict = Verdict(len(mine), sum(n_clouds.values()), 0, None, faults)
    some = _some_files(files, set(jobs), plan.config.seed)
    if some and not faults and meshes is not None:
        comparison = _Comparison(plan, manifest, _as_planned(meshes, plan), n_samples, verdict)
        comparison.compare(row.load().read(out, plan, some))
    return verdict


def _some_files(files: Mapping[str, list[str]], looked_at: set[str], seed: int) -> dict[str, list[str]]:
    """Choose the files whose clouds are compared with their meshes, by split."""
    names = sorted(looked_at.intersection(name for of_split in files.values() for name in of_split))
    chosen = {names[i] for i in np.random.default_rng(seed).permutation(len(names))[:ASKED_FILES].tolist()}
    found = {split: [name for name in of_split if name in chosen] for split, of_split in files.items()}
    return {split: of_split for split, of_split in found.items() if of_split}


def _as_planned(meshes: MeshCollection, plan: Plan) -> dict[str, MeshEntry]:
    """Return meshes by key, with the classes and splits that a dataset gave them, by labels or a preset."""
    planned = {entry.key: entry for entry in plan.meshes}
    return {
        entry.key: replace(entry, label=planned[entry.key].label, split=planned[entry.key].split)
        for entry in meshes
        if entry.key in planned
    }


def _other_mesh(planned: MeshEntry, by_key: Mapping[str, MeshEntry]) -> str:
    """Return the fault of a mesh that is not given, or with another up axis or unit than the dataset's; else ""."""
    given = by_key.get(planned.key)
    if given is None:
        return f"the meshes given must have {planned.key}; they do not. Give those that the dataset was made of."
    for option, theirs, mine in (("up", planned.up, given.up), ("unit", planned.unit, given.unit)):
        if theirs != mine:
            return f"{option} of {planned.key} was {theirs or 'none'} and is {mine or 'none'}; give the dataset's."
    return ""


@dataclass
class _Comparison:
    """The comparison of some clouds of a dataset with their meshes; what it finds is added to the verdict."""

    plan: Plan
    manifest: Mapping[str, Any]
    by_key: Mapping[str, MeshEntry]  # the meshes given
    n_samples: int
    verdict: Verdict

    def compare(self, source: CloudReader) -> None:
        """Compare `n_samples` clouds, chosen at random by the dataset's seed."""
        plan, rng = self.plan, np.random.default_rng(self.plan.config.seed)
        everything = np.concatenate(list(source.order.values()))
        records = source.take(np.sort(rng.choice(everything, min(self.n_samples, len(everything)), replace=False)))
        scanned = plan.config.scan is not None and not plan.config.complete
        # any mesh may stand around the target of a scan
        mesh_ids = range(len(plan.meshes)) if scanned else np.unique(records["mesh_id"]).tolist()
        if other := next(filter(None, (_other_mesh(plan.meshes[i], self.by_key) for i in mesh_ids)), ""):
            self.verdict.faults.append(other)
            self.verdict.is_of_other_meshes = True
        elif scanned:
            self._scan_again(records)
        elif plan.config.complete:
            self._check_completeness(records)
        else:
            self._ask_oracle(records, rng)

    def _load(self, entry: MeshEntry) -> Mesh:
        """Load a mesh; raise MeshError where it cannot be used, or is not the one that the manifest names."""
        mesh, source = entry.load(), MeshSource.from_dict(self.manifest["origins"][entry.key])
        is_whole = len(mesh.origin.files) == len(source.files)  # without colours fewer files are read
        if is_whole and mesh.origin.sha256 != source.sha256:
            raise MeshError(
                f"{entry.key} must have the SHA-256 {source.sha256[:12]}...; it has {mesh.origin.sha256[:12]}... ."
            )
        return mesh

    def _scan_again(self, records: Records) -> None:
        """Scan the objects of some clouds again, and compare those clouds whole.

        The same plan gives the same bytes. A cloud that differs was made by another plan or of other meshes.
        """
        plan, meshes = self.plan, MeshCollection(self.by_key[entry.key] for entry in self.plan.meshes)
        remade = Plan(meshes, plan.config, plan.format, plan.views)
        n_meshes = max(1, self.n_samples // plan.clouds_per_mesh)
        for mesh_id in list(dict.fromkeys(records["mesh_id"].tolist()))[:n_meshes]:
            entry = remade.meshes[mesh_id]
            try:
                kept = [
                    gather_clouds(
                        each.points, each.mask, each.views, each.longest_side, plan.config, entry.key, variation
                    )
                    for variation, each in enumerate(samplings(remade, self._load(entry), mesh_id, None))
                ]
            except (DatasetError, MeshError, OptionError) as error:
                self.verdict.faults.append(str(error))
                continue
            again = {(int(r["variation"]), int(r["view_id"])): r for part in kept for r in part}
            for record in records[records["mesh_id"] == mesh_id]:
                other = again.get((int(record["variation"]), int(record["view_id"])))
                self.verdict.n_checked += len(record["data"])
                if other is None or other["data"].tobytes() != record["data"].tobytes():
                    self.verdict.faults.append(
                        f"view {int(record['view_id'])} of {entry.key} must be what the plan gives; it is another scan."
                    )

    def _check_completeness(self, records: Records) -> None:
        """Check that points of complete clouds lie on their faces, and are spread as the whole surface is.

        The spread is compared along the three axes of the view, so that a cloud without the far side differs, by the
        test of Kolmogorov and Smirnov. Farthest points are even in space, not by area: they need only lie on their
        faces.
        """
        plan = self.plan
        for record in records:
            entry = self.by_key[plan.meshes[int(record["mesh_id"])].key]
            try:
                mesh = self._load(entry)
                if plan.config.scan is not None:
                    mesh, _ = in_metres(mesh, entry.label, plan.config.scan)
            except MeshError as error:
                self.verdict.faults.append(str(error))
                continue
            of_cloud = f"view {int(record['view_id'])} of {entry.key}"
            positions = object_positions(record, record["pose"], plan.config)
            self.verdict.n_checked += len(positions)
            allowed = (OFF_SURFACE + 2.0 * self._rounding(mesh, record)) * mesh.longest_side
            away = _distances_from_faces(positions, mesh.corners[record["face_ids"]])
            if not (away <= allowed).all():
                self.verdict.faults.append(
                    f"all points must lie on their faces; one of {of_cloud} is {away.max():.3g} away."
                )
            elif plan.config.subset != "fps":
                seed = seed_of(plan.config.seed, entry.key + "/verify")
                whole = sample_surface(mesh, n_points=SURFACE_POINTS, seed=seed)
                axes = record["pose"][:3, :3].T
                found, most = _largest_difference(np.unique(positions, axis=0) @ axes, whole.positions @ axes, allowed)
                if found > most:
                    self.verdict.faults.append(
                        f"a complete cloud must be spread as the surface is; {of_cloud} differs by {found:.2f}, which "
                        f"chance explains up to {most:.2f}."
                    )

    def _rounding(self, mesh: Mesh, record: Any) -> float:
        """Return by how much coordinates are rounded, in longest sides of the mesh, beyond what a unit box explains."""
        rounding: float = self.manifest.get("rounding", 0.0)
        if self.plan.config.scale == "mesh":
            bounds = stored_bounds(mesh, float(record["view"][2]), self.plan.config)
            rounding += float(np.spacing(np.float32(np.abs(bounds).max()))) / 2.0 / mesh.longest_side
        return rounding

    def _ask_oracle(self, records: Records, rng: np.random.Generator) -> None:
        """Measure the fraction of hidden points among some points of some clouds."""
        from zbuf_occlude.visibility.methods.oracle import BAND  # late: takes Numba
        from zbuf_occlude.visibility.methods.oracle import prepare as prepare_oracle

        n_checked = n_hidden = 0
        for record in records:
            try:
                with Limits().watch():
                    mesh = self._load(self.by_key[self.plan.meshes[int(record["mesh_id"])].key])
            except MeshError as error:
                self.verdict.faults.append(str(error))
                continue
            rotation, translation = record["pose"][:3, :3], record["pose"][:3, 3]
            some = rng.choice(len(record["data"]), min(POINTS_PER_CLOUD, len(record["data"])), replace=False)
            positions = object_positions(record, record["pose"], self.plan.config)[some]
            points = SurfacePoints(positions, record["face_ids"][some], np.zeros_like(positions))
            eye = (-rotation.T @ translation)[None]
            with prepare_oracle(mesh) as oracle:
                hidden = points.select(~oracle.visible(points, eye)[0])
                # a rounded point may change its answer where the line of sight grazes the surface
                moved = np.sqrt(3.0) * self._rounding(mesh, record) * mesh.longest_side / mesh.diagonal
                n_hidden += int(oracle.decided(hidden, eye, max(BAND, moved)).sum())
            n_checked += len(points)
        self.verdict.n_checked, self.verdict.false_visible = n_checked, n_hidden / n_checked if n_checked else None
        stated = self.manifest["error"]
        if n_checked and stated["interval"] is not None:
            # few pairs give a rough fraction: take the interval's upper bound for all wrong answers, and of it the
            # share that false visible ones have
            wrong = stated["false_visible"] + stated["false_hidden"]
            promised = stated["interval"][1] * (stated["false_visible"] / wrong if wrong else 1.0)
            # the manifest's fraction is of all pairs of view and point; a cloud has the visible ones alone
            promised = min(1.0, promised / float(records["visible_fraction"].mean()))
            allowed = promised + DEVIATIONS * np.sqrt(promised * (1 - promised) / n_checked) + ROUNDING
            if n_hidden / n_checked > allowed:
                self.verdict.faults.append(
                    f"by the manifest at most {allowed:.2%} of the points may be hidden; the oracle says that "
                    f"{n_hidden / n_checked:.2%} of {n_checked} are."
                )


def _distances_from_faces(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Return the distances of points (n, 3) to the planes of their faces (n, 3, 3), or beyond the faces' edges."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    away = np.abs(((points - a) * normals).sum(axis=1))
    for start, end in ((a, b), (b, c), (c, a)):
        outwards = np.cross(end - start, normals)
        outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
        away = np.maximum(away, ((points - start) * outwards).sum(axis=1))
    return np.asarray(away)


def _largest_difference(mine: FloatArray, others: FloatArray, slack: float) -> tuple[float, float]:
    """Return the largest difference of two distribution functions along some axes, and the one that chance explains.

    Positions may be off by `slack`: rounding moves all points of a flat side to the other side of a threshold.

    References
    ----------
    P. Massart: The tight constant in the Dvoretzky-Kiefer-Wolfowitz inequality. Annals of Probability 18 (1990); for
    two samples F. Wei, R. M. Dudley: Two-sample Dvoretzky-Kiefer-Wolfowitz inequalities, 2012.
    """
    differences = []
    for one, other in zip(mine.T, others.T, strict=True):
        for here, there in ((np.sort(one), np.sort(other)), (np.sort(other), np.sort(one))):
            below = np.arange(1, len(here) + 1) / len(here)
            differences.append((below - np.searchsorted(there, here + slack, side="right") / len(there)).max())
    size = len(mine) * len(others) / (len(mine) + len(others))
    return float(max(differences)), float(np.sqrt(np.log(2.0 / CHANCE) / (2.0 * size)))
