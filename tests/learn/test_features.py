"""Occupancy grids and Fisher vectors: against their NumPy twins and closed forms."""

import math

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")

from zbuf_occlude.learn.features import CHANNELS, OBJECT_VOXELS, VOXELS, fisher_vectors, occupancy  # noqa: E402


def clouds(n_clouds: int, n_points: int, scale: float) -> "torch.Tensor":
    generator = torch.Generator().manual_seed(5)
    return (torch.rand(n_clouds, n_points, 3, generator=generator) - 0.5) * scale


def occupancy_numpy(points: np.ndarray) -> np.ndarray:
    """What `occupancy` computes, by the histogram of each cloud."""
    edges = (np.arange(VOXELS + 1) - VOXELS / 2) / OBJECT_VOXELS
    counts = np.stack([np.histogramdd(cloud, bins=(edges, edges, edges))[0] for cloud in points])
    return np.where(counts > 0, 1.0, -1.0).astype(np.float32)[:, None]


def fisher_vectors_numpy(points: np.ndarray, n_gaussians: int) -> np.ndarray:
    """What `fisher_vectors` computes, from the formulas as they stand in its paper, in float64."""
    g = n_gaussians
    axis = np.linspace(-1.0 + 1.0 / g, 1.0 - 1.0 / g, g)
    centres = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    weight, deviation, n = 1.0 / g**3, 1.0 / g, points.shape[1]
    distances = (points.astype(np.float64)[:, :, None] - centres) / deviation  # (b, n, g^3, 3)
    density = np.exp(-0.5 * np.sum(distances**2, axis=3)) / ((2.0 * math.pi) ** 1.5 * deviation**3)
    shares = weight * density / np.sum(weight * density, axis=2, keepdims=True)
    by_weight = ((shares - weight) / math.sqrt(weight))[..., None] / n
    by_mean = shares[..., None] * distances / (n * math.sqrt(weight))
    by_deviation = shares[..., None] * (distances**2 - 1.0) / (n * math.sqrt(2.0 * weight))
    both = [f(d, axis=1) for d in (by_mean, by_deviation) for f in (np.max, np.min, np.sum)]
    vectors = np.concatenate([by_weight.max(axis=1), by_weight.sum(axis=1), *both], axis=2)  # (b, g^3, 20)
    vectors = np.sign(vectors) * np.sqrt(np.abs(vectors))
    vectors /= np.sqrt(np.maximum(np.sum(vectors**2, axis=1, keepdims=True), 1e-12))
    return np.moveaxis(vectors, 2, 1).reshape(-1, CHANNELS, g, g, g)


@pytest.mark.parametrize("scale", [0.3, 1.0, 2.0])
def test_occupancy_is_its_twins(scale: float) -> None:
    points = clouds(3, 200, scale)
    assert np.array_equal(occupancy(points).numpy(), occupancy_numpy(points.numpy()))


def test_an_object_takes_24_of_32_voxels() -> None:
    corners = torch.tensor([[[-0.499, -0.499, -0.499], [0.499, 0.499, 0.499], [0.7, 0.0, 0.0]]])
    places = (occupancy(corners)[0, 0] > 0).nonzero()
    assert places.tolist() == [[4, 4, 4], [27, 27, 27]], "the object from 4 to 27; what is outside is left out"


@pytest.mark.parametrize("n_gaussians", [2, 5, 8])
def test_fisher_vectors_are_their_twins(n_gaussians: int) -> None:
    points = clouds(3, 70, 1.2)
    ours, twin = fisher_vectors(points, n_gaussians).numpy(), fisher_vectors_numpy(points.numpy(), n_gaussians)
    assert ours.shape == (3, 20, n_gaussians, n_gaussians, n_gaussians)
    assert np.abs(ours - twin).max() < 2e-6
    assert np.abs(twin).mean() > 1e-3


def test_fisher_vectors_in_parts_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    points = clouds(5, 30, 1.2)
    whole = fisher_vectors(points, 4)
    monkeypatch.setattr("zbuf_occlude.learn.features.CHUNK", 1)
    assert torch.allclose(fisher_vectors(points, 4), whole, atol=1e-6)


def test_a_point_at_the_centre_of_the_only_gaussian() -> None:
    """Share 1, distance 0: by weight (1 - 1) / 1 = 0; by mean 0; by deviation -1 / sqrt 2, normed to -1."""
    vector = fisher_vectors(torch.zeros(1, 1, 3), 1).flatten()
    assert torch.equal(vector, torch.tensor([0.0] * 11 + [-1.0] * 9))


def test_a_point_moved_along_x_changes_the_mean_along_x_only() -> None:
    vector = fisher_vectors(torch.tensor([[[0.5, 0.0, 0.0]]]), 1).flatten()
    by_mean, by_deviation = vector[2:11].view(3, 3), vector[11:].view(3, 3)
    assert torch.equal(by_mean, torch.tensor([[1.0, 0.0, 0.0]] * 3))
    assert torch.equal(by_deviation, -torch.ones(3, 3)), "0.25 - 1 is negative along x too"


def test_what_the_20_channels_are() -> None:
    """A cloud in the cell of one Gaussian: its weight grows most there, and the points are on all sides."""
    points = clouds(1, 50, 0.1) + torch.tensor([0.75, -0.25, 0.25])
    vectors = fisher_vectors(points, 4)[0]
    assert int(vectors[0].argmax()) == np.ravel_multi_index((3, 1, 2), (4, 4, 4))
    assert int(vectors[1].argmax()) == int(vectors[0].argmax())
    assert torch.allclose(vectors.square().sum(dim=(1, 2, 3)), torch.ones(20), atol=1e-5)
    at = vectors[:, 3, 1, 2]
    assert (at[2:5] > 0).all(), "the points lie on both sides of the mean"
    assert (at[5:8] < 0).all()
