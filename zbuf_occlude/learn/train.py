"""Training: one loop that knows no model. A kill at any moment changes nothing: the same call goes on."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn import functional

from zbuf_occlude.dataset import atomic
from zbuf_occlude.errors import ArgumentError, DatasetError, OptionError
from zbuf_occlude.learn.checkpoint import (
    CHECKPOINT,
    MODEL,
    Epoch,
    Trained,
    fingerprint_of,
    fitting,
    load_trained,
    read_document,
    write_document,
    write_trained,
)
from zbuf_occlude.learn.config import TrainConfig
from zbuf_occlude.learn.data import CloudSet
from zbuf_occlude.learn.evaluate import predict
from zbuf_occlude.learn.models import find_model

CHECKPOINT_SECONDS = 60.0
"""Between two checkpoints, at least: a large model's takes seconds to write."""


def train(
    config: TrainConfig,
    training: CloudSet,
    validation: CloudSet,
    folder: Path,
    *,
    progress: Callable[[Epoch], None] = lambda epoch: None,
    checkpoint_seconds: float = CHECKPOINT_SECONDS,
) -> Trained:
    """Train a classifier, or go on with a training that was stopped, or return one that is done.

    Parameters
    ----------
    config : TrainConfig
    training, validation : CloudSet
        Of the same classes. The second decides which epoch is best and when to stop.
    folder : Path
        Made when missing; holds the checkpoint, and in the end the model and its history.
    progress : callable
        Told of each epoch that was done.
    checkpoint_seconds : float
        Between two checkpoints, at least; they are written at the ends of epochs. An interrupt (Ctrl-C) writes that of
        the last epoch that ended.

    Returns
    -------
    Trained

    Raises
    ------
    ArgumentError
        Fewer than two clouds to train on, none to validate with, fewer than two classes, or different ones.
    DatasetError
        The folder holds another training.
    MemoryError
        The clouds or a step of the training do not fit.
    OptionError
        The loss is not finite any more, or `n_points` is more than the clouds have.
    UnavailableError
        The device is not there.

    Notes
    -----
    Everything random is drawn from the seed and the epoch's number, so an epoch is the same whether or not the
    training was stopped before it. On a CPU the weights are the same to the last bit, with the same number of threads;
    on CUDA as far as its kernels are deterministic. The paper does not say how it trained: Adam with 0.001 is that of
    PointNet and of 3DmFV, also for VoxNet.
    """
    training, validation = _checked(config, training, validation)
    device = config.find_device()
    fingerprint = fingerprint_of(config, training, validation)
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / MODEL).exists():
        _refuse_another(folder, read_document(folder / MODEL, torch.device("cpu")), fingerprint, config)
        return load_trained(folder, config.device)
    what = f"{len(training)} clouds, and {config.batch_size} clouds of {training.n_points} points a step"
    with torch.random.fork_rng(devices=[device] if device.type == "cuda" else []), _in_memory(what):
        run = _Run(config, training, validation, device)
        if (folder / CHECKPOINT).exists():
            document = read_document(folder / CHECKPOINT, device)
            _refuse_another(folder, document, fingerprint, config)
            with fitting(folder / CHECKPOINT):
                run.restore(document)
        about = {"config": config.document, "fingerprint": fingerprint}
        written, finished = time.monotonic(), run.document
        try:
            while not run.done:
                epoch = run.epoch()
                finished = run.document
                progress(epoch)
                if time.monotonic() - written >= checkpoint_seconds and not run.done:
                    write_document(folder / CHECKPOINT, finished | about)
                    written = time.monotonic()
            assert run.best is not None  # there was an epoch
            best = (run.best_weights, run.history, run.best, run.seconds)
            write_trained(folder, config, training.classes, fingerprint, *best)
        except KeyboardInterrupt:
            if finished["history"] and not (folder / MODEL).exists():
                write_document(folder / CHECKPOINT, finished | about)
            raise
    for path in atomic.leftovers([folder]):
        path.unlink(missing_ok=True)
    return load_trained(folder, config.device)


