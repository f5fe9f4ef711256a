"""The activation has the same digits on any number of threads, forward and backward."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from plop.dynamics.activation import SiLU


@pytest.fixture
def threads() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def on(threads: int, act: torch.nn.Module, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    torch.set_num_threads(threads)
    x = x.clone().requires_grad_()
    y = act(x)
    y.square().sum().backward()
    assert x.grad is not None
    return y.detach(), x.grad


@pytest.mark.parametrize("shape", [(1499, 48), (3, 7), (1, 24, 17, 19, 23)])
def test_digits_do_not_hang_on_threads(threads: None, shape: tuple[int, ...]) -> None:
    x = torch.randn(shape, generator=torch.Generator().manual_seed(1))
    one = on(1, SiLU(), x)
    assert all(torch.equal(a, b) for a, b in zip(one, on(1, torch.nn.SiLU(), x), strict=True))
    for several in (2, 3):
        assert all(torch.equal(a, b) for a, b in zip(one, on(several, SiLU(), x), strict=True))
    assert one[0].shape == x.shape
