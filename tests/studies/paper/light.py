"""A network of two layers in place of the paper's, for tests of studies."""

from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import nn

from zbuf_occlude.studies.learn import models
from zbuf_occlude.studies.learn.networks import Classifier
from zbuf_occlude.studies.paper import study

run = study._run_alone


class Light(Classifier):
    """A function of each point, then the maximum; dropout makes results depend on the seed."""

    def __init__(self, n_classes: int) -> None:
        super().__init__(n_classes)
        self.local = nn.Sequential(nn.Linear(3, 32), nn.ReLU())
        self.head = nn.Sequential(nn.Dropout(0.2), nn.Linear(32, n_classes))

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        logits: torch.Tensor = self.head(self.local(points).amax(dim=1))
        return logits


def put_in_place(patch: pytest.MonkeyPatch) -> None:
    """Replace every model by the light one, in this process and in those that train."""
    factory = f"{__name__}:{Light.__name__}"
    rows = tuple(replace(row, factory=factory, options={}) for row in models.MODELS)
    patch.setattr(models, "MODELS", rows)
    patch.setattr(study, "_run_alone", run_alone)


def run_alone(*given: Any) -> bool:
    """Run a trial in a child process with the light models."""
    put_in_place(pytest.MonkeyPatch())
    return run(*given)
