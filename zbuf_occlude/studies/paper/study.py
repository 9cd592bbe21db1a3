"""Run a study: make the clouds of its experiments, train and test the classifiers, and store the results in a folder.

A trial is one classifier; its result is one JSON file, written last. After an interruption the same call resumes:
datasets, trainings from their last checkpoints, and results. Nothing is looked up by a path or a device: a copied
folder resumes on another machine with the same packages.
"""

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from datetime import date
from functools import partial
from math import inf
from multiprocessing.connection import wait
from pathlib import Path
from time import monotonic
from typing import Any, NamedTuple

import numpy as np
import torch

from zbuf_occlude.base import atomic
from zbuf_occlude.base.child import Child, ChildFailed, report_progress
from zbuf_occlude.base.cores import n_cores
from zbuf_occlude.base.errors import DatasetError, OptionError, UnavailableError
from zbuf_occlude.base.provenance import versions
from zbuf_occlude.datasets.real.sydney import UpAxis, find_frame, find_scans
from zbuf_occlude.studies.compare.run import machine
from zbuf_occlude.studies.learn.evaluation import evaluate
from zbuf_occlude.studies.learn.training import Epoch, TimeUp, TrainConfig, train
from zbuf_occlude.studies.paper.augmentation import Augmentation
from zbuf_occlude.studies.paper.design import AUGMENTATION, CLOUDS, ELEVATION, REAL, REALISM, Progress, Size
from zbuf_occlude.studies.paper.elevation import Elevation
from zbuf_occlude.studies.paper.experiments import Experiment, MakeOptions, as_voxels, find_objects, is_modelnet10
from zbuf_occlude.studies.paper.real_objects import RealObjects
from zbuf_occlude.studies.paper.real_scans import check_scans, picture_of_scans, read_objects
from zbuf_occlude.studies.paper.realism import Realism
from zbuf_occlude.studies.paper.results import PICTURE, STUDY, Trial, path_of, read_result, read_study

CLASSIFIERS = "classifiers"
"""Folder of the trained models in a study's folder."""
EXPERIMENTS = (ELEVATION, AUGMENTATION)
"""Experiments of the paper."""
GPU_BYTES = 16 * 2**30
"""Memory of a GPU for each of the processes that train on it at once."""


