"""Training: one loop that knows no model, and what it leaves in its folder: checkpoints, then the trained model."""

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
from torch.nn import functional

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.torch import Compose, Jitter, Rescale, Rotate
from zbuf_occlude.errors import ArgumentError, DatasetError, OptionError, UnavailableError
from zbuf_occlude.learn.data import CloudSet
from zbuf_occlude.learn.evaluation import predict
from zbuf_occlude.learn.models import find_model
from zbuf_occlude.learn.networks import Classifier

CHECKPOINT, MODEL, HISTORY = "checkpoint.pt", "model.pt", "history.json"
CHECKPOINT_SECONDS = 60.0
"""Between two checkpoints, at least: a large model's takes seconds to write."""
_RANGES = {
    "epochs": (1, 2**31 - 1),
    "batch_size": (2, 2**31 - 1),
    "patience": (1, 2**31 - 1),
    "seed": (0, 2**63 - 1),  # more is not a seed to PyTorch
    "n_points": (1, 2**31 - 1),
}


@dataclass(frozen=True)
class TrainConfig:
    """How a classifier is trained: everything but the clouds that decides the outcome.

    Raises OptionError for a value out of range, or an unknown model.
    """

    model: str = "voxnet"  # name in the table of models
    epochs: int = 100  # at most; the learning rate falls to 0 along half a cosine over these
    batch_size: int = 32  # clouds of a step
    learning_rate: float = 0.001  # of Adam, initial
    patience: int = 20  # epochs without a better validation after which training stops
    seed: int = 0  # of the first weights, the order of the clouds, the augmentation, and dropout
    rotate: bool = True  # the paper's augmentation (4.3): about the vertical axis
    rescale: bool = True  # by a factor
    jitter: bool = True  # of each coordinate
    n_points: int | None = None  # of each cloud, drawn at random once; None: all
    device: str = "auto"  # "auto" (CUDA where there is one), "cpu", "cuda", "cuda:1" and so on
    mixed_precision: bool = True  # half precision where it is safe, on CUDA only

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

    @property
    def augmentation(self) -> Compose:
        """The transforms that each cloud goes through each time it is seen."""
        switches = ((self.rotate, Rotate()), (self.rescale, Rescale()), (self.jitter, Jitter()))
        return Compose([transform for wanted, transform in switches if wanted])

    def to_dict(self) -> dict[str, Any]:
        """The values as plain data; ``TrainConfig(**document)`` reads them back."""
        return asdict(self)

    def find_device(self) -> torch.device:
        """Return the device to train on.

        Raises OptionError where there is no device of this name, UnavailableError where CUDA was asked for and is not
        there.
        """
        name = ("cuda" if torch.cuda.is_available() else "cpu") if self.device == "auto" else self.device
        if not re.fullmatch(r"cpu|cuda(:[0-9]+)?", name):
            raise OptionError(f"device must be auto, cpu, cuda or cuda:N; got {self.device!r}.")
        if name != "cpu" and int(name.partition(":")[2] or 0) >= torch.cuda.device_count():
            raise UnavailableError(
                f"device {name!r} must be there; PyTorch sees {torch.cuda.device_count()} CUDA devices. Take 'cpu'."
            )
        return torch.device(name)


@dataclass(frozen=True)
class Epoch:
    """What one pass over the training clouds gave."""

    number: int  # from 1
    loss: float  # mean over the steps, regulariser included, clouds augmented
    validation_loss: float  # cross-entropy, nothing augmented
    validation_accuracy: float

    def better_than(self, other: "Epoch | None") -> bool:
        """Whether more of the validation was right, or as much with less loss."""
        mine = (self.validation_accuracy, -self.validation_loss)
        return other is None or mine > (other.validation_accuracy, -other.validation_loss)


@dataclass(frozen=True, eq=False)
class Trained:
    """A trained classifier."""

    model: Classifier  # with the weights of the best epoch, in evaluation mode
    config: TrainConfig
    classes: tuple[str, ...]
    history: tuple[Epoch, ...]
    best: Epoch
    seconds: float  # spent training and validating, in all runs together


