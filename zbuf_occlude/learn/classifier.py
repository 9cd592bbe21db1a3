"""What a classifier of clouds is: points in, logits out; how it wants them scaled; what it is trained to make small."""

import torch
from torch import nn
from torch.nn import functional


class Classifier(nn.Module):
    """Base of the three networks; the training loop and the evaluation know no more than this.

    Parameters
    ----------
    n_classes : int

    Notes
    -----
    A subclass defines ``forward(points) -> logits``: (b, n, 3) float32 in the frame that `normalise` leaves, to
    (b, n_classes). Features are extracted inside. `normalise` is asked once for each cloud, before any augmentation:
    were it asked after, it would undo the scaling.
    """

    def __init__(self, n_classes: int) -> None:
        super().__init__()
        self.n_classes = n_classes

    def normalise(self, points: torch.Tensor) -> torch.Tensor:
        """Move and scale clouds as the network's paper wants them.

        Parameters
        ----------
        points : (b, n, 3) float32

        Returns
        -------
        (b, n, 3) float32
            Here: each cloud's bounding box about the origin, its longest side 1 (paper, section 3.4).
        """
        low, high = points.amin(dim=1, keepdim=True), points.amax(dim=1, keepdim=True)
        return (points - (low + high) / 2.0) / _positive((high - low).amax(dim=2, keepdim=True))

    def loss(self, points: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
        """Return what training makes small: the cross-entropy, and in a subclass a regulariser beside it.

        Parameters
        ----------
        points : (b, n, 3) float32
        labels : (b,) int64

        Returns
        -------
        () float32
        """
        return functional.cross_entropy(self(points), labels)

    def settle(self, progress: float) -> None:
        """Let batch normalisation forget more slowly as training goes on; a network without it does nothing.

        Parameters
        ----------
        progress : float
            From 0 to 1.

        Notes
        -----
        Each batch's share in the running statistics falls from 0.5 to 0.05. With torch's 0.1 they lag so far behind
        the first hundreds of steps that a network which knows its training clouds fails on them when it is evaluated.
        The code of PointNet and of 3DmFV begins with 0.5 too, and halves it down to 0.01 in a million clouds.
        """
        for module in self.modules():
            if hasattr(module, "momentum"):
                module.momentum = 0.5 * 0.1**progress


def unit_sphere(points: torch.Tensor) -> torch.Tensor:
    """Move clouds' centroids to the origin, and scale so that the farthest point of each lies on the unit sphere.

    Parameters
    ----------
    points : (b, n, 3) float32

    Returns
    -------
    (b, n, 3) float32
    """
    centred = points - points.mean(dim=1, keepdim=True)
    return centred / _positive(torch.linalg.norm(centred, dim=2, keepdim=True).amax(dim=1, keepdim=True))


def _positive(lengths: torch.Tensor) -> torch.Tensor:
    """Return the lengths, 1 for those of a single place."""
    return torch.where(lengths > 0.0, lengths, 1.0)
