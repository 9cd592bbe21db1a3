"""Networks and features: published sizes, NumPy and torch equivalents, and training."""

import math

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")

from zbuf_occlude import OptionError  # noqa: E402
from zbuf_occlude.studies.learn.models import MODELS, Model, find_model  # noqa: E402
from zbuf_occlude.studies.learn.networks import (  # noqa: E402
    CHANNELS,
    OBJECT_VOXELS,
    SMALL,
    VOXELS,
    Classifier,
    GridConv,
    MaxLinear,
    PointNet,
    SphereClassifier,
    ThreeDmFV,
    fisher_vectors,
    occupancy,
)


def count(model: "torch.nn.Module") -> int:
    return sum(parameter.numel() for parameter in model.parameters())


def clouds(n_clouds: int, n_points: int) -> "torch.Tensor":
    """Return boxes of different proportions."""
    generator = torch.Generator().manual_seed(11)
    sides = torch.rand(n_clouds, 1, 3, generator=generator) + 0.1
    return (torch.rand(n_clouds, n_points, 3, generator=generator) - 0.5) * sides


@pytest.mark.parametrize(
    ("name", "exact", "published"),
    [
        ("voxnet", 921_736, 921_736),  # the number of its paper
        ("pointnet", 3_480_049, 3.5e6),  # "3.5M" of its Table 6
        ("threedmfv", 45_767_016, 45_767_016),  # counted from the authors' code, layer by layer
        ("threedmfv5", 45_767_016, 45_767_016),
    ],
)
def test_parameters_are_as_published_for_40_classes(name: str, exact: int, published: float) -> None:
    n_parameters = count(find_model(name).build(40))
    assert n_parameters == exact
    assert abs(n_parameters - published) <= 0.01 * published


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_logits_do_not_depend_on_the_order_of_the_points(model: Model) -> None:
    torch.manual_seed(0)
    network = model.build(5).eval()
    points = network.normalise(clouds(2, 60))
    with torch.inference_mode():
        logits, shuffled = network(points), network(points[:, torch.randperm(60)])
    assert logits.shape == (2, 5)
    assert torch.allclose(logits, shuffled, atol=1e-5)
    assert not torch.allclose(logits[0], logits[1], atol=1e-6)


@pytest.mark.parametrize("name", ["voxnet", "pointnet", "threedmfv5-small"])
def test_eight_clouds_are_learnt_by_heart(name: str) -> None:
    torch.manual_seed(1)
    network = find_model(name).build(4)
    points, labels = network.normalise(clouds(8, 64)), torch.tensor([3, 1, 0, 2, 2, 0, 1, 3])
    network.anneal_momentum(0.0)
    optimizer = torch.optim.Adam(network.parameters(), 0.001, fused=True)
    for step in range(120):
        loss = network.loss(points, labels)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        if step % 4 == 3:
            network.eval()
            with torch.inference_mode():
                right = int((network(points).argmax(dim=1) == labels).sum())
            network.train()
            if right == 8:
                return
    pytest.fail(f"{right} of 8 after {step + 1} steps, the loss {float(loss):.3f}")


def test_max_linear_is_the_four_layers_it_stands_for() -> None:
    torch.manual_seed(2)
    ours = MaxLinear(5, 40).double()
    with torch.no_grad():
        ours.factor.copy_(torch.randn(40))  # of both signs
        ours.shift.copy_(torch.randn(40))
    linear, norm = torch.nn.Linear(5, 40).double(), torch.nn.BatchNorm1d(40).double()
    with torch.no_grad():
        linear.weight.copy_(ours.linear.weight)
        linear.bias.copy_(ours.linear.bias)
        norm.weight.copy_(ours.factor)
        norm.bias.copy_(ours.shift)
    features = [torch.randn(3, 20, 5, dtype=torch.float64).requires_grad_()]
    features.append(features[0].detach().clone().requires_grad_())

    def plain(x: "torch.Tensor") -> "torch.Tensor":
        return torch.relu(norm(linear(x).view(60, 40)).view(3, 20, 40)).amax(dim=1)

    norm.momentum = ours.momentum = 0.3
    for training in (True, False):
        ours.train(training)
        norm.train(training)
        results = [ours(features[0]), plain(features[1])]
        assert torch.allclose(*results)
        assert torch.allclose(ours.running_mean, norm.running_mean)
        assert torch.allclose(ours.running_variance, norm.running_var)
        towards = torch.randn_like(results[0])
        for result in results:
            result.backward(towards)
        pairs = [(features[0], features[1]), (ours.linear.weight, linear.weight)]
        pairs += [(ours.factor, norm.weight), (ours.shift, norm.bias)]
        for mine, theirs in pairs:
            assert torch.allclose(mine.grad, theirs.grad, atol=1e-9)


def test_pointnet_is_held_to_orthogonal_transforms() -> None:
    torch.manual_seed(3)
    network = PointNet(4).eval()
    points, labels = network.normalise(clouds(3, 30)), torch.tensor([0, 1, 2])
    plain = torch.nn.functional.cross_entropy(network(points), labels)
    assert torch.allclose(network.loss(points, labels), plain), "the identity is orthogonal"
    with torch.no_grad():
        network.feature_transform.head[1].bias.copy_(torch.eye(64).flatten())  # transforms of 2 I: |I - 4 I|^2 = 9 x 64
    plain = torch.nn.functional.cross_entropy(network(points), labels)
    assert torch.allclose(network.loss(points, labels), plain + 0.001 * 9 * 64)


