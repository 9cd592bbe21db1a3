"""Features that VoxNet and 3DmFV compute from points: occupancy grids and Fisher vectors."""

import torch

VOXELS = 32
"""Voxels a side of VoxNet's grid."""
OBJECT_VOXELS = 24
"""Voxels that the longest side of an object takes."""
CHANNELS = 20
"""Numbers per Gaussian of 3DmFV."""
CHUNK = 1 << 20
"""Products of Fisher vectors held at once, about: what fits the cache of a CPU."""


def occupancy(points: torch.Tensor) -> torch.Tensor:
    """Mark the voxels that hold a point.

    Parameters
    ----------
    points : (b, n, 3) float32
        The grid is centred at the origin; a unit is `OBJECT_VOXELS` voxels. Points outside the grid are left out.

    Returns
    -------
    (b, 1, 32, 32, 32) float32
        1 where a voxel holds a point, -1 where not; axes x, y, z.

    References
    ----------
    Maturana and Scherer 2015: a grid of 32^3, the object within 24^3. Without rays the three models of
    occupancy of the paper come to this one. Their code shifts the values to -1 and 1.
    """
    grid = points.new_full((len(points), VOXELS**3), -1.0)
    cells = torch.floor(points * OBJECT_VOXELS + VOXELS / 2).long()
    inside = ((cells >= 0) & (cells < VOXELS)).all(dim=2)
    clouds, places = inside.nonzero(as_tuple=True)
    x, y, z = cells[clouds, places].unbind(dim=1)
    grid[clouds, (x * VOXELS + y) * VOXELS + z] = 1.0
    return grid.view(-1, 1, VOXELS, VOXELS, VOXELS)


def fisher_vectors(points: torch.Tensor, n_gaussians: int) -> torch.Tensor:
    """Describe clouds by how the likelihood of their points changes with a grid of Gaussians: 3DmFV.

    Parameters
    ----------
    points : (b, n, 3) float32
        Within the unit sphere, or about it.
    n_gaussians : int
        g Gaussians a side, of standard deviation 1/g, their centres in the middles of g^3 cells of the cube [-1, 1]^3.

    Returns
    -------
    (b, 20, g, g, g) float32
        Derivatives by a Gaussian's weight (max, sum over the points), its mean (max of x, y, z; min; sum), and its
        standard deviation (likewise); each of the 20 has the L2 norm 1 over the grid, after the signed square root.

    Notes
    -----
    The grid is a product of three axes, and so is each point's share in a Gaussian: q(x) q(y) q(z), each a softmax
    along one axis. The sums over the points are thereby matrix products; only max and min meet each pair of point and
    Gaussian. Shares too small for float32 count as 0. No gradient: the points are data.

    References
    ----------
    Ben-Shabat, Lindenbaum, Fischer 2018: "3DmFV: Three-Dimensional Point Cloud Classification in Real-Time Using
    Convolutional Neural Networks". There is no minimum of the derivative by weight: it says nothing.
    """
    chunk = max(1, CHUNK // (7 * n_gaussians**2 * points.shape[1]))
    with torch.no_grad(), torch.autocast(points.device.type, enabled=False):
        parts = [_derivatives(part, n_gaussians) for part in points.float().split(chunk)]
        vectors = torch.cat(parts)
        vectors = vectors.sign() * vectors.abs().sqrt()
        norms = vectors.square().sum(dim=2, keepdim=True).clamp(min=1e-12).sqrt()
        return (vectors / norms).view(-1, CHANNELS, n_gaussians, n_gaussians, n_gaussians)


def _derivatives(points: torch.Tensor, g: int) -> torch.Tensor:
    """Return (b, 20, g^3): max, min and sum over the points of their derivatives; before any normalisation."""
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
