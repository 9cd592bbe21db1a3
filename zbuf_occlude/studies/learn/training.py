"""Training loop for any model, its checkpoints and the folder of the trained model."""

import hashlib
import math
import pickle
import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch.nn import functional

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import as_vectors
from zbuf_occlude.base.errors import ArgumentError, DatasetError, OptionError, UnavailableError
from zbuf_occlude.datasets.records import pad_or_truncate
from zbuf_occlude.datasets.torch import Compose, Jitter, Rescale, Rotate
from zbuf_occlude.studies.learn.data import CloudSet
from zbuf_occlude.studies.learn.evaluation import predict
from zbuf_occlude.studies.learn.models import find_model
from zbuf_occlude.studies.learn.networks import Classifier, positive

CHECKPOINT, MODEL, HISTORY = "checkpoint.pt", "model.pt", "history.json"
CHECKPOINT_SECONDS = 60.0
"""Minimum seconds between two checkpoints: writing one of a large model takes seconds."""
_RANGES = {
    "epochs": (1, 2**31 - 1),
    "batch_size": (2, 2**31 - 1),
    "patience": (1, 2**31 - 1),
    "seed": (0, 2**63 - 1),  # PyTorch's largest seed
    "n_points": (1, 2**31 - 1),
}


@dataclass(frozen=True)
class TrainConfig:
    """Configuration of a training: everything that decides its outcome, except the clouds.

    Raises OptionError for a value out of range, or an unknown model.
    """

    model: str = "voxnet"  # name in the table of models
    epochs: int = 100  # maximum; the learning rate falls to 0 along half a cosine over them
    batch_size: int = 32  # clouds per step
    learning_rate: float = 0.001  # initial learning rate of Adam
    patience: int = 20  # epochs without a better validation after which training stops
    seed: int = 0  # seed of initial weights, order of the clouds, augmentation and dropout
    rotate: bool = True  # augmentation: rotation about the vertical axis, as in the paper (4.3)
    rescale: bool = True  # augmentation: scaling, but not of clouds in metres, whose sizes count
    jitter: bool = True  # augmentation: noise on each coordinate
    n_points: int | None = None  # points per cloud, drawn at random once; None: all
    device: str = "auto"  # "auto" (CUDA where there is one), "cpu", "cuda", "cuda:1" and so on
    mixed_precision: bool = True  # automatic mixed precision, on CUDA only

    def __post_init__(self) -> None:
        find_model(self.model)
        for name, (lowest, highest) in _RANGES.items():
            value = getattr(self, name)
            if value is not None and value < lowest:
                raise OptionError(f"{name} must be at least {lowest}; got {value}.")
            if value is not None and value > highest:
                raise OptionError(f"{name} must be at most {highest:,}; got {value:,}.")
        if not 0.0 < self.learning_rate < float("inf"):
            raise OptionError(f"learning_rate must be a positive number; got {self.learning_rate}.")

    def augmentation(self, scale: str = "cloud") -> Compose:
        """Return the random transforms that are applied to each cloud of a scale, of longest side 1, in each epoch."""
        rescale = self.rescale and scale != "metres"
        switches = ((self.rotate, Rotate()), (rescale, Rescale()), (self.jitter, Jitter()))
        return Compose([transform for wanted, transform in switches if wanted])

    def to_dict(self) -> dict[str, Any]:
        """All values as plain data; ``TrainConfig(**document)`` reads them back."""
        return asdict(self)

    def find_device(self) -> torch.device:
        """Return the device to train on.

        Raises OptionError for an unknown name; UnavailableError where CUDA is requested and not available.
        """
        name = ("cuda" if torch.cuda.is_available() else "cpu") if self.device == "auto" else self.device
        if not re.fullmatch(r"cpu|cuda(:[0-9]+)?", name):
            raise OptionError(f"device must be auto, cpu, cuda or cuda:N; got {self.device!r}.")
        if name != "cpu" and int(name.partition(":")[2] or 0) >= torch.cuda.device_count():
            raise UnavailableError(
                f"device {name!r} is not available: PyTorch sees {torch.cuda.device_count()} CUDA devices. Use 'cpu'."
            )
        return torch.device(name)