def test_normalisations() -> None:
    points = clouds(4, 50) * 7.0 + 3.0
    boxed = Classifier(2).normalise(points)
    assert torch.allclose(boxed.amax(dim=1), -boxed.amin(dim=1), atol=1e-6)
    assert torch.allclose((boxed.amax(dim=1) - boxed.amin(dim=1)).amax(dim=1), torch.ones(4))
    ball = SphereClassifier(2).normalise(points)
    assert torch.allclose(ball.mean(dim=1), torch.zeros(4, 3), atol=1e-6)
    assert torch.allclose(torch.linalg.norm(ball, dim=2).amax(dim=1), torch.ones(4))
    for network in (Classifier(2), SphereClassifier(2)):
        assert torch.equal(network.normalise(torch.ones(1, 5, 3)), torch.zeros(1, 5, 3)), "a cloud that is one place"


def test_numbers_that_make_no_network_are_refused() -> None:
    with pytest.raises(OptionError, match="n_gaussians must be at least 5 per side; got 4"):
        ThreeDmFV(2, 4)
    with pytest.raises(OptionError, match="n_filters must be even and at least 2; got 15"):
        ThreeDmFV(40, 5, 15)
    with pytest.raises(OptionError, match=r"model must be one of voxnet, .*, threedmfv5-small; got 'vox'"):
        find_model("vox")


# ---- features, and the convolution of small grids -------------------------------------------------------------------


def uniform(n_clouds: int, n_points: int) -> "torch.Tensor":
    generator = torch.Generator().manual_seed(5)
    return (torch.rand(n_clouds, n_points, 3, generator=generator) - 0.5) * 1.2


def occupancy_numpy(points: np.ndarray) -> np.ndarray:
    """Compute `occupancy` by the histogram of each cloud."""
    edges = (np.arange(VOXELS + 1) - VOXELS / 2) / OBJECT_VOXELS
    counts = np.stack([np.histogramdd(cloud, bins=(edges, edges, edges))[0] for cloud in points])
    return np.where(counts > 0, 1.0, -1.0).astype(np.float32)[:, None]


def fisher_vectors_numpy(points: np.ndarray, n_gaussians: int) -> np.ndarray:
    """Compute `fisher_vectors` from the formulas of its paper, in float64."""
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
    points = uniform(3, 200) * scale
    assert np.array_equal(occupancy(points).numpy(), occupancy_numpy(points.numpy()))


def test_an_object_takes_24_of_32_voxels() -> None:
    corners = torch.tensor([[[-0.499, -0.499, -0.499], [0.499, 0.499, 0.499], [0.7, 0.0, 0.0]]])
    places = (occupancy(corners)[0, 0] > 0).nonzero()
    assert places.tolist() == [[4, 4, 4], [27, 27, 27]], "the object from 4 to 27; what is outside is left out"


@pytest.mark.parametrize("n_gaussians", [2, 5, 8])
def test_fisher_vectors_are_their_twins(n_gaussians: int) -> None:
    points = uniform(3, 70)
    ours, twin = fisher_vectors(points, n_gaussians).numpy(), fisher_vectors_numpy(points.numpy(), n_gaussians)
    assert ours.shape == (3, 20, n_gaussians, n_gaussians, n_gaussians)
    assert np.abs(ours - twin).max() < 2e-6
    assert np.abs(twin).mean() > 1e-3


def test_fisher_vectors_in_parts_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    points = uniform(5, 30)
    whole = fisher_vectors(points, 4)
    monkeypatch.setattr("zbuf_occlude.studies.learn.networks.CHUNK", 1)
    assert torch.allclose(fisher_vectors(points, 4), whole, atol=1e-6)


@pytest.mark.parametrize("size", [3, 5])
@pytest.mark.parametrize("side", [1, 2, 3, 4, 5])
def test_values_and_gradients_are_those_of_torch(side: int, size: int) -> None:
    torch.manual_seed(side)
    ours, theirs = GridConv(6, 4, size).double(), torch.nn.Conv3d(6, 4, size, padding=size // 2).double()
    with torch.no_grad():
        theirs.weight.copy_(ours.weight.permute(4, 3, 0, 1, 2))
        theirs.bias.copy_(ours.bias)
    grids = [torch.randn(2, 6, side, side, side, dtype=torch.float64).requires_grad_()]
    grids.append(grids[0].detach().clone().requires_grad_())
    results = [ours(grids[0]), theirs(grids[1])]
    assert torch.allclose(*results)
    towards = torch.randn_like(results[0])
    for result in results:
        result.backward(towards)
    assert torch.allclose(grids[0].grad, grids[1].grad)
    assert torch.allclose(ours.weight.grad.permute(4, 3, 0, 1, 2), theirs.weight.grad)
    assert torch.allclose(ours.bias.grad, theirs.bias.grad)
    assert SMALL == 4, "both ways were tried above"
