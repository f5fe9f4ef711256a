"""The sums over pairs equal PyTorch's own operations, value and gradients."""

from __future__ import annotations

import pytest
import torch

from plop.dynamics.losses.pair_sums import TINY, alike_sum, rigid_sum, stretched_sum


@pytest.fixture
def pairs():
    generator = torch.Generator().manual_seed(3)
    first, second = torch.randint(40, (2, 300), generator=generator)
    apart = first != second
    first, second = first[apart], second[apart]
    weight, rest = torch.rand(2, len(first), generator=generator, dtype=torch.float64)
    return first, second, weight, rest


def drawn(*shape: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(sum(shape))
    return torch.randn(shape, generator=generator, dtype=torch.float64).requires_grad_()


def same(ours, reference, *values: torch.Tensor) -> None:
    """Compare two functions and their gradients, doubled as a loss after them would."""
    results = [function(*values) for function in (ours, reference)]
    torch.testing.assert_close(*results)
    gradients = [torch.autograd.grad(2 * result, values) for result in results]
    torch.testing.assert_close(*gradients)


def test_rigid(pairs):
    first, second, weight, _ = pairs

    def reference(turns, now, then):
        rotated = torch.einsum("eji,ej->ei", turns[first], now[second] - now[first])
        error = rotated - (then[second] - then[first])
        return (weight * error.square().sum(-1) + TINY).sqrt().sum()

    same(
        lambda *values: rigid_sum(first, second, weight, *values),
        reference,
        drawn(40, 3, 3),
        drawn(40, 3),
        2 * drawn(3, 40).T,
    )


def test_alike(pairs):
    first, second, weight, _ = pairs

    def reference(values):
        return (weight * (values[second] - values[first]).square().sum(-1) + TINY).sqrt().sum()

    same(lambda values: alike_sum(first, second, weight, values), reference, drawn(40, 4))


def test_stretched(pairs):
    first, second, weight, rest = pairs

    def reference(means):
        length = ((means[second] - means[first]).square().sum(-1) + TINY).sqrt()
        return (weight * (length - rest).square() + TINY).sqrt().sum()

    same(lambda means: stretched_sum(first, second, weight, rest, means), reference, drawn(40, 3))


def test_in_single_precision_and_without_pairs(pairs):
    first, second, weight, _ = pairs
    values = drawn(40, 4).detach().float().requires_grad_()
    total = alike_sum(first, second, weight.float(), values)
    total.backward()
    assert total.dtype == values.grad.dtype == torch.float32 and torch.isfinite(values.grad).all()
    none = torch.zeros(0, dtype=torch.int64)
    assert float(alike_sum(none, none, torch.zeros(0), values)) == 0
