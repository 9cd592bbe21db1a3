"""Run a study in a folder: clouds, classifiers, results; the same call again does only what is missing."""

from collections.abc import Collection, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from zbuf_occlude.dataset import atomic
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.paper import drives, sydney
from zbuf_occlude.paper.augmentation import AugmentationClouds, Scans
from zbuf_occlude.paper.design import AUGMENTATION, CLOUDS, ELEVATION, REALISM, Progress, Size
from zbuf_occlude.paper.elevation import ElevationClouds
from zbuf_occlude.paper.objects import as_voxels, find_objects, is_modelnet10
from zbuf_occlude.paper.realism import RealismClouds
from zbuf_occlude.paper.results import PICTURE, STUDY, read_study
from zbuf_occlude.paper.trials import run_trials

EXPERIMENTS = (ELEVATION, AUGMENTATION)
"""The paper's; `REALISM` is ours."""


def run_study(
    folder: Path,
    size: Size,
    *,
    experiments: Collection[str] = EXPERIMENTS,
    modelnet: Path | None = None,
    scans: Path | None = None,
    scans_up: str | None = None,
    real: Path | None = None,
    budgets: Sequence[str] = (CLOUDS,),
    voxels: int | None = None,
    progress: Progress | None = None,
    workers: int | None = None,
) -> int:
    """Make the clouds, train and test the classifiers of a study; return how many were trained or tested now.

    Killed at any moment, the same call resumes: datasets, trainings from their last checkpoint, and a result is there
    only when it is whole. What is in the folder of the same study is not made again.

    Parameters
    ----------
    folder : Path
        Made when missing.
    size : Size
    experiments : collection of str
        Some of `EXPERIMENTS` and `REALISM`.
    modelnet : Path, optional
        ModelNet40's folder, or for `ELEVATION` alone ModelNet10's; by default the built-in shapes.
    scans, scans_up : Path and str, optional
        The Sydney Urban Objects dataset, for Test 3; which direction is up in it, by default found from the scans.
    real : Path, optional
        Labelled sweeps of real drives, for a fourth test of `REALISM`.
    budgets : sequence of str
        As in `AugmentationClouds`; one that is asked for later is added to what is there.
    voxels : int, optional
        Take each object as the surface of this many voxels a side, as in `as_voxels`.
    progress : Progress, optional
    workers : int, optional
        As in `run_trials`.

    Raises
    ------
    DatasetError
        The folder holds another study, or `scans` or `real` is not such a dataset.
    OptionError
        `voxels` out of range.
    MeshError
        `modelnet` is neither, or no mesh of a class can be used.
    """
    progress, known = progress or Progress(), None
    if scans is not None:
        sydney.check_scans(scans)  # before hours of work, not after
        frame = sydney.Frame(scans_up, {}) if scans_up else sydney.find_frame(scans)
        known = Scans(scans, frame.up)
    if real is not None:
        drives.read_clouds(real, 1)  # likewise
    meshes = find_objects(modelnet, any_ten=not {AUGMENTATION, REALISM} & set(experiments))
    objects = "built-in shapes"
    if modelnet is not None:
        objects = f"ModelNet10 ({', '.join(meshes.classes)})" if is_modelnet10(meshes) else "ModelNet40"
    if voxels is not None:
        meshes, objects = as_voxels(meshes, voxels), f"{objects} as surfaces of {voxels}³ voxels"
    parts: list[ElevationClouds | AugmentationClouds | RealismClouds] = []
    if ELEVATION in experiments:
        parts.append(ElevationClouds(meshes, size, folder))
    if AUGMENTATION in experiments:
        parts.append(AugmentationClouds(meshes, size, folder, known, budgets))
    if REALISM in experiments:
        parts.append(RealismClouds(meshes, size, folder, real))
    study = claim(folder, size, objects)
    if known is not None:
        claim_scans(folder, study, known, frame)
    progress.plan(sum(part.n_clouds for part in parts), sum(len(part.trials()) for part in parts))
    for part in parts:
        study["failed_meshes"] |= part.make(progress.clouds)
        if isinstance(part, AugmentationClouds):
            study["missing_methods"] = part.missing
        if isinstance(part, RealismClouds):
            study["realism"] = part.facts()
        atomic.write_json(folder / STUDY, study)
    return run_trials([trial for part in parts for trial in part.trials()], size, folder, progress, workers)


def claim_scans(folder: Path, study: dict[str, Any], scans: Scans, frame: sydney.Frame) -> None:
    """Note how scans are turned, and draw some; raises DatasetError where Test 3 was made with another direction up."""
    if study.get("scans", frame.document)["up"] != frame.up:
        raise DatasetError(
            f"the scans of {folder} must be turned as before ({study['scans']['said']}); now {frame.up} would be up. "
            "Choose another folder, or the same --sydney-up."
        )
    study["scans"] = frame.document
    atomic.write_json(folder / STUDY, study)
    picture = sydney.picture_of_scans(*scans)
    atomic.write(folder / PICTURE, lambda file: picture.savefig(file, format="png", dpi=120))


def claim(folder: Path, size: Size, objects: str) -> dict[str, Any]:
    """Make the folder this study's, or find that it is; return what is stored of it.

    Raises DatasetError where it is another's: another size, or other objects.
    """
    path = folder / STUDY
    if path.exists():
        study = read_study(folder)
        mine = {**size.document, "objects": objects}
        theirs = {**study["size"], "objects": study["objects"]}
        if different := [name for name in mine if theirs.get(name) != mine[name]]:
            raise DatasetError(
                f"{folder} must be empty or hold this same study ({size.name}, {objects}); it holds another "
                f"({theirs['name']}, {theirs['objects']}), with other {', '.join(different)}. Choose another folder."
            )
        return study
    if folder.is_dir() and set(folder.iterdir()) - set(atomic.leftovers([folder])):
        raise DatasetError(f"{folder} must be empty or hold a study; it has other files. Choose another folder.")
    folder.mkdir(parents=True, exist_ok=True)
    study = {"size": size.document, "objects": objects, "date": date.today().isoformat()}
    study |= {"missing_methods": {}, "failed_meshes": {}}
    atomic.write_json(path, study)
    return study
