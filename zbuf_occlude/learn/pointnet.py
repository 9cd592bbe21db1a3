"""PointNet: a function of each point, then the maximum over the points; two networks in it straighten the cloud.

    layer                                output             parameters (K classes)
    T-Net of 3                           3 x 3              803,081
      shared linear 64, 128, 1024; max over points; linear 512, 256; linear 9, plus the identity
    points times it                      n x 3              -
    shared linear 64, 64                 n x 64             256 + 128, 4,160 + 128
    T-Net of 64                          64 x 64            1,857,344
      shared linear 64, 128, 1024; max over points; linear 512, 256; linear 4096, plus the identity
    features times it                    n x 64             -
    shared linear 64, 128, 1024          n x 1024           4,160 + 128, 8,320 + 256, 132,096 + 2,048
    max over points                      1024               -
    linear 512                           512                524,800 + 1,024
    linear 256, dropout 0.3              256                131,328 + 512
    linear                               K                  256 K + K

After each layer but the last ones of the network and of the T-Nets: batch normalisation (the second number) and ReLU.
3,480,049 parameters for K = 40: the paper's 3.5 M (Table 6), T-Nets and batch normalisation counted; 3,467,889 without
the latter.

References
----------
C. R. Qi, H. Su, K. Mo, L. J. Guibas: "PointNet: Deep Learning on Point Sets for 3D Classification and Segmentation",
CVPR 2017; Figure 2, supplementary C.
"""

from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional

from zbuf_occlude.learn.classifier import Classifier, unit_sphere

ORTHOGONALITY = 0.001
"""Weight of the regulariser beside the cross-entropy."""
EPSILON = 1e-5
"""Added to variances, as torch's batch normalisation does."""


class PointNet(Classifier):
    """PointNet (Qi et al. 2017) for classification, both T-Nets.

    Parameters
    ----------
    n_classes : int

    Notes
    -----
    Clouds are scaled into the unit sphere. The order of the points does not matter.
    """

    def __init__(self, n_classes: int) -> None:
        super().__init__(n_classes)
        self.input_transform = TNet(3)
        self.local = shared(3, 64, 64)
        self.feature_transform = TNet(64)
        self.body = shared(64, 64, 128)
        self.pool = MaxLinear(128, 1024)
        self.head = nn.Sequential(shared(1024, 512, 256), nn.Dropout(0.3), nn.Linear(256, n_classes))

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
        return self._logits_and_transform(points)[0]

    def loss(self, points: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
        """Return the cross-entropy and how far the 64 x 64 transforms A are from orthogonal, |I - A A^T|^2.

        Parameters
        ----------
        points : (b, n, 3) float32
        labels : (b,) int64

        Returns
        -------
        () float32

        References
        ----------
        Qi et al. 2017, Eq. 2 (mean over the batch).
        """
        logits, transforms = self._logits_and_transform(points)
        with torch.autocast(points.device.type, enabled=False):  # small differences of products near 1
            transforms = transforms.float()
            defects = torch.eye(64, device=points.device) - transforms @ transforms.transpose(1, 2)
        return functional.cross_entropy(logits, labels) + ORTHOGONALITY * defects.square().sum(dim=(1, 2)).mean()

    def _logits_and_transform(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        features = self.local(points @ self.input_transform(points))
        transforms = self.feature_transform(features)
        return self.head(self.pool(self.body(features @ transforms))), transforms


class TNet(nn.Module):
    """A PointNet that looks at a cloud's features and returns the matrix to multiply them by; at first the identity.

    Parameters
    ----------
    size : int
        Of the square matrix.
    """

    def __init__(self, size: int) -> None:
        super().__init__()
        self.size = size
        self.body = shared(size, 64, 128)
        self.pool = MaxLinear(128, 1024)
        last = nn.Linear(256, size * size)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.head = nn.Sequential(shared(1024, 512, 256), last)

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """Return (b, size, size) of features (b, n, size)."""
        change = self.head(self.pool(self.body(features))).view(-1, self.size, self.size)
        return change + torch.eye(self.size, device=change.device, dtype=change.dtype)


class MaxLinear(nn.Module):
    """Linear, batch normalisation, ReLU, maximum over the points; computed without the first three for every point.

    Parameters
    ----------
    n_inputs, n_outputs : int

    Notes
    -----
    The same function, statistics and gradients as the four one after the other, for about a third of the work of
    training. The normalisation rises or falls with its input, by the sign of its factor, so the point that gives the
    maximum of a channel is found from the product alone, without a gradient, and the layer is then evaluated for these
    points only. Mean and variance over all points follow from those of the inputs: w m + b, and w C w^T for the
    covariance C.
    """

    running_mean: torch.Tensor
    running_variance: torch.Tensor

    def __init__(self, n_inputs: int, n_outputs: int) -> None:
        super().__init__()
        self.momentum = 0.1
        self.linear = nn.Linear(n_inputs, n_outputs)
        self.factor = nn.Parameter(torch.ones(n_outputs))
        self.shift = nn.Parameter(torch.zeros(n_outputs))
        self.register_buffer("running_mean", torch.zeros(n_outputs))
        self.register_buffer("running_variance", torch.ones(n_outputs))

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """Return (b, n_outputs) of features (b, n, n_inputs)."""
        b, n, width = features.shape
        weight, bias = self.linear.weight, self.linear.bias
        rows = features.reshape(-1, width)
        with torch.no_grad():
            rising = torch.where(self.factor < 0.0, -1.0, 1.0)
            best = ((weight * rising[:, None]) @ features.transpose(1, 2)).argmax(dim=2)  # (b, n_outputs)
            best += n * torch.arange(b, device=best.device)[:, None]
        with torch.autocast(features.device.type, enabled=False):
            rows = rows.to(weight.dtype)
            chosen = rows.gather(0, best.view(-1, 1).expand(-1, width)).view(b, -1, width)
            values = (chosen * weight).sum(dim=2) + bias
            mean, variance = self.running_mean, self.running_variance
            if self.training:
                centre = rows.mean(dim=0)
                covariance = (rows - centre).T @ (rows - centre) / len(rows)
                mean, variance = weight @ centre + bias, ((weight @ covariance) * weight).sum(dim=1)
                with torch.no_grad():  # as torch's own layer remembers them
                    self.running_mean.lerp_(mean, self.momentum)
                    self.running_variance.lerp_(variance * (len(rows) / (len(rows) - 1)), self.momentum)
            return functional.relu((values - mean) * torch.rsqrt(variance + EPSILON) * self.factor + self.shift)


def shared(*widths: int) -> nn.Sequential:
    """Return linear layers of these widths, each with batch normalisation and ReLU, for each point by itself.

    Parameters
    ----------
    widths : int
    """
    layers: list[nn.Module] = []
    for n_inputs, n_outputs in pairwise(widths):
        layers += [nn.Linear(n_inputs, n_outputs), _PointNorm(n_outputs), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers)


class _PointNorm(nn.BatchNorm1d):
    """Batch normalisation over the last axis, whatever comes before."""

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        return super().forward(features.reshape(-1, features.shape[-1])).view(features.shape)