class Work(NamedTuple):
    """Work on a study."""

    n_now: int  # classifiers trained or tested in this call
    n_done: int  # classifiers with all results
    n_planned: int  # classifiers of the study; more than `n_done` where the time was up


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
    minutes: float = inf,
    progress: Progress | None = None,
    workers: int | None = None,
) -> Work:
    """Make the clouds, train and test the classifiers of a study, or continue until the time is up.

    Parameters
    ----------
    folder : Path
    size : Size
    experiments : collection of str
    modelnet : Path, optional
        ModelNet40's folder, or ModelNet10's for `ELEVATION` alone. Default: the built-in shapes.
    scans : Path, optional
        The Sydney Urban Objects dataset, for Test 3.
    scans_up : str, optional
        Up direction of the scans, one of `UPS`. Default: found from the scans.
    real : Path, optional
        Labelled sweeps of real drives: the test of `REAL`, and one more of `REALISM`.
    budgets : sequence of str
        As in `Augmentation`; a budget given later is added to the results.
    voxels : int, optional
        As in `as_voxels`.
    minutes : float
        Time after which to stop: at the next end of a new shard of a dataset, or of an epoch of each training. What is
        finished is kept, trainings as checkpoints, and the same call continues. Each call does at least a shard, or an
        epoch.
    progress : Progress, optional
    workers : int, optional
        Number of processes that make a dataset, and that train as in `run_trials`. Default: one per core.

    Raises
    ------
    DatasetError
        The folder holds another study, or `scans` or `real` is not such a dataset.
    OptionError
        `voxels` or `minutes` is out of range, or `REAL` has no `real`.
    MeshError
        `modelnet` is neither dataset, or no mesh of a class can be used.
    """
    if not minutes > 0.0:
        raise OptionError(f"minutes must be positive; got {minutes}.")
    until = monotonic() + 60.0 * minutes
    progress, turned = progress or Progress(), None
    if scans is not None:
        check_scans(scans)  # raises before hours of work
        said = f"{scans_up} of the files is up, by --sydney-up."
        turned = scans, UpAxis(scans_up, said) if scans_up else find_frame(find_scans(scans))
    if real is not None and REALISM in experiments:
        read_objects(real, 1)  # raises before hours of work
    meshes = find_objects(modelnet, any_ten=not {AUGMENTATION, REALISM} & set(experiments))
    objects = "built-in shapes"
    if modelnet is not None:
        objects = f"ModelNet10 ({', '.join(meshes.classes)})" if is_modelnet10(meshes) else "ModelNet40"
    if voxels is not None:
        meshes, objects = as_voxels(meshes, voxels), f"{objects} as surfaces of {voxels}³ voxels"
    chosen: list[Experiment] = []
    if ELEVATION in experiments:
        chosen.append(Elevation(meshes, size, folder))
    if AUGMENTATION in experiments:
        chosen.append(Augmentation(meshes, size, folder, turned and (turned[0], turned[1].up), budgets))
    if REALISM in experiments:
        chosen.append(Realism(meshes, size, folder, real))
    if REAL in experiments:
        if real is None:
            raise OptionError(f"real must be a folder of labelled sweeps for the experiment {REAL}; got None.")
        chosen.append(RealObjects(size, folder, real))
        objects = "built-in road users"
    study = _open_study(folder, size, objects)
    if turned:
        _note_scans(folder, study, *turned)
    trials = [trial for experiment in chosen for trial in experiment.trials()]
    progress.set_totals(sum(experiment.max_clouds for experiment in chosen), len(trials))
    n_workers, n_now = n_cores() if workers is None else workers, 0
    options = MakeOptions(progress.add_clouds, n_workers, partial(_check_time, until))
    with suppress(TimeUp):
        for experiment in chosen:
            study["failed_meshes"] |= experiment.make_datasets(options)
            study |= experiment.notes()
            atomic.write_json(folder / STUDY, study)
        trials = [trial for experiment in chosen for trial in experiment.trials()]  # of the methods that can run here
        n_now = run_trials(trials, size, folder, progress, workers, until)
    return Work(n_now, sum(not _missing_tests(trial, folder) for trial in trials), len(trials))


def _check_time(until: float) -> None:
    """Raise TimeUp from a time of the monotonic clock, seconds; all processes of a machine have the same clock."""
    if monotonic() >= until:
        raise TimeUp


def _note_scans(folder: Path, study: dict[str, Any], root: Path, frame: UpAxis) -> None:
    """Store the up axis of the scans and a picture; raises DatasetError where Test 3 was made with another up axis."""
    if study.get("scans", frame._asdict())["up"] != frame.up:
        raise DatasetError(
            f"The up axis of the scans in {folder} has changed ({study['scans']['said']}); now it is {frame.up}. "
            "Choose another folder, or the same --sydney-up."
        )
    study["scans"] = frame._asdict()
    atomic.write_json(folder / STUDY, study)
    picture = picture_of_scans(root, frame.up)
    atomic.write(folder / PICTURE, lambda file: picture.savefig(file, format="png", dpi=120))


def _open_study(folder: Path, size: Size, objects: str) -> dict[str, Any]:
    """Return study.json of a folder, written where it is missing; raises DatasetError where it is another study's."""
    path = folder / STUDY
    if path.exists():
        study = read_study(folder)
        mine = {**size.to_dict(), "objects": objects}
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
    study = {"size": size.to_dict(), "objects": objects, "date": date.today().isoformat()}
    study |= {"missing_methods": {}, "failed_meshes": {}}
    atomic.write_json(path, study)
    return study


