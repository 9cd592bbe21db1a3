"""Classifiers and the features that they compute from points; numbers of parameters are for K classes.

References
----------
D. Maturana, S. Scherer: "VoxNet: A 3D Convolutional Neural Network for Real-Time Object Recognition", IROS 2015.

C. R. Qi, H. Su, K. Mo, L. J. Guibas: "PointNet: Deep Learning on Point Sets for 3D Classification and Segmentation",
CVPR 2017; Figure 2, supplementary C.

Y. Ben-Shabat, M. Lindenbaum, A. Fischer: "3DmFV: Three-Dimensional Point Cloud Classification in Real-Time Using
Convolutional Neural Networks", IEEE RA-L 3(4), 2018; the layers are those of the authors' published TensorFlow code,
which also keeps 5^3 on the smaller grid.
"""

import math
from collections.abc import Iterator
from itertools import pairwise, product
from typing import Any

import torch
from torch import nn
from torch.nn import functional

from zbuf_occlude.base.errors import OptionError

VOXELS = 32
"""Voxels along a side of VoxNet's grid."""
OBJECT_VOXELS = 24
"""Voxels along the longest side of an object."""
CHANNELS = 20
"""Numbers per Gaussian of 3DmFV."""
CHUNK = 1 << 20
"""Approximate number of products of Fisher vectors held at once; they fit the cache of a CPU."""
ORTHOGONALITY = 0.001
"""Weight of PointNet's regulariser beside the cross-entropy."""
EPSILON = 1e-5
"""Constant added to variances, as in torch's batch normalisation."""
SMALL = 4
"""Largest grid, in cells a side, on which products of slices were faster than torch's convolution on a CPU."""


