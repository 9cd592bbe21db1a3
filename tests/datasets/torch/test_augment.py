"""The augmentations: what they change, and what they must leave."""

import math

import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")

from zbuf_occlude import OptionError  # noqa: E402
from zbuf_occlude.datasets.torch import Compose, Jitter, Rescale, Rotate, augmentation  # noqa: E402


@pytest.fixture
def cloud() -> "torch.Tensor":
    torch.manual_seed(3)
    return torch.rand(500, 3) - 0.5


def test_rotation_is_about_the_vertical_axis_and_rigid(cloud: "torch.Tensor") -> None:
    turned = Rotate()(cloud)
    assert torch.equal(turned[:, 2], cloud[:, 2])
    assert torch.allclose(torch.linalg.norm(turned, dim=1), torch.linalg.norm(cloud, dim=1), atol=1e-6)
    gaps = (torch.linalg.norm(c[1:] - c[:-1], dim=1) for c in (turned, cloud))
    assert torch.allclose(next(gaps), next(gaps), atol=1e-6)
    assert not torch.allclose(turned, cloud, atol=1e-2)


def test_rotation_is_uniform_within_its_angle() -> None:
    one = torch.tensor([[1.0, 0.0, 0.0]])
    for angle in (math.pi, 0.5):
        turned = torch.cat([Rotate(angle)(one) for _ in range(2000)])
        angles = torch.atan2(turned[:, 1], turned[:, 0])
        assert angles.abs().max() <= angle
        # of a uniform variable: mean 0, standard deviation a / sqrt(3); five standard errors
        assert abs(angles.mean()) < 5 * angle / math.sqrt(3 * 2000)
        assert abs(angles.std() - angle / math.sqrt(3)) < 0.05 * angle


def test_further_columns_stay_but_for_normals_that_turn_along(cloud: "torch.Tensor") -> None:
    """Where the normals are the positions, they turn alike; colours stay, and so do normals that are not said to be."""
    wide = torch.cat([cloud, cloud, torch.rand(500, 3)], dim=1)
    turned = Rotate(normals=True)(wide)
    assert torch.equal(turned[:, :3], turned[:, 3:6])
    assert not torch.equal(turned[:, :3], wide[:, :3])
    assert torch.equal(turned[:, 6:], wide[:, 6:])
    for transform in (Rotate(), Rescale(), Jitter()):
        assert torch.equal(transform(wide)[:, 3:], wide[:, 3:])
    torch.manual_seed(5)
    narrow = augmentation(normals=True)(wide)[:, :3]
    torch.manual_seed(5)
    assert torch.equal(narrow, augmentation()(cloud))


def test_scaling_is_one_factor_within_its_range(cloud: "torch.Tensor") -> None:
    factors = torch.tensor([float((Rescale(0.5, 2.0)(cloud) / cloud).median()) for _ in range(200)])
    assert 0.5 <= factors.min() < 0.6
    assert 1.9 < factors.max() <= 2.0
    ratio = Rescale()(cloud) / cloud
    assert torch.allclose(ratio, ratio[0, 0].expand_as(ratio), rtol=1e-4)


def test_jitter_is_gaussian_and_clipped(cloud: "torch.Tensor") -> None:
    noise = Jitter(0.01, 0.015)(cloud) - cloud
    assert noise.abs().max() <= 0.015 + 1e-6
    assert abs(noise.mean()) < 0.002
    assert 0.007 < noise.std() < 0.01
    assert torch.equal(Jitter(0.0)(cloud), cloud)


def test_the_papers_three_in_a_row_leave_the_cloud_they_were_given(cloud: "torch.Tensor") -> None:
    before = cloud.clone()
    three = augmentation()
    assert [type(step) for step in three.transforms] == [Rotate, Rescale, Jitter]
    assert three(cloud).shape == cloud.shape
    assert torch.equal(cloud, before)
    torch.manual_seed(7)
    one = three(cloud)
    torch.manual_seed(7)
    assert torch.equal(three(cloud), one)
    assert torch.equal(Compose(())(cloud), cloud)


def test_each_of_several_clouds_has_changes_of_its_own(cloud: "torch.Tensor") -> None:
    several = cloud.expand(3, -1, -1)
    turned = Rotate()(several)
    for one in turned:
        assert torch.equal(one[:, 2], cloud[:, 2])
        assert torch.allclose(torch.linalg.norm(one, dim=1), torch.linalg.norm(cloud, dim=1), atol=1e-6)
    ratio = Rescale()(several) / several
    assert torch.allclose(ratio, ratio[:, :1, :1].expand_as(ratio), rtol=1e-4)
    for changed in (turned, ratio, Jitter()(several)):
        assert torch.pdist(changed.flatten(1)).min() > 1e-3
    torch.manual_seed(7)
    one = augmentation()(cloud)
    torch.manual_seed(7)
    assert torch.allclose(augmentation()(cloud[None])[0], one, atol=1e-6)


def test_errors() -> None:
    with pytest.raises(OptionError, match=r"a scale must run upwards from above 0; got 2\.0\.\.1\.0"):
        Rescale(2.0, 1.0)
    with pytest.raises(OptionError, match="sigma and clip must not be negative"):
        Jitter(-1.0)
