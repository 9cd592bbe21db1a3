"""What a training leaves in its folder: checkpoints while it runs, the trained model when it is done."""

import hashlib
import pickle
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from zbuf_occlude.dataset import atomic
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.learn.config import TrainConfig
from zbuf_occlude.learn.data import CloudSet
from zbuf_occlude.learn.models import find_model
from zbuf_occlude.learn.networks import Classifier

CHECKPOINT, MODEL, HISTORY = "checkpoint.pt", "model.pt", "history.json"


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


def fingerprint_of(config: TrainConfig, training: CloudSet, validation: CloudSet) -> str:
    """Return a digest of all that decides a training's outcome."""
    digest = hashlib.sha256(repr(sorted(config.document.items())).encode())
    for clouds in (training, validation):
        digest.update(repr((clouds.classes, clouds.positions.shape)).encode())
        digest.update(clouds.positions.data)
        digest.update(clouds.labels.data)
    return digest.hexdigest()


def write_document(path: Path, document: dict[str, Any]) -> None:
    """Write tensors and plain data, all or nothing."""
    atomic.write(path, lambda file: torch.save(document, file))


def read_document(path: Path, device: torch.device) -> dict[str, Any]:
    """Read what `write_document` wrote.

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
def fitting(path: Path) -> Iterator[None]:
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


def write_trained(
    folder: Path,
    config: TrainConfig,
    classes: Sequence[str],
    fingerprint: str,
    weights: dict[str, torch.Tensor],
    history: Sequence[Epoch],
    best: Epoch,
    seconds: float,
) -> None:
    """Write the history and, last, the model: its file says that the training is done."""
    epochs = [asdict(epoch) for epoch in history]
    document: dict[str, Any] = {"config": config.document, "classes": list(classes), "fingerprint": fingerprint}
    document |= {"history": epochs, "best": asdict(best), "seconds": seconds}
    atomic.write_json(folder / HISTORY, document)
    write_document(folder / MODEL, document | {"weights": weights})
    (folder / CHECKPOINT).unlink(missing_ok=True)


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
    document = read_document(path, where)
    with fitting(path):
        config, classes = TrainConfig(**document["config"]), tuple(document["classes"])
        with torch.random.fork_rng(devices=[]):
            model = find_model(config.model).build(len(classes))
        model.load_state_dict(document["weights"])
        history = tuple(Epoch(**epoch) for epoch in document["history"])
        best, seconds = Epoch(**document["best"]), float(document["seconds"])
    return Trained(model.to(where).eval(), config, classes, history, best, seconds)
