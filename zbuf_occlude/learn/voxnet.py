"""VoxNet: a small 3D convolutional network on an occupancy grid of 32^3.

    layer             output             parameters (K classes)
    occupancy         1 x 32^3           -
    conv 5^3 / 2      32 x 14^3          4,032
    leaky ReLU 0.1, dropout 0.2
    conv 3^3          32 x 12^3          27,680
    leaky ReLU 0.1
    max pool 2        32 x 6^3           -
    dropout 0.3
    linear, ReLU      128                884,864
    dropout 0.4
    linear            K                  128 K + K

921,736 parameters for K = 40: the paper's number, all weights and biases counted.

References
----------
D. Maturana, S. Scherer: "VoxNet: A 3D Convolutional Neural Network for Real-Time Object Recognition", IROS 2015.
"""

import torch
from torch import nn

from zbuf_occlude.learn.classifier import Classifier
from zbuf_occlude.learn.features import occupancy


class VoxNet(Classifier):
    """VoxNet (Maturana and Scherer 2015).

    Parameters
    ----------
    n_classes : int

    Notes
    -----
    Clouds are scaled as the base class says: the longest side takes 24 of the 32 voxels. What augmentation turns or
    scales beyond the grid is cut off.

    The first weights are the paper's, but each kernel of the first layer has the mean 0. The grid is -1 nearly
    everywhere; with any other mean that background is all that the first steps see, and training takes ten times as
    many of them.
    """

    def __init__(self, n_classes: int) -> None:
        super().__init__(n_classes)
        first, second = nn.Conv3d(1, 32, 5, stride=2), nn.Conv3d(32, 32, 3)
        hidden, last = nn.Linear(32 * 6**3, 128), nn.Linear(128, n_classes)
        for convolution in (first, second):
            nn.init.kaiming_normal_(convolution.weight, a=0.1)
        with torch.no_grad():
            first.weight -= first.weight.mean(dim=(1, 2, 3, 4), keepdim=True)
        for linear in (hidden, last):
            nn.init.normal_(linear.weight, std=0.01)
        for layer in (first, second, hidden, last):
            assert layer.bias is not None  # for the type checker
            nn.init.zeros_(layer.bias)
        self.body = nn.Sequential(
            first, nn.LeakyReLU(0.1), nn.Dropout(0.2), second, nn.LeakyReLU(0.1), nn.MaxPool3d(2), nn.Dropout(0.3)
        )
        self.head = nn.Sequential(hidden, nn.ReLU(), nn.Dropout(0.4), last)

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Return logits.

        Parameters
        ----------
        points : (b, n, 3) float32

        Returns
        -------
        (b, n_classes) float32
        """
        logits: torch.Tensor = self.head(self.body(occupancy(points)).flatten(1))
        return logits
