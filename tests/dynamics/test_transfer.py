"""p2g and g2p: laws, an oracle with dense matrices, and gradients."""

from __future__ import annotations

import pytest
import torch

from plop.dynamics.particle_grid.kernels import NODES_PER_AXIS, Stencil, build_stencil
from plop.dynamics.particle_grid.transfer import g2p, p2g, p2g_sums


@pytest.fixture
def stencil() -> Stencil:
    torch.manual_seed(1)
    return build_stencil(torch.rand(40, 3, dtype=torch.float64) * 0.04 + 0.02, 0.01, (8, 8, 8), "quadratic")


def dense(stencil: Stencil) -> torch.Tensor:
    matrix = torch.zeros(len(stencil.nodes), stencil.node_count, dtype=stencil.weights.dtype)
    return matrix.scatter_add(1, stencil.nodes, stencil.weights)


def test_both_directions_match_a_dense_matrix(stencil):
    values, nodes = torch.randn(40, 5, dtype=torch.float64), torch.randn(512, 5, dtype=torch.float64)
    matrix = dense(stencil)
    total, mass = p2g_sums(values, stencil)
    torch.testing.assert_close(total, matrix.T @ values)
    torch.testing.assert_close(mass[:, 0], matrix.sum(0))
    torch.testing.assert_close(g2p(nodes, stencil), matrix @ nodes)


def test_mass_and_momentum_are_conserved(stencil):
    values = torch.randn(40, 3, dtype=torch.float64)
    mean, mass = p2g(values, stencil)
    torch.testing.assert_close(mass.sum(), torch.tensor(40.0, dtype=torch.float64))
    torch.testing.assert_close((mean * mass).sum(0), values.sum(0))


def test_a_constant_survives_and_empty_nodes_are_zero(stencil):
    mean, mass = p2g(torch.full((40, 2), 3.0, dtype=torch.float64), stencil)
    empty = mass[:, 0] == 0
    assert empty.any()
    assert (mean[empty] == 0).all()
    torch.testing.assert_close(mean[mass[:, 0] > 1e-3], torch.full_like(mean[mass[:, 0] > 1e-3], 3.0))


@pytest.mark.parametrize("kernel", list(NODES_PER_AXIS))
def test_gradients(kernel):
    torch.manual_seed(2)
    positions = (torch.rand(6, 3, dtype=torch.float64) * 0.02 + 0.021).requires_grad_()
    values = torch.randn(6, 2, dtype=torch.float64, requires_grad=True)

    def there_and_back(x: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
        stencil = build_stencil(x, 0.01, (6, 6, 6), kernel)
        return g2p(torch.cat(p2g_sums(v, stencil), dim=1), stencil)

    assert torch.autograd.gradcheck(there_and_back, (positions, values), eps=1e-7, atol=1e-5)


def test_batched_grids_do_not_mix():
    positions = torch.rand(20, 3) * 0.02 + 0.02
    batch = (torch.arange(20) % 2).long()
    both = build_stencil(positions, 0.01, (6, 6, 6), "quadratic", batch, 2)
    mean, _ = p2g(torch.where(batch == 0, 1.0, 5.0)[:, None], both)
    first, second = mean[:216], mean[216:]
    assert torch.isin(first.round(decimals=4), torch.tensor([0.0, 1.0])).all()
    assert torch.isin(second.round(decimals=4), torch.tensor([0.0, 5.0])).all()