class _Run:
    """A training between two epochs."""

    def __init__(self, config: TrainConfig, training: CloudSet, validation: CloudSet, device: torch.device) -> None:
        self.config, self.validation, self.device = config, validation, device
        torch.manual_seed(config.seed)
        self.model = find_model(config.model).build(len(training.classes)).to(device)
        self.optimizer = torch.optim.Adam(self.model.parameters(), config.learning_rate, fused=True)
        self.half = config.mixed_precision and device.type == "cuda"
        self.scaler = torch.amp.GradScaler(device.type, enabled=self.half)
        parts = torch.from_numpy(training.positions).split(1024)
        self.points = torch.cat([self.model.normalise(part.to(device)) for part in parts])
        self.labels = torch.from_numpy(training.labels).to(device)
        self.history: list[Epoch] = []
        self.best: Epoch | None = None
        self.best_weights: dict[str, torch.Tensor] = {}
        self.seconds = 0.0

    @property
    def done(self) -> bool:
        """Whether all epochs are over, or too many without a better one."""
        since = len(self.history) - (self.best.number if self.best else 0)
        return len(self.history) == self.config.epochs or since >= self.config.patience

    @property
    def document(self) -> dict[str, Any]:
        """Everything that the next epoch depends on, a copy: that epoch may be interrupted half way."""
        return {
            "weights": deepcopy(self.model.state_dict()),
            "optimizer": deepcopy(self.optimizer.state_dict()),
            "scaler": self.scaler.state_dict(),
            "history": [asdict(epoch) for epoch in self.history],
            "best": asdict(self.best) if self.best else None,
            "best_weights": self.best_weights,
            "seconds": self.seconds,
        }

    def restore(self, document: dict[str, Any]) -> None:
        """Take up a document's state."""
        self.model.load_state_dict(document["weights"])
        self.optimizer.load_state_dict(document["optimizer"])
        self.scaler.load_state_dict(document["scaler"])
        self.history = [Epoch(**epoch) for epoch in document["history"]]
        self.best = Epoch(**document["best"]) if document["best"] else None
        self.best_weights, self.seconds = document["best_weights"], document["seconds"]

    def epoch(self) -> Epoch:
        """Train on every cloud once, then validate."""
        start, number = time.perf_counter(), len(self.history) + 1
        torch.manual_seed(int(np.random.SeedSequence([self.config.seed, number]).generate_state(1, np.uint64)[0] >> 1))
        loss = self._pass(number)
        _check_finite(loss, number)
        logits = torch.from_numpy(predict(self.model, self.validation))
        labels = torch.from_numpy(self.validation.labels)
        epoch = Epoch(
            number,
            loss,
            float(functional.cross_entropy(logits, labels)),
            float((logits.argmax(dim=1) == labels).double().mean()),
        )
        _check_finite(epoch.validation_loss, number)  # the last step's harm shows only here
        if epoch.better_than(self.best):
            self.best = epoch
            self.best_weights = {name: value.clone() for name, value in self.model.state_dict().items()}
        self.history.append(epoch)
        self.seconds += time.perf_counter() - start
        return epoch

    def _pass(self, number: int) -> float:
        """One pass over the clouds; returns the mean loss."""
        self.model.train()
        augment, losses = self.config.augmentation, []
        batches = torch.randperm(len(self.points)).split(self.config.batch_size)
        if len(batches[-1]) == 1:
            batches = batches[:-1]  # batch normalisation needs two; it is another cloud in each epoch
        for step, chosen in enumerate(batches):
            done = (number - 1 + step / len(batches)) / self.config.epochs
            self.model.settle(done)
            for group in self.optimizer.param_groups:
                group["lr"] = self.config.learning_rate * 0.5 * (1.0 + math.cos(math.pi * done))
            points = torch.stack([augment(self.points[i]) for i in chosen])
            with torch.autocast(self.device.type, torch.float16, enabled=self.half):
                loss = self.model.loss(points, self.labels[chosen.to(self.device)])
            self.optimizer.zero_grad()
            self.scaler.scale(loss).backward()
            self.scaler.step(self.optimizer)
            self.scaler.update()
            losses.append(loss.detach())
        return float(torch.stack(losses).mean())


def hold_out(clouds: CloudSet, share: float, seed: int) -> tuple[CloudSet, CloudSet]:
    """Take some objects out, with all their clouds, to validate with.

    Parameters
    ----------
    clouds : CloudSet
    share : float
        Of the objects, at least one.
    seed : int

    Returns
    -------
    CloudSet, CloudSet
        What is left, and what was taken out.

    Raises
    ------
    ArgumentError
        There is only one object.
    """
    objects = np.unique(clouds.object_ids)
    if len(objects) < 2:
        raise ArgumentError("one object cannot be held out of one; give a dataset of more, or with clouds to validate.")
    taken = np.random.default_rng(seed).permutation(objects)[: max(1, round(share * len(objects)))]
    held = np.isin(clouds.object_ids, taken)
    return clouds.subset(~held), clouds.subset(held)


@contextmanager
def _in_memory(what: str) -> Iterator[None]:
    """Raise MemoryError where PyTorch has errors of its own for that: one for CUDA, hardly one for the processor."""
    try:
        yield
    except RuntimeError as error:
        if not isinstance(error, torch.OutOfMemoryError) and "can't allocate memory" not in str(error):
            raise
        raise MemoryError(what) from None


def _check_finite(loss: float, number: int) -> None:
    if not math.isfinite(loss):
        raise OptionError(f"the loss must stay finite; in epoch {number} it is {loss}. Lower the learning rate.")


def _checked(config: TrainConfig, training: CloudSet, validation: CloudSet) -> tuple[CloudSet, CloudSet]:
    """Return both sets with the number of points asked for."""
    if len(training) < 2 or not len(validation):
        raise ArgumentError(
            f"training needs 2 clouds and validation 1, at least; got {len(training)} and {len(validation)}."
        )
    if training.classes != validation.classes:
        raise ArgumentError(
            "training and validation must have the same classes; "
            f"got {', '.join(training.classes)} and {', '.join(validation.classes)}."
        )
    if len(training.classes) < 2:
        raise ArgumentError(
            f"training needs 2 classes, at least; the clouds have {', '.join(training.classes)}. Was `generate` given "
            "the folder of one class? Give it the folder above."
        )
    if not set(training.labelled) & set(validation.labelled):
        raise ArgumentError(
            f"training and validation must share a class; training has {', '.join(training.labelled)}, "
            f"validation {', '.join(validation.labelled)}. Generate more objects, with a larger --limit or none."
        )
    if config.n_points is None:
        return training, validation
    for clouds in (training, validation):
        if config.n_points > clouds.n_points:
            raise OptionError(f"n_points must be at most {clouds.n_points}, those of a cloud; got {config.n_points}.")
    return training.select_points(config.n_points, config.seed), validation.select_points(config.n_points, config.seed)


def _refuse_another(folder: Path, document: dict[str, Any], fingerprint: str, config: TrainConfig) -> None:
    """Raise DatasetError for a folder in which other clouds or another config were used."""
    if document["fingerprint"] != fingerprint:
        theirs = document["config"]
        different = [name for name, value in config.document.items() if theirs.get(name) != value]
        raise DatasetError(
            f"{folder} must be empty or of this same training; it holds one with other "
            f"{', '.join(different) or 'clouds'}. Choose another folder, or delete it."
        )