@dataclass(frozen=True)
class Epoch:
    """Results of one pass over the training clouds."""

    number: int  # from 1
    loss: float  # mean over the steps, with regulariser and augmentation
    validation_loss: float  # cross-entropy, without augmentation
    validation_accuracy: float

    def better_than(self, other: "Epoch | None") -> bool:
        """Return whether the validation accuracy is higher, or equal with a lower loss."""
        mine = (self.validation_accuracy, -self.validation_loss)
        return other is None or mine > (other.validation_accuracy, -other.validation_loss)


class TimeUp(Exception):  # noqa: N818  (a stop, not an error)
    """Stop of a training or study whose time is up; the same call continues."""


@dataclass(frozen=True, eq=False)
class Trained:
    """A trained classifier."""

    model: Classifier  # with the weights of the best epoch, in evaluation mode
    config: TrainConfig
    classes: tuple[str, ...]
    n_points: int  # of each cloud of the training
    history: tuple[Epoch, ...]
    best: Epoch
    seconds: float  # spent training and validating, in all runs together

    def __repr__(self) -> str:
        said = f"{self.best.validation_accuracy:.1%} in validation, epoch {self.best.number} of {len(self.history)}"
        return f"Trained({self.config.model}, {len(self.classes)} classes, {said})"

    def predict(self, points: ArrayLike) -> str:
        """Return the class of one cloud (n, 3), z up, in any unit: the most probable one of `probabilities`."""
        shares = self.probabilities(points)
        return max(shares, key=shares.__getitem__)

    def probabilities(self, points: ArrayLike) -> dict[str, float]:
        """Return the probability of each class for one cloud.

        Parameters
        ----------
        points : (n, 3) float
            z up, in any place and unit: the network centres and scales them; in metres for a model that was trained on
            clouds in metres. The network gets as many points as in training: some are drawn at random, or some repeat.

        Raises
        ------
        ArgumentError
            The points are not (n, 3), not finite, or none.
        """
        cloud = as_vectors(points, "points")
        if not len(cloud):
            raise ArgumentError("points must be (n, 3), n at least 1; there are none.")
        cloud = cloud - (cloud.min(axis=0) + cloud.max(axis=0)) / 2.0  # in float64: the networks' float32 would round
        shuffled = np.random.default_rng(self.config.seed).permutation(cloud)
        shuffled = pad_or_truncate(shuffled, self.n_points)
        unknown = np.array([np.nan])
        logits = predict(
            self.model,
            CloudSet(shuffled[None], np.zeros(1, int), self.classes, np.zeros(1, int), unknown, scale="mesh"),
        )
        shares = torch.softmax(torch.from_numpy(logits[0]), dim=0).tolist()
        return dict(zip(self.classes, shares, strict=True))