def run_trials(
    trials: Sequence[Trial],
    size: Size,
    folder: Path,
    progress: Progress,
    workers: int | None = None,
    until: float = inf,
) -> int:
    """Train and test the trials without complete results; return the number of those finished now.

    `workers` is the number of processes, each with a trial of its own (small networks gain little from several cores,
    and do not fill a GPU). Default: one per core, but on a GPU one per `GPU_BYTES` of its free memory. A trained
    classifier is tested only on tests that it lacks. From the time `until` of the monotonic clock (seconds) no trial
    begins, and trainings stop at the end of their epoch. Raises UnavailableError where a worker was killed.
    """
    missing = [trial for trial in trials if _missing_tests(trial, folder)]
    for trial in set(trials) - set(missing):
        progress.update_trial(trial.key, 1.0)
    workers = min(_n_workers() if workers is None else workers, len(missing))
    left = _begun_in_time(missing, until)
    if workers < 2:
        return sum(_run_trial(trial, size, folder, until, progress.update_trial) for trial in left)
    n_threads, children = max(1, n_cores() // workers), [Child() for _ in range(workers)]
    idle, busy, n_finished = children, dict[Any, Child](), 0
    try:
        while True:
            for child, trial in zip(idle, left, strict=False):
                child.start(_run_alone, n_threads, trial, size, folder, until)
                busy[child.pipe] = child
            if not busy:
                return n_finished
            idle = [busy.pop(pipe) for pipe in wait(busy) if busy[pipe].finished(progress.update_trial)]
            n_finished += sum(child.result for child in idle)
    except ChildFailed as failure:
        raise UnavailableError(
            f"A worker of the training failed: its process {failure}. Memory may be exhausted. Results so far are "
            "kept; run the same command again."
        ) from None
    finally:
        for child in children:
            child.kill()


def _begun_in_time(trials: Sequence[Trial], until: float) -> Iterator[Trial]:
    """Yield trials until the time is up, but at least one, so that each call does some work."""
    for number, trial in enumerate(trials):
        if number and monotonic() >= until:
            return
        yield trial


def _n_workers() -> int:
    """Return the number of processes that train at once: one per core, as far as the memory of a GPU suffices."""
    if not torch.cuda.is_available():
        return n_cores()
    return max(1, min(n_cores(), torch.cuda.mem_get_info()[0] // GPU_BYTES))


def _run_alone(n_threads: int, trial: Trial, size: Size, folder: Path, until: float) -> bool:
    """Run a trial in a child process, with its share of the cores."""
    torch.set_num_threads(n_threads)
    return _run_trial(trial, size, folder, until, report_progress)


def _missing_tests(trial: Trial, folder: Path) -> list[str]:
    """Return the tests of a trial that have no result."""
    result = read_result(path_of(folder, trial.key))
    return [name for name in trial.tests if result is None or name not in result.tests]


def _run_trial(trial: Trial, size: Size, folder: Path, until: float, report: Any) -> bool:
    """Train or load a classifier, run its missing tests, and write its result; return False where the time is up."""
    report(trial.key, 0.0)
    path, names = path_of(folder, trial.key), _missing_tests(trial, folder)
    result = read_result(path)
    training, validation = trial.training(), trial.validation()
    validation = validation.thinned(np.zeros(len(validation)), size.n_validation, seed=0)
    epochs = trial.epochs(len(training))
    config = TrainConfig(
        model=str(trial.facts["model"]),
        epochs=epochs,
        batch_size=size.batch_size,
        patience=max(1, round(size.patience * epochs)),
        seed=int(trial.facts["seed"]),
    )

    def after(epoch: Epoch) -> None:
        report(trial.key, 0.95 * epoch.number / epochs)  # the rest is for testing
        _check_time(until)

    try:
        trained = train(config, training, validation, folder / CLASSIFIERS / trial.key, progress=after)
    except TimeUp:
        return False
    tests: dict[str, Any] = dict(result.document["tests"]) if result else {}
    for name in names:
        found = evaluate(trained.model, trial.tests[name](), trained.classes)
        tests[name] = {"truth": found.truth, "predicted": found.predicted, "confusion": found.counts.tolist()}
    document = {
        "experiment": trial.experiment,
        "facts": dict(trial.facts),
        "config": trained.config.to_dict(),
        "n_training": len(training),
        "n_objects": len(np.unique(training.group_ids)),
        "n_validation": len(validation),
        "n_parameters": sum(parameter.numel() for parameter in trained.model.parameters()),
        "epochs": len(trained.history),
        "best_epoch": trained.best.number,
        "validation_accuracy": trained.best.validation_accuracy,
        "seconds": trained.seconds,
        "device": str(next(trained.model.parameters()).device),
        "machine": machine(),
        "versions": versions(),
        "tests": tests,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    atomic.write_json(path, document)
    report(trial.key, 1.0)
    return True
