"""A 3D convolution for grids hardly larger than its kernel, which on a processor does not multiply the zeros around."""

import math
from collections.abc import Iterator
from itertools import product
from typing import Any

import torch
from torch import nn
from torch.nn import functional

SMALL = 4
"""Cells a side up to which, on a processor, products of slices are faster than torch's convolution, as measured."""


class GridConv(nn.Module):
    """What ``nn.Conv3d(n_inputs, n_outputs, size, padding=size // 2)`` computes.

    Parameters
    ----------
    n_inputs, n_outputs : int
    size : int
        Of the kernel; odd.

    Notes
    -----
    With a kernel of 5 on a grid of 3 only a fifth of the products are not with padding. On grids up to `SMALL` the
    convolution is a matrix product for each of the kernel's places, of those cells that have a neighbour there; the
    weights lie as these want them, (size, size, size, n_inputs, n_outputs). Elsewhere, and on CUDA, it is torch's.
    """

    def __init__(self, n_inputs: int, n_outputs: int, size: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.empty(size, size, size, n_inputs, n_outputs))
        self.bias = nn.Parameter(torch.empty(n_outputs))
        bound = 1.0 / math.sqrt(n_inputs * size**3)  # torch's own first weights
        nn.init.uniform_(self.weight, -bound, bound)
        nn.init.uniform_(self.bias, -bound, bound)

    def forward(self, grid: torch.Tensor) -> torch.Tensor:
        """Return (b, n_outputs, r, r, r) of a grid (b, n_inputs, r, r, r)."""
        if grid.is_cuda or grid.shape[2] > SMALL:
            return functional.conv3d(grid, self.weight.permute(4, 3, 0, 1, 2), self.bias, padding=len(self.weight) // 2)
        convolve: Any = _SmallConvolution.apply  # torch does not say its type
        cells: torch.Tensor = convolve(grid.permute(0, 2, 3, 4, 1).contiguous(), self.weight)
        return (cells + self.bias).permute(0, 4, 1, 2, 3)


class _SmallConvolution(torch.autograd.Function):
    """(b, r, r, r, n_inputs) cells and weights to (b, r, r, r, n_outputs) cells."""

    @staticmethod
    def forward(ctx: Any, cells: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
        ctx.save_for_backward(cells, weight)
        result = cells.new_zeros(*cells.shape[:4], weight.shape[4])
        for place, here, there in _places(cells.shape[1], len(weight)):
            result[here] += cells[there] @ weight[place]
        return result

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        cells, weight = ctx.saved_tensors
        by_cells, by_weight = torch.zeros_like(cells), torch.zeros_like(weight)
        for place, here, there in _places(cells.shape[1], len(weight)):
            part = gradient[here]
            torch.mm(cells[there].flatten(0, 3).T, part.flatten(0, 3), out=by_weight[place])
            by_cells[there] += part @ weight[place].T
        return by_cells, by_weight


Place = tuple[int, int, int]
Slices = tuple[slice, ...]


def _places(side: int, size: int) -> Iterator[tuple[Place, Slices, Slices]]:
    """Yield the kernel's places that meet the grid, the cells that have a neighbour there, and those neighbours."""
    shifts = range(max(-(size // 2), 1 - side), min(size // 2, side - 1) + 1)
    here = {shift: slice(max(0, -shift), side - max(0, shift)) for shift in shifts}
    for x, y, z in product(shifts, repeat=3):
        place = (x + size // 2, y + size // 2, z + size // 2)
        yield place, (slice(None), here[x], here[y], here[z]), (slice(None), here[-x], here[-y], here[-z])