def train(
    config: TrainConfig,
    training: CloudSet,
    validation: CloudSet,
    folder: Path,
    *,
    progress: Callable[[Epoch], None] = lambda epoch: None,
    checkpoint_seconds: float = CHECKPOINT_SECONDS,
) -> Trained:
    """Train a classifier, resume an interrupted training, or load a finished one.

    Both sets must have the same classes; `validation` decides which epoch is best and when to stop. The folder is
    created where it is missing. It holds the checkpoint and, at the end, the model and its history. `progress` is
    called after each epoch. Checkpoints are written at the ends of epochs; an interrupt (Ctrl-C), or `TimeUp` raised by
    `progress`, writes the last one.

    All random draws follow from the seed and the number of the epoch, so a resumed training repeats an uninterrupted
    one. On a CPU the weights are equal to the last bit for the same number of threads; on CUDA as far as its kernels
    are deterministic. The paper does not describe its training. Adam with a learning rate of 0.001 follows PointNet and
    3DmFV, and is used for VoxNet too.

    Raises
    ------
    ArgumentError
        Fewer than two clouds to train on, none to validate with, fewer than two classes, or different classes.
    DatasetError
        The folder holds another training.
    MemoryError
        The clouds, or a step of the training, do not fit into memory.
    OptionError
        The loss became infinite or NaN, or `n_points` is more than the clouds have.
    UnavailableError
        The device is not available.
    """
    training, validation = _checked(config, training, validation)
    device = config.find_device()
    fingerprint = _fingerprint(config, training, validation)
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / MODEL).exists():
        _refuse_another(folder, _read(folder / MODEL, torch.device("cpu")), fingerprint, config)
        return load_trained(folder, config.device)
    what = f"{len(training)} clouds, and {config.batch_size} clouds of {training.n_points} points a step"
    with torch.random.fork_rng(devices=[device] if device.type == "cuda" else []), _in_memory(what):
        run = _Run(config, training, validation, device)
        if (folder / CHECKPOINT).exists():
            document = _read(folder / CHECKPOINT, device)
            _refuse_another(folder, document, fingerprint, config)
            with _naming(folder / CHECKPOINT):
                run.restore(document)
        about: dict[str, Any] = {"config": config.to_dict(), "fingerprint": fingerprint}
        written, finished = time.monotonic(), run.to_dict()
        try:
            while not run.done:
                epoch = run.epoch()
                finished = run.to_dict()
                progress(epoch)
                if time.monotonic() - written >= checkpoint_seconds and not run.done:
                    _write(folder / CHECKPOINT, finished | about)
                    written = time.monotonic()
            about |= {"classes": list(training.classes), "n_points": training.n_points}
            about |= {name: finished[name] for name in ("history", "best", "seconds")}
            atomic.write_json(folder / HISTORY, about)
            # last: the presence of this file marks the training as finished
            _write(folder / MODEL, about | {"weights": run.best_weights})
            (folder / CHECKPOINT).unlink(missing_ok=True)
        except (KeyboardInterrupt, TimeUp):
            if finished["history"] and not (folder / MODEL).exists():
                _write(folder / CHECKPOINT, finished | about)
            raise
    for path in atomic.leftovers([folder]):
        path.unlink(missing_ok=True)
    return load_trained(folder, config.device)