def train(
    config: TrainConfig,
    training: CloudSet,
    validation: CloudSet,
    folder: Path,
    *,
    progress: Callable[[Epoch], None] = lambda epoch: None,
    checkpoint_seconds: float = CHECKPOINT_SECONDS,
) -> Trained:
    """Train a classifier, or resume a training that was stopped, or return one that is done.

    Both sets have the same classes; `validation` decides which epoch is best and when to stop. The folder is made when
    missing; it holds the checkpoint, and in the end the model and its history. `progress` is called with each epoch
    that was done. Checkpoints are written at the ends of epochs; an interrupt (Ctrl-C) writes that of the last one.

    Everything random is drawn from the seed and the epoch's number, so an epoch is the same whether or not the
    training was stopped before it. On a CPU the weights are the same to the last bit, with the same number of threads;
    on CUDA as far as its kernels are deterministic. The paper does not say how it trained: Adam with 0.001 is that of
    PointNet and of 3DmFV, also for VoxNet.

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
            about |= {"classes": list(training.classes)}
            about |= {name: finished[name] for name in ("history", "best", "seconds")}
            atomic.write_json(folder / HISTORY, about)
            _write(folder / MODEL, about | {"weights": run.best_weights})  # last: it says that the training is done
            (folder / CHECKPOINT).unlink(missing_ok=True)
        except KeyboardInterrupt:
            if finished["history"] and not (folder / MODEL).exists():
                _write(folder / CHECKPOINT, finished | about)
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

    def to_dict(self) -> dict[str, Any]:
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
    """Take a share of the objects out, at least one, with all their clouds, to validate with.

    Returns the rest, and what was taken out. Raises ArgumentError where there is only one object.
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
        different = [name for name, value in config.to_dict().items() if theirs.get(name) != value]
        raise DatasetError(
            f"{folder} must be empty or of this same training; it holds one with other "
            f"{', '.join(different) or 'clouds'}. Choose another folder, or delete it."
        )


# ---- files of a training ---------------------------------------------------------------------------------------------


def _fingerprint(config: TrainConfig, training: CloudSet, validation: CloudSet) -> str:
    """Return a digest of all that decides a training's outcome."""
    digest = hashlib.sha256(repr(sorted(config.to_dict().items())).encode())
    for clouds in (training, validation):
        digest.update(repr((clouds.classes, clouds.positions.shape)).encode())
        digest.update(clouds.positions.data)
        digest.update(clouds.labels.data)
    return digest.hexdigest()


def _write(path: Path, document: dict[str, Any]) -> None:
    """Write tensors and plain data, all or nothing."""
    atomic.write(path, lambda file: torch.save(document, file))


def _read(path: Path, device: torch.device) -> dict[str, Any]:
    """Read what `_write` wrote.

    Raises DatasetError where the file is damaged; OSError where there is none.
    """
    try:
        document: dict[str, Any] = torch.load(path, map_location=device, weights_only=True)
    except (RuntimeError, EOFError, KeyError, ValueError, OSError, pickle.UnpicklingError) as error:
        if isinstance(error, OSError) and error.filename is not None:
            raise  # there is no such file, or it must not be read; without a name the file's end came too early
        reason = str(error).splitlines()[0][:100] if str(error) else type(error).__name__
        raise DatasetError(
            f"{path} must be a file that training wrote; it cannot be read ({reason}). Delete it and train again."
        ) from None
    if not isinstance(document, dict) or not {"fingerprint", "config"} <= document.keys():
        raise DatasetError(f"{path} must be a file that training wrote; it is another. Name a folder of `train`.")
    return document


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Name the file of a document that could be read, but whose parts are not those expected.

    Raises DatasetError where a part is missing, or not of this network.
    """
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        reason = f"no {error}" if isinstance(error, KeyError) else str(error).splitlines()[0][:100]
        raise DatasetError(
            f"{path} must be as this version's training wrote it; it is not ({reason}). Delete it and train again."
        ) from None


def load_trained(folder: Path, device: str = "auto") -> Trained:
    """Read back the model that a training left in its folder; `device` as in `TrainConfig`.

    Raises DatasetError where there is none, or its file is damaged.
    """
    path = folder / MODEL
    if not path.exists():
        unfinished = " Its training is not done; run the same command again." if (folder / CHECKPOINT).exists() else ""
        raise DatasetError(
            f"{folder} must hold a trained model; it has no {MODEL}.{unfinished or ' See: zbuf-occlude train --help'}"
        )
    where = TrainConfig(device=device).find_device()
    document = _read(path, where)
    with _naming(path):
        config, classes = TrainConfig(**document["config"]), tuple(document["classes"])
        with torch.random.fork_rng(devices=[]):
            model = find_model(config.model).build(len(classes))
        model.load_state_dict(document["weights"])
        history = tuple(Epoch(**epoch) for epoch in document["history"])
        best, seconds = Epoch(**document["best"]), float(document["seconds"])
    return Trained(model.to(where).eval(), config, classes, history, best, seconds)
