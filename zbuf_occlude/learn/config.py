"""TrainConfig: everything that decides a training, besides the clouds."""

import re
from dataclasses import asdict, dataclass
from typing import Any

import torch

from zbuf_occlude.dataset.torch import Compose, Jitter, Rescale, Rotate
from zbuf_occlude.errors import OptionError, UnavailableError
from zbuf_occlude.learn.models import find_model

_RANGES = {
    "epochs": (1, 2**31 - 1),
    "batch_size": (2, 2**31 - 1),
    "patience": (1, 2**31 - 1),
    "seed": (0, 2**63 - 1),  # more is not a seed to PyTorch
    "n_points": (1, 2**31 - 1),
}


@dataclass(frozen=True)
class TrainConfig:
    """How a classifier is trained: everything that decides the outcome, besides the clouds.

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

    @property
    def document(self) -> dict[str, Any]:
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