class _Run:
    """State of a training between two epochs."""

    def __init__(self, config: TrainConfig, training: CloudSet, validation: CloudSet, device: torch.device) -> None:
        self.config, self.validation, self.device = config, validation, device
        torch.manual_seed(config.seed)
        self.model = find_model(config.model).build(len(training.classes)).to(device)
        self.optimizer = torch.optim.Adam(self.model.parameters(), config.learning_rate, fused=True)
        self.half = config.mixed_precision and device.type == "cuda"
        self.scaler = torch.amp.GradScaler(device.type, enabled=self.half)
        parts = torch.from_numpy(training.positions).split(1024)
        self.augment, in_metres = config.augmentation(training.scale), training.scale == "metres"
        for part in parts if in_metres else ():
            self.model.keep_sizes(part.to(device))
        self.points = torch.cat([self.model.normalise(part.to(device)) for part in parts])
        self.sizes = torch.ones(len(self.points), 1, 1, device=device)
        if in_metres:
            self.sizes = positive(self.model.extents(self.points))
        self.labels = torch.from_numpy(training.labels).to(device)
        self.history: list[Epoch] = []
        self.best: Epoch | None = None
        self.best_weights: dict[str, torch.Tensor] = {}
        self.seconds = 0.0

    @property
    def done(self) -> bool:
        """True if all epochs are over, or `patience` epochs passed without a better one."""
        since = len(self.history) - (self.best.number if self.best else 0)
        return len(self.history) == self.config.epochs or since >= self.config.patience

    def to_dict(self) -> dict[str, Any]:
        """A copy of all that the next epoch depends on; that epoch may be interrupted half way."""
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
        """Restore the state that `to_dict` returned."""
        self.model.load_state_dict(document["weights"])
        self.optimizer.load_state_dict(document["optimizer"])
        if document["scaler"]:  # of a training begun on a CPU it is empty
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
        _check_finite(epoch.validation_loss, number)  # a divergence in the last step shows only here
        if epoch.better_than(self.best):
            self.best = epoch
            self.best_weights = {name: value.clone() for name, value in self.model.state_dict().items()}
        self.history.append(epoch)
        self.seconds += time.perf_counter() - start
        return epoch

    def _pass(self, number: int) -> float:
        """Train on all clouds once; return the mean loss."""
        self.model.train()
        losses = []
        batches = torch.randperm(len(self.points)).to(self.device).split(self.config.batch_size)
        if len(batches[-1]) == 1:
            batches = batches[:-1]  # batch normalisation needs two clouds; each epoch leaves out another one
        for step, chosen in enumerate(batches):
            done = (number - 1 + step / len(batches)) / self.config.epochs
            self.model.anneal_momentum(done)
            for group in self.optimizer.param_groups:
                group["lr"] = self.config.learning_rate * 0.5 * (1.0 + math.cos(math.pi * done))
            points = self._augmented(self.points[chosen] / self.sizes[chosen]) * self.sizes[chosen]
            with torch.autocast(self.device.type, torch.float16, enabled=self.half):
                loss = self.model.loss(points, self.labels[chosen])
            self.optimizer.zero_grad()
            self.scaler.scale(loss).backward()
            self.scaler.step(self.optimizer)
            self.scaler.update()
            losses.append(loss.detach())
        return float(torch.stack(losses).mean())

    def _augmented(self, clouds: torch.Tensor) -> torch.Tensor:
        """Return the clouds (b, n, 3), each with random changes of its own."""
        if clouds.is_cuda:
            return self.augment(clouds)
        return torch.stack([self.augment(cloud) for cloud in clouds])  # the draws of the published results


def hold_out(clouds: CloudSet, share: float, seed: int) -> tuple[CloudSet, CloudSet]:
    """Split the clouds by object or sweep: the rest, and those of a random share (at least one) for validation.

    Raises ArgumentError where there is only one object or sweep.
    """
    objects = np.unique(clouds.group_ids)
    if len(objects) < 2:
        raise ArgumentError(
            "The only object cannot be held out for validation. Give a dataset of more objects, or with a split val."
        )
    taken = np.random.default_rng(seed).permutation(objects)[: max(1, round(share * len(objects)))]
    held = np.isin(clouds.group_ids, taken)
    return clouds.subset(~held), clouds.subset(held)


@contextmanager
def _in_memory(what: str) -> Iterator[None]:
    """Raise MemoryError for PyTorch's own errors of exhausted memory; on a CPU only the message tells them apart."""
    try:
        yield
    except RuntimeError as error:
        if not isinstance(error, torch.OutOfMemoryError) and "can't allocate memory" not in str(error):
            raise
        raise MemoryError(what) from None


def _check_finite(loss: float, number: int) -> None:
    if not math.isfinite(loss):
        raise OptionError(f"The loss is {loss} in epoch {number}; it must stay finite. Lower the learning rate.")


