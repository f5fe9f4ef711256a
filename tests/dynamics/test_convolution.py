"""The direct convolution is PyTorch's own to rounding, and so are its gradients."""

from __future__ import annotations

import pytest
import torch
from torch.testing import assert_close

from plop.dynamics.i2n.convolution import DirectConv3d


def by_pytorch(layer: DirectConv3d, x: torch.Tensor) -> torch.Tensor:
    return torch.nn.functional.conv3d(x, layer.weight, layer.bias, layer.stride, layer.padding)


@pytest.mark.parametrize("batch", [1, 3])
@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("bias", [True, False])
def test_values_and_gradients(batch, stride, bias):
    torch.manual_seed(0)
    layer = DirectConv3d(5, 7, 3, stride=stride, padding=1, bias=bias)
    x = torch.randn(batch, 5, 9, 8, 6, requires_grad=True)
    one, other = layer(x), by_pytorch(layer, x)
    assert_close(one, other, atol=1e-5, rtol=1e-4)
    wanted = (x, *layer.parameters())
    weights = torch.randn_like(one)
    for mine, usual in zip(
        torch.autograd.grad((one * weights).sum(), wanted),
        torch.autograd.grad((other * weights).sum(), wanted),
        strict=True,
    ):
        assert mine.layout is torch.strided
        assert_close(mine, usual, atol=1e-4, rtol=1e-4)


def test_only_the_gradients_that_are_wanted():
    layer = DirectConv3d(3, 4, 3, padding=1)
    layer.weight.requires_grad_(False)
    x = torch.randn(1, 3, 4, 4, 4, requires_grad=True)
    layer(x).sum().backward()
    assert layer.weight.grad is None and x.grad is not None and layer.bias is not None and layer.bias.grad is not None
    fixed = layer(x.detach())
    assert_close(fixed, by_pytorch(layer, x))


def test_double_precision_goes_the_usual_way():
    layer = DirectConv3d(2, 3, 3, padding=1).double()
    x = torch.randn(1, 2, 4, 4, 4, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(layer, (x,))