class Classifier(nn.Module):
    """Base class of the three networks: all that the training loop and the evaluation use.

    A subclass defines ``forward(points) -> logits``, from (b, n, 3) float32 as `normalise` returns them to (b,
    n_classes) float32. The subclass extracts its features itself. `normalise` is called once for each cloud, before
    augmentation; after it, it would undo the scaling.
    """

    def __init__(self, n_classes: int) -> None:
        super().__init__()
        self.n_classes = n_classes

    def normalise(self, points: torch.Tensor) -> torch.Tensor:
        """Centre and scale clouds (b, n, 3) as the network's paper does.

        The bounding box of each cloud is centred at the origin; its longest side becomes 1 (paper, section 3.4).
        """
        low, high = points.amin(dim=1, keepdim=True), points.amax(dim=1, keepdim=True)
        return (points - (low + high) / 2.0) / _positive((high - low).amax(dim=2, keepdim=True))

    def loss(self, points: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
        """Return the training loss () of clouds (b, n, 3) with labels (b,): cross-entropy and any regulariser."""
        return functional.cross_entropy(self(points), labels)

    def anneal_momentum(self, progress: float) -> None:
        """Lower the momentum of batch normalisation from 0.5 to 0.05 as `progress` goes from 0 to 1.

        With torch's constant 0.1 the running statistics lag far behind in the first hundreds of steps. In evaluation
        mode the network then fails on the clouds it was trained on. The published code of PointNet and 3DmFV also
        begins with 0.5; it halves the momentum down to 0.01 within a million clouds.
        """
        for module in self.modules():
            if hasattr(module, "momentum"):
                module.momentum = 0.5 * 0.1**progress


class SphereClassifier(Classifier):
    """Classifier of clouds scaled into the unit sphere; the order of the points does not matter."""

    def normalise(self, points: torch.Tensor) -> torch.Tensor:
        """Move the centroids of clouds (b, n, 3) to the origin; scale each cloud's farthest point to distance 1."""
        centred = points - points.mean(dim=1, keepdim=True)
        return centred / _positive(torch.linalg.norm(centred, dim=2, keepdim=True).amax(dim=1, keepdim=True))


def _positive(lengths: torch.Tensor) -> torch.Tensor:
    """Return the lengths, 1 in place of 0 (the length of a cloud whose points coincide)."""
    return torch.where(lengths > 0.0, lengths, 1.0)


# ---- features --------------------------------------------------------------------------------------------------------


def occupancy(points: torch.Tensor) -> torch.Tensor:
    """Return the occupancy grids of points (b, n, 3): (b, 1, 32, 32, 32) float32, 1 in occupied voxels, -1 elsewhere.

    The grid is centred at the origin; a unit length is `OBJECT_VOXELS` voxels. Points outside the grid are ignored.
    Maturana and Scherer 2015 use a grid of 32^3 with the object within 24^3. Without rays the three occupancy models of
    their paper are equal. Their code shifts the values to -1 and 1.
    """
    grid = points.new_full((len(points), VOXELS**3), -1.0)
    cells = torch.floor(points * OBJECT_VOXELS + VOXELS / 2).long()
    inside = ((cells >= 0) & (cells < VOXELS)).all(dim=2)
    clouds, point_ids = inside.nonzero(as_tuple=True)
    x, y, z = cells[clouds, point_ids].unbind(dim=1)
    grid[clouds, (x * VOXELS + y) * VOXELS + z] = 1.0
    return grid.view(-1, 1, VOXELS, VOXELS, VOXELS)


def fisher_vectors(points: torch.Tensor, n_gaussians: int) -> torch.Tensor:
    """Return the 3DmFV features of clouds (b, n, 3) in or near the unit sphere: (b, 20, g, g, g) float32.

    The features are derivatives of the likelihood of the points under a grid of g = `n_gaussians` Gaussians a side. The
    standard deviation is 1/g; the means are the centres of the g^3 cells of the cube [-1, 1]^3. The 20 numbers of a
    Gaussian are statistics over the points: of the derivative by its weight the maximum and the sum (the minimum is
    constant); of those by the three coordinates of its mean, and of its standard deviation, the maxima, minima and
    sums. After a signed square root each has the L2 norm 1 over the grid.

    The weight of a point in a Gaussian is a product q(x) q(y) q(z) of one softmax along each axis. The sums over the
    points are therefore matrix products; only maximum and minimum visit each pair of point and Gaussian. Weights too
    small for float32 count as 0. The features have no gradient.
    """
    chunk = max(1, CHUNK // (7 * n_gaussians**2 * points.shape[1]))
    with torch.no_grad(), torch.autocast(points.device.type, enabled=False):
        parts = [_derivatives(part, n_gaussians) for part in points.float().split(chunk)]
        vectors = torch.cat(parts)
        vectors = vectors.sign() * vectors.abs().sqrt()
        norms = vectors.square().sum(dim=2, keepdim=True).clamp(min=1e-12).sqrt()
        return (vectors / norms).view(-1, CHANNELS, n_gaussians, n_gaussians, n_gaussians)


def _derivatives(points: torch.Tensor, g: int) -> torch.Tensor:
    """Return (b, 20, g^3): maxima, minima and sums of the derivatives over the points, not normalised."""
    b, n, _ = points.shape
    centres = (2.0 * torch.arange(g, device=points.device) + 1.0) / g - 1.0
    distances = (points.transpose(1, 2)[:, :, None] - centres[:, None]) * g  # (b, 3, g, n), in standard deviations
    shares = torch.softmax(-0.5 * distances.square(), dim=2)
    by_mean, by_deviation = shares * distances, shares * (distances.square() - 1.0)
    factors = shares[:, :, None].repeat(1, 1, 7, 1, 1)  # (b, 3 axes, weight + 3 means + 3 deviations, g, n)
    for axis in range(3):
        factors[:, axis, 1 + axis], factors[:, axis, 4 + axis] = by_mean[:, axis], by_deviation[:, axis]
    flat = (factors[:, 0, :, :, None] * factors[:, 1, :, None]).view(b, 7, g * g, n)  # by x and y
    upright = factors[:, 2]
    total = (flat @ upright.transpose(2, 3)).view(b, 7, g**3)
    extremes = [torch.aminmax(flat * upright[:, :, z, None], dim=3) for z in range(g)]
    low, high = (torch.stack(side, dim=3).view(b, 7, g**3) for side in zip(*extremes, strict=True))
    weight = 1.0 / g**3
    scale = torch.tensor([weight**-0.5] * 4 + [(2.0 * weight) ** -0.5] * 3, device=points.device)[:, None] / n
    shift = torch.tensor([weight] + [0.0] * 6, device=points.device)[:, None]
    high, low, total = ((high - shift) * scale, low * scale, (total - n * shift) * scale)
    mean, deviation = slice(1, 4), slice(4, 7)
    wanted = [high[:, :1], total[:, :1]]
    wanted += [part[:, kind] for kind in (mean, deviation) for part in (high, low, total)]
    return torch.cat(wanted, dim=1)


# ---- VoxNet ------------------------------------------------------------------------------------------------------


class VoxNet(Classifier):
    """VoxNet (Maturana and Scherer 2015): a 3D convolutional network on an occupancy grid of 32^3.

        layer              output         parameters
        occupancy          1 x 32^3       -
        conv 5^3 / 2       32 x 14^3      4,032
        leaky ReLU 0.1, dropout 0.2
        conv 3^3           32 x 12^3      27,680
        leaky ReLU 0.1
        max pool 2         32 x 6^3       -
        dropout 0.3
        linear, ReLU       128            884,864
        dropout 0.4
        linear             K              128 K + K

    921,736 parameters (weights and biases) for K = 40, as in its paper.

    Notes
    -----
    The longest side of a cloud takes 24 of the 32 voxels. Points that augmentation moves out of the grid are ignored.

    Initial weights are those of the paper, except that each kernel of the first layer has the mean 0. The grid is -1
    nearly everywhere: with another mean this background dominates the first steps, and training takes ten times as
    many.
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
        """Return logits (b, n_classes) of points (b, n, 3)."""
        logits: torch.Tensor = self.head(self.body(occupancy(points)).flatten(1))
        return logits


# ---- PointNet ----------------------------------------------------------------------------------------------------


class PointNet(SphereClassifier):
    """PointNet (Qi et al. 2017) with both T-Nets: a function of each point, then the maximum over the points.

        layer                                output     parameters
        T-Net of 3                           3 x 3      803,081
        points times it                      n x 3      -
        shared linear 64, 64                 n x 64     256 + 128, 4,160 + 128
        T-Net of 64                          64 x 64    1,857,344
        features times it                    n x 64     -
        shared linear 64, 128, 1024          n x 1024   4,160 + 128, 8,320 + 256, 132,096 + 2,048
        max over points                      1024       -
        linear 512                           512        524,800 + 1,024
        linear 256, dropout 0.3              256        131,328 + 512
        linear                               K          256 K + K

    T-Net: shared linear 64, 128, 1024; max over points; linear 512, 256; linear of the matrix, plus the identity.
    After each layer but the last ones of the network and of the T-Nets: batch normalisation (the second number) and
    ReLU. 3,480,049 parameters for K = 40, T-Nets and batch normalisation included (3.5 M in its Table 6); 3,467,889
    without batch normalisation.
    """

    def __init__(self, n_classes: int) -> None:
        super().__init__(n_classes)
        self.input_transform = TNet(3)
        self.local = shared(3, 64, 64)
        self.feature_transform = TNet(64)
        self.body = shared(64, 64, 128)
        self.pool = MaxLinear(128, 1024)
        self.head = nn.Sequential(shared(1024, 512, 256), nn.Dropout(0.3), nn.Linear(256, n_classes))

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Return logits (b, n_classes) of points (b, n, 3)."""
        return self._logits_and_transform(points)[0]

    def loss(self, points: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
        """Return the cross-entropy plus the distance of the 64 x 64 transforms A from orthogonal ones, |I - A A^T|^2.

        Qi et al. 2017, Eq. 2 (mean over the batch).
        """
        logits, transforms = self._logits_and_transform(points)
        with torch.autocast(points.device.type, enabled=False):  # differences of numbers near 1 need float32
            transforms = transforms.float()
            defects = torch.eye(64, device=points.device) - transforms @ transforms.transpose(1, 2)
        return functional.cross_entropy(logits, labels) + ORTHOGONALITY * defects.square().sum(dim=(1, 2)).mean()

    def _logits_and_transform(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        features = self.local(points @ self.input_transform(points))
        transforms = self.feature_transform(features)
        return self.head(self.pool(self.body(features @ transforms))), transforms


class TNet(nn.Module):
    """PointNet that maps the features of a cloud to a (size, size) transform of them; initially the identity."""

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
        """Return transforms (b, size, size) of features (b, n, size)."""
        change = self.head(self.pool(self.body(features))).view(-1, self.size, self.size)
        return change + torch.eye(self.size, device=change.device, dtype=change.dtype)


class MaxLinear(nn.Module):
    """Linear layer, batch normalisation, ReLU and maximum over the points, evaluated for the maximal points only.

    Function, statistics and gradients equal those of the four layers one after the other; training takes about a third
    of the time. Normalisation is monotonic, rising or falling by the sign of its factor. The point with the maximum of
    a channel is therefore found from the linear product alone, without a gradient. Mean and variance over all points
    follow from those of the inputs: w m + b, and w C w^T for the covariance C.
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
                with torch.no_grad():  # as torch's own layer updates them
                    self.running_mean.lerp_(mean, self.momentum)
                    self.running_variance.lerp_(variance * (len(rows) / (len(rows) - 1)), self.momentum)
            return functional.relu((values - mean) * torch.rsqrt(variance + EPSILON) * self.factor + self.shift)


def shared(*widths: int) -> nn.Sequential:
    """Return linear layers of these widths, each with batch normalisation and ReLU, applied to each point."""
    layers: list[nn.Module] = []
    for n_inputs, n_outputs in pairwise(widths):
        layers += [nn.Linear(n_inputs, n_outputs), _PointNorm(n_outputs), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers)


class _PointNorm(nn.BatchNorm1d):
    """Batch normalisation over the last axis; all other axes are batch."""

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        return super().forward(features.reshape(-1, features.shape[-1])).view(features.shape)


# ---- 3DmFV-Net ---------------------------------------------------------------------------------------------------


class ThreeDmFV(SphereClassifier):
    """3DmFV-Net (Ben-Shabat et al. 2018): Fisher vectors on a grid of Gaussians, then a 3D inception network.

        layer                      output, g = 8 (g = 5)   parameters
        3DmFV                      20 x g^3                -
        inception 64               192 x g^3               314,432
        inception 128              384 x g^3               1,295,488
        inception 256              768 x g^3               5,179,648
        max pool 2                 768 x 4^3 (3^3)         -
        inception 256              768 x 4^3 (3^3)         5,376,256
        inception 512              1,536 x 4^3 (3^3)       20,713,984
        max pool 2                 1,536 x 2^3 (2^3)       -
        linear 1024, dropout 0.3   1024                    12,583,936 + 2,048
        linear 256, dropout 0.3    256                     262,400 + 512
        linear 128, dropout 0.3    128                     32,896 + 256
        linear                     K                       128 K + K

    After each layer but the last: batch normalisation (counted; the second number of linear layers) and ReLU.
    45,767,016 parameters for K = 40, as in the authors' code; 45,756,904 without batch normalisation.

    `n_gaussians` is the number a side: 8 as in the best results of its paper, or 5 as by default in its code; layers
    and number of parameters are the same. `n_filters` is the width of the first inception module, 64 in its paper; all
    other widths are multiples of it. Raises OptionError for fewer than 5 Gaussians, or an odd number of filters.
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

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Return logits (b, n_classes) of points (b, n, 3)."""
        logits: torch.Tensor = self.head(self.body(fisher_vectors(points, self.n_gaussians)).flatten(1))
        return logits


class Inception(nn.Module):
    """Inception module: four branches, concatenated; f = `n_filters`.

    The branches: a 1^3 convolution to f channels; on its output a 3^3 and a 5^3 convolution, each to f/2; the mean over
    3^3 and a 1^3 convolution to f.
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


class GridConv(nn.Module):
    """Equivalent of ``nn.Conv3d(n_inputs, n_outputs, size, padding=size // 2)``, faster on small grids on a CPU.

    With a kernel of 5 on a grid of 3, 80 % of the products are with padding. On grids up to `SMALL` the convolution is
    one matrix product per offset of the kernel, over the cells that have a neighbour at that offset. The layout of the
    weights serves these products: (size, size, size, n_inputs, n_outputs). Larger grids and CUDA use torch's
    convolution.
    """

    def __init__(self, n_inputs: int, n_outputs: int, size: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.empty(size, size, size, n_inputs, n_outputs))
        self.bias = nn.Parameter(torch.empty(n_outputs))
        bound = 1.0 / math.sqrt(n_inputs * size**3)  # torch's own initial weights
        nn.init.uniform_(self.weight, -bound, bound)
        nn.init.uniform_(self.bias, -bound, bound)

    def forward(self, grid: torch.Tensor) -> torch.Tensor:
        """Return (b, n_outputs, r, r, r) of a grid (b, n_inputs, r, r, r)."""
        if grid.is_cuda or grid.shape[2] > SMALL:
            return functional.conv3d(grid, self.weight.permute(4, 3, 0, 1, 2), self.bias, padding=len(self.weight) // 2)
        convolve: Any = _SmallConvolution.apply  # torch does not annotate it
        cells: torch.Tensor = convolve(grid.permute(0, 2, 3, 4, 1).contiguous(), self.weight)
        return (cells + self.bias).permute(0, 4, 1, 2, 3)


class _SmallConvolution(torch.autograd.Function):
    """Convolution of cells (b, r, r, r, n_inputs) with weights to cells (b, r, r, r, n_outputs)."""

    @staticmethod
    def forward(ctx: Any, cells: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
        ctx.save_for_backward(cells, weight)
        result = cells.new_zeros(*cells.shape[:4], weight.shape[4])
        for offset, here, there in _offsets(cells.shape[1], len(weight)):
            result[here] += cells[there] @ weight[offset]
        return result

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        cells, weight = ctx.saved_tensors
        by_cells, by_weight = torch.zeros_like(cells), torch.zeros_like(weight)
        for offset, here, there in _offsets(cells.shape[1], len(weight)):
            part = gradient[here]
            torch.mm(cells[there].flatten(0, 3).T, part.flatten(0, 3), out=by_weight[offset])
            by_cells[there] += part @ weight[offset].T
        return by_cells, by_weight


def _offsets(side: int, size: int) -> Iterator[tuple[tuple[int, int, int], tuple[slice, ...], tuple[slice, ...]]]:
    """Yield the kernel's offsets within the grid, the cells that have a neighbour at each, and these neighbours."""
    shifts = range(max(-(size // 2), 1 - side), min(size // 2, side - 1) + 1)
    here = {shift: slice(max(0, -shift), side - max(0, shift)) for shift in shifts}
    for x, y, z in product(shifts, repeat=3):
        offset = (x + size // 2, y + size // 2, z + size // 2)
        yield offset, (slice(None), here[x], here[y], here[z]), (slice(None), here[-x], here[-y], here[-z])