def _checked(config: TrainConfig, training: CloudSet, validation: CloudSet) -> tuple[CloudSet, CloudSet]:
    """Check both sets; return them with the number of points of the configuration."""
    if len(training) < 2 or not len(validation):
        raise ArgumentError(
            f"training needs at least 2 clouds and validation at least 1; got {len(training)} and {len(validation)}."
        )
    if training.classes != validation.classes:
        raise ArgumentError(
            "training and validation must have the same classes; "
            f"got {', '.join(training.classes)} and {', '.join(validation.classes)}."
        )
    if training.scale == "metres" and not validation.keeps_size:
        raise ArgumentError(
            f"validation must be in metres, as the training is; its scale is {validation.scale}. Generate it with "
            "--scale metres."
        )
    if len(training.classes) < 2:
        raise ArgumentError(
            f"training needs at least 2 classes; the clouds have {', '.join(training.classes)}. If "
            "`generate` was given the folder of one class, give it the folder above."
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
            raise OptionError(
                f"n_points must be at most {clouds.n_points}, the points of a cloud; got {config.n_points}."
            )
    return training.select_points(config.n_points, config.seed), validation.select_points(config.n_points, config.seed)


def _refuse_another(folder: Path, document: dict[str, Any], fingerprint: str, config: TrainConfig) -> None:
    """Raise DatasetError where a document was written with other clouds or another configuration."""
    if document["fingerprint"] != fingerprint:
        theirs = document["config"]
        different = [name for name, value in config.to_dict().items() if theirs.get(name) != value]
        raise DatasetError(
            f"{folder} must be empty or hold this same training; it holds one with other "
            f"{', '.join(different) or 'clouds'}. Choose another folder, or delete it."
        )


# ---- files of a training ---------------------------------------------------------------------------------------------


def _fingerprint(config: TrainConfig, training: CloudSet, validation: CloudSet) -> str:
    """Return a digest of everything that decides the outcome of a training."""
    digest = hashlib.sha256(repr(sorted(config.to_dict().items())).encode())
    for clouds in (training, validation):
        digest.update(repr((clouds.classes, clouds.positions.shape, clouds.scale)).encode())
        digest.update(clouds.positions.data)
        digest.update(clouds.labels.data)
    return digest.hexdigest()


def _write(path: Path, document: dict[str, Any]) -> None:
    """Write tensors and plain data atomically."""
    atomic.write(path, lambda file: torch.save(document, file))


def _read(path: Path, device: torch.device) -> dict[str, Any]:
    """Read a file that `_write` wrote.

    Raises DatasetError where the file is damaged; OSError where it is missing.
    """
    try:
        document: dict[str, Any] = torch.load(path, map_location=device, weights_only=True)
    except (RuntimeError, EOFError, KeyError, ValueError, OSError, pickle.UnpicklingError) as error:
        if isinstance(error, OSError) and error.filename is not None:
            raise  # missing or not readable; an error without a file name means a truncated file
        reason = str(error).splitlines()[0][:100] if str(error) else type(error).__name__
        raise DatasetError(f"{path} is damaged: it cannot be read ({reason}). Delete it and train again.") from None
    if not isinstance(document, dict) or not {"fingerprint", "config"} <= document.keys():
        raise DatasetError(f"{path} was not written by `train`. Give a folder that `train` wrote.")
    return document


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Raise DatasetError, with the file's name, where a part of its document is missing or of another network."""
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        reason = f"no {error}" if isinstance(error, KeyError) else str(error).splitlines()[0][:100]
        raise DatasetError(
            f"{path} does not match this version's network ({reason}). Delete it and train again."
        ) from None


def load_trained(folder: Path, device: str = "auto") -> Trained:
    """Read the model that a training wrote into its folder; `device` as in `TrainConfig`.

    Raises DatasetError where the model is missing or its file is damaged.
    """
    path = folder / MODEL
    if not path.exists():
        unfinished = (
            " Its training is not finished; run the same command again." if (folder / CHECKPOINT).exists() else ""
        )
        raise DatasetError(
            f"{folder} must hold a trained model; it has no {MODEL}.{unfinished or ' See zbuf-occlude train --help.'}"
        )
    where = TrainConfig(device=device).find_device()
    document = _read(path, where)
    with _naming(path):
        config, classes = TrainConfig(**document["config"]), tuple(document["classes"])
        with torch.random.fork_rng(devices=[]):
            model = find_model(config.model).build(len(classes))
        model.load_state_dict(document["weights"])
        history = tuple(Epoch(**epoch) for epoch in document["history"])
        best, seconds, n_points = Epoch(**document["best"]), float(document["seconds"]), int(document["n_points"])
    return Trained(model.to(where).eval(), config, classes, n_points, history, best, seconds)
