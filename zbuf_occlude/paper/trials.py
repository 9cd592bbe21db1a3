"""Trials: one classifier each, trained and tested; its result is one JSON file, written last and never made twice."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from zbuf_occlude.compare.run import machine
from zbuf_occlude.dataset import atomic
from zbuf_occlude.errors import UnavailableError
from zbuf_occlude.learn.checkpoint import Epoch, Trained
from zbuf_occlude.learn.config import TrainConfig
from zbuf_occlude.learn.data import CloudSet
from zbuf_occlude.learn.evaluate import predict
from zbuf_occlude.learn.train import train
from zbuf_occlude.paper.design import Size
from zbuf_occlude.paper.progress import Progress
from zbuf_occlude.paper.results import path_of, read_result
from zbuf_occlude.versions import n_cores, versions
from zbuf_occlude.workers.worker import die_with_parent

CLASSIFIERS = "classifiers"
"""Folder of a study: the trained model of each trial."""

LOOK_SECONDS = 0.2
"""Between two looks at what the workers have to tell."""

Clouds = Callable[[], CloudSet]
Told = Callable[[str, float], None]
"""`Progress.trial`."""


@dataclass(frozen=True, eq=False)
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
    epochs : callable
        From the number of its clouds to how often each is shown, at most.
    """

    experiment: str
    facts: Mapping[str, str | int]
    training: Clouds
    validation: Clouds
    tests: Mapping[str, Clouds]
    epochs: Callable[[int], int]

    @property
    def key(self) -> str:
        """Name of its files."""
        parts = (f"{name}{value}" if isinstance(value, int) else value for name, value in self.facts.items())
        return "-".join((self.experiment, *parts))


def run_trials(
    trials: Sequence[Trial], size: Size, folder: Path, progress: Progress, workers: int | None = None
) -> int:
    """Train and test what has not been yet.

    Parameters
    ----------
    trials : sequence of Trial
    size : Size
    folder : Path
        The study's.
    progress : Progress
    workers : int, optional
        Processes, each at a trial of its own: small networks gain little from several cores. By default one for each
        core, and where there is CUDA none but this one.

    Returns
    -------
    int
        Trials for which anything was done.

    Raises
    ------
    UnavailableError
        A worker was killed.

    Notes
    -----
    A trial that was tested before on all but a new test, such as scans that were not there, is only tested on that.
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
    else:
        _run_in_workers(missing, size, folder, progress, workers)
    return len(missing)


def missing_tests(trial: Trial, folder: Path) -> list[str]:
    """Return the tests of a trial whose results are not there."""
    result = read_result(path_of(folder, trial.key))
    return [name for name in trial.tests if result is None or name not in result.tests]


def run_trial(trial: Trial, size: Size, folder: Path, told: Told) -> None:
    """Train a classifier, or read it back, test it on what is missing, and write its result."""
    told(trial.key, 0.0)
    path, names = path_of(folder, trial.key), missing_tests(trial, folder)
    result = read_result(path)
    training, validation = trial.training(), some(trial.validation(), size.n_validation)
    trained = run_training(trial, training, validation, size, folder, told)
    tests: dict[str, Any] = dict(result.document["tests"]) if result else {}
    tests |= {name: tested_on(trained, trial.tests[name]()) for name in names}
    path.parent.mkdir(parents=True, exist_ok=True)
    atomic.write_json(path, document_of(trial, trained, training, validation, tests))
    told(trial.key, 1.0)


def _run_in_workers(trials: Sequence[Trial], size: Size, folder: Path, progress: Progress, workers: int) -> None:
    """Run trials in spawned processes that share the cores and do not outlive this one."""
    context = multiprocessing.get_context("spawn")
    heard = context.SimpleQueue()
    others = set(multiprocessing.active_children())
    begin = (os.getpid(), max(1, n_cores() // workers), heard)
    pool = ProcessPoolExecutor(workers, context, _begin_worker, begin)
    try:
        left = {pool.submit(_work, trial, size, folder) for trial in trials}
        while left:
            done, left = wait(left, timeout=LOOK_SECONDS, return_when=FIRST_EXCEPTION)
            while not heard.empty():
                progress.trial(*heard.get())
            for future in done:
                future.result()  # raises what it raised
        pool.shutdown()
    except BrokenProcessPool:
        raise UnavailableError(
            "the processes that train must live; one was killed, perhaps for want of memory. "
            "What is done is kept; run the same command again."
        ) from None
    finally:
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()  # in the midst of a training, when this was interrupted
        pool.shutdown(cancel_futures=True)


_heard: Any = None
"""In a worker, the queue of what it has to tell."""


def _begin_worker(parent: int, threads: int, heard: Any) -> None:
    global _heard
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what an interrupt means
    die_with_parent(parent)
    torch.set_num_threads(threads)
    _heard = heard


def _work(trial: Trial, size: Size, folder: Path) -> None:
    run_trial(trial, size, folder, lambda key, share: _heard.put((key, share)))


def run_training(
    trial: Trial, training: CloudSet, validation: CloudSet, size: Size, folder: Path, told: Told
) -> Trained:
    """Train a trial's classifier, or go on, or read it back."""
    epochs = trial.epochs(len(training))
    config = TrainConfig(
        model=str(trial.facts["model"]),
        epochs=epochs,
        batch_size=size.batch_size,
        patience=max(1, round(size.patience * epochs)),
        seed=int(trial.facts["seed"]),
    )

    def after(epoch: Epoch) -> None:
        told(trial.key, 0.95 * epoch.number / epochs)  # the rest is testing

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


def as_many_clouds(passes: int, n_clouds: int) -> int:
    """Return in how many epochs a set of clouds comes to about this many clouds shown."""
    return max(1, round(passes / n_clouds))


def as_many_epochs(epochs: int, n_clouds: int) -> int:
    """Return the epochs, however many clouds there are."""
    return epochs


def some(clouds: CloudSet, most: int) -> CloudSet:
    """Return at most this many of the clouds, drawn at random."""
    return clouds.thinned(np.zeros(len(clouds)), most, seed=0)
