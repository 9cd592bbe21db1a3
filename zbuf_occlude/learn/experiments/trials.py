"""Trials: one classifier each, trained and tested; its result is one JSON file, written last and never made twice."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.compare.run import machine
from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.manifest import versions
from zbuf_occlude.learn.checkpoint import Epoch, Trained
from zbuf_occlude.learn.config import TrainConfig
from zbuf_occlude.learn.data import CloudSet
from zbuf_occlude.learn.evaluate import predict
from zbuf_occlude.learn.experiments.progress import Progress
from zbuf_occlude.learn.experiments.results import path_of, read_result
from zbuf_occlude.learn.experiments.sizes import Size
from zbuf_occlude.learn.train import train

CLASSIFIERS = "classifiers"
"""Folder of a study: the trained model of each trial."""

Clouds = Callable[[], CloudSet]


@dataclass(frozen=True)
class Trial:
    """A classifier to be trained, and what it is tested on.

    Parameters
    ----------
    experiment : str
    facts : mapping of str to str or int
        What tells it apart from the others of the experiment: model, what it is trained on, points, seed.
    training, validation : callable
        Return its clouds; called when they are needed.
    tests : mapping of name to callable
    """

    experiment: str
    facts: Mapping[str, str | int]
    training: Clouds
    validation: Clouds
    tests: Mapping[str, Clouds]

    @property
    def key(self) -> str:
        """Name of its files."""
        parts = (f"{name}{value}" if isinstance(value, int) else value for name, value in self.facts.items())
        return "-".join((self.experiment, *parts))


def run_trials(trials: Sequence[Trial], size: Size, folder: Path, progress: Progress) -> int:
    """Train and test what has not been yet.

    Parameters
    ----------
    trials : sequence of Trial
    size : Size
    folder : Path
        The study's.
    progress : Progress

    Returns
    -------
    int
        Trials for which anything was done.

    Notes
    -----
    A trial that was tested before on all but a new test, such as scans that were not there, is only tested on that.
    """
    n_worked = 0
    for trial in trials:
        path = path_of(folder, trial.key)
        result = read_result(path)
        tested: dict[str, Any] = result.document["tests"] if result else {}
        missing = [name for name in trial.tests if name not in tested]
        progress.trial(trial.key, 0.0 if missing else 1.0)
        if not missing:
            continue
        training, validation = trial.training(), some(trial.validation(), size.n_validation)
        trained = run_training(trial, training, validation, size, folder, progress)
        new = {name: tested_on(trained, trial.tests[name]()) for name in missing}
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic.write_json(path, document_of(trial, trained, training, validation, {**tested, **new}))
        n_worked += 1
        progress.trial(trial.key, 1.0)
    return n_worked


def run_training(
    trial: Trial, training: CloudSet, validation: CloudSet, size: Size, folder: Path, progress: Progress
) -> Trained:
    """Train a trial's classifier, or go on, or read it back."""
    model = str(trial.facts["model"])
    epochs = max(1, round(size.passes[model] / len(training)))
    config = TrainConfig(
        model=model,
        epochs=epochs,
        batch_size=size.batch_size,
        patience=max(1, round(size.patience * epochs)),
        seed=int(trial.facts["seed"]),
    )

    def after(epoch: Epoch) -> None:
        progress.trial(trial.key, 0.95 * epoch.number / epochs)  # the rest is testing

    return train(config, training, validation, folder / CLASSIFIERS / trial.key, progress=after)


def tested_on(trained: Trained, clouds: CloudSet) -> dict[str, Any]:
    """Return the table of true against predicted classes; the true ones need not be those of the classifier."""
    confusion = np.zeros((len(clouds.classes), len(trained.classes)), dtype=np.int64)
    np.add.at(confusion, (clouds.labels, predict(trained.model, clouds).argmax(axis=1)), 1)
    return {"truth": clouds.classes, "predicted": trained.classes, "confusion": confusion.tolist()}


def document_of(
    trial: Trial, trained: Trained, training: CloudSet, validation: CloudSet, tests: Mapping[str, Any]
) -> dict[str, Any]:
    """Return a trial's result as plain data."""
    return {
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
        "tests": dict(tests),
    }


def some(clouds: CloudSet, most: int) -> CloudSet:
    """Return at most so many of the clouds, drawn at random."""
    return clouds.thinned(np.zeros(len(clouds)), most, seed=0)
