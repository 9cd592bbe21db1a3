"""3DmFV-Net: Fisher vectors on a grid of Gaussians, then a 3D inception network.

    layer                      output for g = 8 (g = 5)    parameters (K classes)
    3DmFV                      20 x g^3                    -
    inception 64               192 x g^3                   314,432
    inception 128              384 x g^3                   1,295,488
    inception 256              768 x g^3                   5,179,648
    max pool 2                 768 x 4^3 (3^3)             -
    inception 256              768 x 4^3 (3^3)             5,376,256
    inception 512              1,536 x 4^3 (3^3)           20,713,984
    max pool 2                 1,536 x 2^3 (2^3)           -
    linear 1024, dropout 0.3   1024                        12,583,936 + 2,048
    linear 256, dropout 0.3    256                         262,400 + 512
    linear 128, dropout 0.3    128                         32,896 + 256
    linear                     K                           128 K + K

    inception f: a convolution 1^3 to f channels; on these a convolution 3^3 and one 5^3, each to f/2; beside them the
    mean over 3^3, then a convolution 1^3 to f; all four side by side.

After each layer but the last: batch normalisation (counted; the second number of the linear ones) and ReLU. 45,767,016
parameters for K = 40, as many as in the authors' code; 45,756,904 without batch normalisation.

References
----------
Y. Ben-Shabat, M. Lindenbaum, A. Fischer: "3DmFV: Three-Dimensional Point Cloud Classification in Real-Time Using
Convolutional Neural Networks", IEEE RA-L 3(4), 2018; the layers are those of the authors' published code (its
TensorFlow form, which also keeps 5^3 on the smaller grid).
"""

from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional

from zbuf_occlude.errors import OptionError
from zbuf_occlude.learn.classifier import Classifier, unit_sphere
from zbuf_occlude.learn.features import CHANNELS, fisher_vectors
from zbuf_occlude.learn.grid_conv import GridConv


class ThreeDmFV(Classifier):
    """3DmFV-Net (Ben-Shabat et al. 2018).

    Parameters
    ----------
    n_classes : int
    n_gaussians : int
        Gaussians a side: 8 as in the paper's best figures, or 5, the default of its code. Both have the same layers
        and the same number of parameters. At least 5, for the mean over 3^3 on the smaller grid.
    n_filters : int
        Of the first inception module, 64 in the paper; all other widths are multiples of it. Even.

    Raises
    ------
    OptionError
        Fewer Gaussians, or filters that cannot be halved.

    Notes
    -----
    Clouds are scaled into the unit sphere. The order of the points does not matter.
    """

    def __init__(self, n_classes: int, n_gaussians: int = 8, n_filters: int = 64) -> None:
        super().__init__(n_classes)
        if n_gaussians < 5:
            raise OptionError(f"n_gaussians must be at least 5 per side; got {n_gaussians}.")
        if n_filters < 2 or n_filters % 2:
            raise OptionError(f"n_filters must be even and at least 2; got {n_filters}.")
        self.n_gaussians = n_gaussians
        f = n_filters
        self.body = nn.Sequential(
            Inception(CHANNELS, f),
            Inception(3 * f, 2 * f),
            Inception(6 * f, 4 * f),
            nn.MaxPool3d(2, ceil_mode=True),
            Inception(12 * f, 4 * f),
            Inception(12 * f, 8 * f),
            nn.MaxPool3d(2, ceil_mode=True),
        )
        side = -(-n_gaussians // 4)
        head: list[nn.Module] = []
        for n_inputs, n_outputs in pairwise((24 * f * side**3, 16 * f, 4 * f, 2 * f)):
            head += [nn.Linear(n_inputs, n_outputs), nn.BatchNorm1d(n_outputs), nn.ReLU(), nn.Dropout(0.3)]
        self.head = nn.Sequential(*head, nn.Linear(2 * f, n_classes))

    def normalise(self, points: torch.Tensor) -> torch.Tensor:
        """Scale clouds into the unit sphere, their centroids at its centre.

        Parameters
        ----------
        points : (b, n, 3) float32

        Returns
        -------
        (b, n, 3) float32
        """
        return unit_sphere(points)

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Return logits.

        Parameters
        ----------
        points : (b, n, 3) float32

        Returns
        -------
        (b, n_classes) float32
        """
        logits: torch.Tensor = self.head(self.body(fisher_vectors(points, self.n_gaussians)).flatten(1))
        return logits


class Inception(nn.Module):
    """Four views of each cell's neighbourhood side by side: 1^3, 3^3 and 5^3 of it, and the mean.

    Parameters
    ----------
    n_inputs : int
        Channels.
    n_filters : int
        A third of the channels that come out.
    """

    def __init__(self, n_inputs: int, n_filters: int) -> None:
        super().__init__()
        self.cell = _normed(nn.Conv3d(n_inputs, n_filters, 1), n_filters)
        self.narrow = _normed(GridConv(n_filters, n_filters // 2, 3), n_filters // 2)
        self.wide = _normed(GridConv(n_filters, n_filters // 2, 5), n_filters // 2)
        self.mean = _normed(nn.Conv3d(n_inputs, n_filters, 1), n_filters)

    def forward(self, grid: torch.Tensor) -> torch.Tensor:
        """Return (b, 3 n_filters, r, r, r) of a grid (b, n_inputs, r, r, r)."""
        cell = self.cell(grid)
        mean = functional.avg_pool3d(grid, 3, stride=1, padding=1, count_include_pad=False)
        return torch.cat([cell, self.narrow(cell), self.wide(cell), self.mean(mean)], dim=1)


def _normed(convolution: nn.Module, n_outputs: int) -> nn.Sequential:
    return nn.Sequential(convolution, nn.BatchNorm3d(n_outputs), nn.ReLU(inplace=True))
