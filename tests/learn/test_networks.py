"""The three networks: parameters as published, order of points, normalisation, and that they can learn."""

import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")

from zbuf_occlude import OptionError  # noqa: E402
from zbuf_occlude.learn.models import MODELS, Model, find_model  # noqa: E402
from zbuf_occlude.learn.networks import Classifier, MaxLinear, PointNet, ThreeDmFV, unit_sphere  # noqa: E402

every_model = pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)


def count(model: "torch.nn.Module") -> int:
    return sum(parameter.numel() for parameter in model.parameters())


def clouds(n_clouds: int, n_points: int) -> "torch.Tensor":
    """Boxes of different proportions."""
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


def test_a_quarter_of_the_filters_is_a_sixteenth_of_the_parameters() -> None:
    assert count(find_model("threedmfv5-small").build(40)) == pytest.approx(45_767_016 / 16, rel=0.01)
    with pytest.raises(OptionError, match="n_filters must be even and at least 2; got 15"):
        ThreeDmFV(40, 5, 15)


def test_what_the_numbers_count() -> None:
    """Each T-Net and batch normalisation by itself: what their docstrings say."""
    pointnet = PointNet(40)
    assert (count(pointnet.input_transform), count(pointnet.feature_transform)) == (803_081, 1_857_344)
    norms = [m for m in pointnet.modules() if isinstance(m, torch.nn.BatchNorm1d)]
    pooled = [m for m in pointnet.modules() if isinstance(m, MaxLinear)]
    n_norm = sum(map(count, norms)) + sum(m.factor.numel() + m.shift.numel() for m in pooled)
    assert count(pointnet) - n_norm == 3_467_889
    threedmfv = ThreeDmFV(40)
    assert [count(layer) for layer in threedmfv.body if count(layer)] == [
        *(314_432, 1_295_488, 5_179_648, 5_376_256, 20_713_984)
    ]
    norms = [m for m in threedmfv.modules() if isinstance(m, (torch.nn.BatchNorm1d, torch.nn.BatchNorm3d))]
    assert count(threedmfv) - sum(map(count, norms)) == 45_756_904


@every_model
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
    network.settle(0.0)
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


def test_the_regulariser_is_computed_in_full_precision(monkeypatch: pytest.MonkeyPatch) -> None:
    """Mixed precision would round A A^T: for A = (1 + 1/128) I to multiples of 1/128, here."""
    monkeypatch.setattr("zbuf_occlude.learn.networks.ORTHOGONALITY", 1.0)  # not to be lost in the cross-entropy
    torch.manual_seed(3)
    network = PointNet(4).eval()
    points, labels = network.normalise(clouds(3, 30)), torch.tensor([0, 1, 2])
    with torch.no_grad():
        network.feature_transform.head[1].bias.copy_(torch.eye(64).flatten() / 128)
        with torch.autocast("cpu", torch.bfloat16):
            plain = torch.nn.functional.cross_entropy(network(points), labels)
            regulariser = network.loss(points, labels) - plain
    defect = (1 + 1 / 128) ** 2 - 1
    assert float(regulariser) == pytest.approx(64 * defect**2, rel=1e-3)


def test_normalisations() -> None:
    points = clouds(4, 50) * 7.0 + 3.0
    boxed = Classifier(2).normalise(points)
    assert torch.allclose(boxed.amax(dim=1), -boxed.amin(dim=1), atol=1e-6)
    assert torch.allclose((boxed.amax(dim=1) - boxed.amin(dim=1)).amax(dim=1), torch.ones(4))
    ball = unit_sphere(points)
    assert torch.allclose(ball.mean(dim=1), torch.zeros(4, 3), atol=1e-6)
    assert torch.allclose(torch.linalg.norm(ball, dim=2).amax(dim=1), torch.ones(4))
    for place in (Classifier(2).normalise(torch.ones(1, 5, 3)), unit_sphere(torch.ones(1, 5, 3))):
        assert torch.equal(place, torch.zeros(1, 5, 3)), "a cloud that is one place"


def test_an_unknown_model_names_the_known_ones() -> None:
    names = "voxnet, pointnet, threedmfv, threedmfv5, threedmfv5-small"
    with pytest.raises(OptionError, match=f"model must be one of {names}; got 'vox'"):
        find_model("vox")


def test_an_empty_grid_says_nothing_to_a_fresh_voxnet() -> None:
    torch.manual_seed(4)
    network = find_model("voxnet").build(3).eval()
    outside = torch.full((1, 1, 3), 5.0)
    with torch.inference_mode():
        assert float(network(outside).abs().max()) < 1e-6
        assert float(network(clouds(1, 50)).abs().max()) > 1e-4


def test_batch_normalisation_settles() -> None:
    for name in ("voxnet", "pointnet"):
        network = find_model(name).build(2)
        for progress, share in ((0.0, 0.5), (1.0, 0.05)):
            network.settle(progress)
            shares = [module.momentum for module in network.modules() if hasattr(module, "momentum")]
            assert shares == pytest.approx([share] * (0 if name == "voxnet" else 17))


def test_a_grid_of_few_gaussians_is_refused() -> None:
    with pytest.raises(OptionError, match="n_gaussians must be at least 5 per side; got 4"):
        ThreeDmFV(2, 4)
