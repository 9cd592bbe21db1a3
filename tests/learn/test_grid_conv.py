"""The convolution for small grids: torch's own, values and gradients."""

import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")

from zbuf_occlude.learn.networks import SMALL, GridConv  # noqa: E402


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


def test_first_weights_are_as_wide_as_torchs() -> None:
    torch.manual_seed(0)
    ours, theirs = GridConv(32, 64, 3), torch.nn.Conv3d(32, 64, 3)
    for name in ("weight", "bias"):
        assert abs(float(getattr(ours, name).std() / getattr(theirs, name).std()) - 1.0) < 0.2
