"""Trials: one classifier each, trained and tested; its result is one JSON file, written last and never made twice."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

import numpy as np
import torch

from zbuf_occlude.compare.child import Child, ChildFailed, report_progress
from zbuf_occlude.compare.run import machine
from zbuf_occlude.dataset import atomic
from zbuf_occlude.errors import UnavailableError
from zbuf_occlude.learn.checkpoint import Epoch, Trained
from zbuf_occlude.learn.config import TrainConfig
from zbuf_occlude.learn.data import CloudSet
from zbuf_occlude.learn.evaluate import predict
from zbuf_occlude.learn.train import train
from zbuf_occlude.paper.design import Progress, Size
from zbuf_occlude.paper.results import path_of, read_result
from zbuf_occlude.provenance import n_cores, versions

CLASSIFIERS = "classifiers"
"""Folder of a study: the trained model of each trial."""

Clouds = Callable[[], CloudSet]
Report = Callable[[str, float], None]
"""`Progress.trial`."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A classifier to be trained, and what it is tested on; clouds are read when they are needed."""

    experiment: str
    facts: Mapping[str, str | int]  # what tells it apart from the others: model, what it is trained on, points, seed
    training: Clouds
    validation: Clouds
    tests: Mapping[str, Clouds]
    epochs: Callable[[int], int]  # from the number of its clouds to how often each is shown, at most

    @property
    def key(self) -> str:
        """Name of its files."""
        parts = (f"{name}{value}" if isinstance(value, int) else value for name, value in self.facts.items())
        return "-".join((self.experiment, *parts))


def run_trials(
    trials: Sequence[Trial], size: Size, folder: Path, progress: Progress, workers: int | None = None
) -> int:
    """Train and test what has not been yet; return the number of trials for which anything was done.

    `workers` are processes, each at a trial of its own: small networks gain little from several cores. By default one
    for each core, and where there is CUDA none but this one. A trial that was tested before on all but a new test,
    such as scans that were not there, is only tested on that. Raises UnavailableError where a worker was killed.
    """
    missing = [trial for trial in trials if missing_tests(trial, folder)]
    for trial in set(trials) - set(missing):
        progress.trial(trial.key, 1.0)
    if workers is None:
        workers = 1 if torch.cuda.is_available() else n_cores()
    workers = min(workers, len(missing))
    if workers < 2:
        for trial in missing:
            run_trial(trial, size, folder, progress.trial)
        return len(missing)
    begin = partial(begin_worker, max(1, n_cores() // workers))
    children = [Child(begin) for _ in range(workers)]
    idle, busy, left = children, dict[Any, Child](), iter(missing)
    try:
        while True:
            for child, trial in zip(idle, left, strict=False):
                child.start(run_trial, trial, size, folder)
                busy[child.pipe] = child
            if not busy:
                return len(missing)
            idle = [busy.pop(pipe) for pipe in wait(busy) if busy[pipe].finished(progress.trial)]
    except ChildFailed as failure:
        raise UnavailableError(
            f"the processes that train must live; one was killed ({failure}), perhaps for want of memory. "
            "What is done is kept; run the same command again."
        ) from None
    finally:
        for child in children:
            child.kill()


def begin_worker(threads: int) -> None:
    """Begin as a process does that trains."""
    torch.set_num_threads(threads)


def missing_tests(trial: Trial, folder: Path) -> list[str]:
    """Return the tests of a trial whose results are not there."""
    result = read_result(path_of(folder, trial.key))
    return [name for name in trial.tests if result is None or name not in result.tests]


def run_trial(trial: Trial, size: Size, folder: Path, report: Report = report_progress) -> None:
    """Train a classifier, or read it back, test it on what is missing, and write its result."""
    report(trial.key, 0.0)
    path, names = path_of(folder, trial.key), missing_tests(trial, folder)
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
        report(trial.key, 0.95 * epoch.number / epochs)  # the rest is testing

    trained = train(config, training, validation, folder / CLASSIFIERS / trial.key, progress=after)
    tests: dict[str, Any] = dict(result.document["tests"]) if result else {}
    tests |= {name: tested_on(trained, trial.tests[name]()) for name in names}
    document = {
        "experiment": trial.experiment,
        "facts": dict(trial.facts),
        "config": trained.config.document,
        "n_training": len(training),
        "n_objects": len(np.unique(training.object_ids)),
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


def tested_on(trained: Trained, clouds: CloudSet) -> dict[str, Any]:
    """Return the table of true against predicted classes; the true ones need not be those of the classifier."""
    confusion = np.zeros((len(clouds.classes), len(trained.classes)), dtype=np.int64)
    np.add.at(confusion, (clouds.labels, predict(trained.model, clouds).argmax(axis=1)), 1)
    return {"truth": clouds.classes, "predicted": trained.classes, "confusion": confusion.tolist()}


def as_many_clouds(passes: int, n_clouds: int) -> int:
    """Return in how many epochs a set of clouds comes to about `passes` clouds shown."""
    return max(1, round(passes / n_clouds))


def as_many_epochs(epochs: int, n_clouds: int) -> int:
    """Return the epochs, however many clouds there are."""
    return epochs
