"""Table of the classifiers; a new one takes one class and one row. This module needs no PyTorch."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import TYPE_CHECKING, Any

from zbuf_occlude.base.documents import as_path
from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.base.extras import importing

if TYPE_CHECKING:
    from zbuf_occlude.studies.learn.networks import Classifier
    from zbuf_occlude.studies.learn.training import Trained


@dataclass(frozen=True)
class Model:
    """A row of the table."""

    name: str  # as typed at the command line
    summary: str
    factory: str  # "module:class", imported when the network is built
    options: Mapping[str, Any] = field(default_factory=dict)  # passed to the class with the number of classes

    def build(self, n_classes: int) -> "Classifier":
        """Return the network with initial weights drawn by PyTorch's default generator.

        Raises UnavailableError where PyTorch is not installed.
        """
        require_torch()
        module, name = self.factory.split(":")
        network: Classifier = getattr(import_module(module), name)(n_classes, **self.options)
        return network


_HERE = "zbuf_occlude.studies.learn.networks"
MODELS = (
    Model("voxnet", "3D convolutions on an occupancy grid of 32^3", f"{_HERE}:VoxNet"),
    Model("pointnet", "a function of each point, then the maximum", f"{_HERE}:PointNet"),
    Model(
        "threedmfv",
        "3D inception network on Fisher vectors of 8^3 Gaussians (3DmFV)",
        f"{_HERE}:ThreeDmFV",
        {"n_gaussians": 8},
    ),
    Model("threedmfv5", "the same on 5^3 Gaussians, several times as fast", f"{_HERE}:ThreeDmFV", {"n_gaussians": 5}),
    Model(
        "threedmfv5-small",
        "the same with a quarter of the filters, eight times as fast again; not the paper's network",
        f"{_HERE}:ThreeDmFV",
        {"n_gaussians": 5, "n_filters": 16},
    ),
)


def find_model(name: str) -> Model:
    """Return the row of a name; raises OptionError where there is none."""
    for model in MODELS:
        if model.name == name:
            return model
    raise OptionError(f"model must be one of {', '.join(model.name for model in MODELS)}; got {name!r}.")


def load_classifier(folder: str | os.PathLike[str], device: str = "auto") -> "Trained":
    """Load the classifier that `zbuf-occlude train` wrote to a folder; ``load_classifier(folder).predict(points)``.

    Parameters
    ----------
    folder : path-like
    device : str
        "auto" (CUDA where there is one), "cpu", "cuda", "cuda:1" and so on.

    Raises
    ------
    ArgumentError
        The folder is no path.
    DatasetError
        The folder has no model, or its file is damaged.
    UnavailableError
        PyTorch or the device is missing.

    Examples
    --------
    >>> model = zo.load_classifier("pointnet")
    >>> model.predict(zo.occlude("chair.off", azimuth=30, elevation=20, n_points=256).points)
    'chair'
    """
    folder = as_path(folder, "folder")
    require_torch()
    from zbuf_occlude.studies.learn.training import load_trained  # late: imports PyTorch

    return load_trained(folder, device)


def require_torch() -> None:
    """Import PyTorch; raises UnavailableError where it is missing or broken."""
    with importing("torch", "a classifier"):
        _ = import_module("torch").Tensor  # an empty folder named torch can be imported too
