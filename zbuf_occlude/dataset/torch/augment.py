"""The paper's augmentations (4.3): rotation about the vertical axis, scaling, jitter; (n, 3 or more) tensor to tensor.

Columns after the third are what points have besides their positions, and stay, but for normals.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch

from zbuf_occlude.errors import OptionError

Transform = Callable[[torch.Tensor], torch.Tensor]


@dataclass(frozen=True)
class Rotate:
    """Turn a cloud about the z axis by an angle uniform in [-angle, angle] (radians; all round by default).

    With `normals` columns 3 to 5 are normals, and turn along.
    """

    angle: float = math.pi
    normals: bool = False

    def __call__(self, cloud: torch.Tensor) -> torch.Tensor:
        """Return the changed cloud; the one given stays."""
        turn = (2.0 * float(torch.rand(())) - 1.0) * self.angle
        c, s = math.cos(turn), math.sin(turn)
        matrix = cloud.new_tensor([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        n_turned = 6 if self.normals else 3
        # one product for each, of one shape: a larger one would round otherwise on some processors
        turned = [cloud[:, first : first + 3].contiguous() @ matrix for first in range(0, n_turned, 3)]
        return torch.cat([*turned, cloud[:, n_turned:]], dim=1)


@dataclass(frozen=True)
class Rescale:
    """Multiply a cloud by a factor uniform in [low, high], PointNet++'s range by default."""

    low: float = 0.8
    high: float = 1.25

    def __post_init__(self) -> None:
        if not 0.0 < self.low <= self.high < math.inf:
            raise OptionError(f"a scale must run upwards from above 0; got {self.low}..{self.high}.")

    def __call__(self, cloud: torch.Tensor) -> torch.Tensor:
        """Return the changed cloud; the one given stays."""
        factor = self.low + (self.high - self.low) * float(torch.rand(()))
        return torch.cat([cloud[:, :3] * factor, cloud[:, 3:]], dim=1)


@dataclass(frozen=True)
class Jitter:
    """Move every coordinate by Gaussian noise, clipped; PointNet's by default, for clouds whose longest side is 1."""

    sigma: float = 0.01
    clip: float = 0.05

    def __post_init__(self) -> None:
        if self.sigma < 0.0 or self.clip < 0.0:
            raise OptionError(f"sigma and clip must not be negative; got {self.sigma} and {self.clip}.")

    def __call__(self, cloud: torch.Tensor) -> torch.Tensor:
        """Return the changed cloud; the one given stays."""
        positions = cloud[:, :3]
        moved = positions + (self.sigma * torch.randn_like(positions)).clamp(-self.clip, self.clip)
        return torch.cat([moved, cloud[:, 3:]], dim=1)


@dataclass(frozen=True)
class Compose:
    """Apply transforms one after the other."""

    transforms: Sequence[Transform]

    def __call__(self, cloud: torch.Tensor) -> torch.Tensor:
        """Return the changed cloud; the one given stays."""
        for transform in self.transforms:
            cloud = transform(cloud)
        return cloud


def augmentation(*, normals: bool = False) -> Compose:
    """Return the paper's three: rotation, scaling, jitter; `normals` as in `Rotate`.

    References
    ----------
    Paper 4.3 names them without their parameters; these are those of PointNet and PointNet++ (Qi et al. 2017).
    """
    return Compose((Rotate(normals=normals), Rescale(), Jitter()))
