"""Laws of the interpolation kernels."""

from __future__ import annotations

import pytest
import torch

from plop.dynamics.particle_grid.kernels import NODES_PER_AXIS, _spread, axis_weights, build_stencil


@pytest.mark.parametrize("kernel", list(NODES_PER_AXIS))
def test_weights_are_a_partition_of_unity(kernel):
    positions = torch.rand(50, 3, dtype=torch.float64) * 0.05 + 0.03
    stencil = build_stencil(positions, 0.01, (12, 12, 12), kernel)
    assert stencil.nodes.shape == (50, NODES_PER_AXIS[kernel] ** 3)
    torch.testing.assert_close(stencil.weights.sum(1), torch.ones(50, dtype=torch.float64))
    assert (stencil.weights >= 0).all()


@pytest.mark.parametrize("kernel", ["quadratic", "cubic"])
def test_smooth_kernels_reproduce_a_linear_field(kernel):
    positions = torch.rand(50, 3, dtype=torch.float64) * 0.05 + 0.03
    stencil = build_stencil(positions, 0.01, (12, 12, 12), kernel)
    places = torch.stack(torch.meshgrid(*[torch.arange(12.0, dtype=torch.float64) * 0.01] * 3, indexing="ij"), -1)
    found = (places.reshape(-1, 3)[stencil.nodes] * stencil.weights[..., None]).sum(1)
    torch.testing.assert_close(found, positions)


def _weight_at(x: float, node: int, kernel: str) -> float:
    stencil = build_stencil(torch.tensor([[x, 0.03, 0.03]], dtype=torch.float64), 0.01, (8, 8, 8), kernel)
    return float(stencil.weights[stencil.nodes // 64 == node].sum())


@pytest.mark.parametrize(("kernel", "jump"), [("quadratic", 0.0), ("cubic", 0.0), ("paper", 1 / 6)])
def test_only_the_papers_kernel_jumps_at_a_cell_border(kernel, jump):
    # The weight of node 4 just before and just after a particle passes the far end of the kernel's reach.
    edge = {"quadratic": 0.025, "cubic": 0.02, "paper": 0.03}[kernel]
    before, after = _weight_at(edge - 1e-9, 4, kernel), _weight_at(edge + 1e-9, 4, kernel)
    assert abs(after - before) == pytest.approx(jump / (2 / 3 + 1 / 6), abs=1e-6)


def test_cubic_matches_its_closed_form():
    x = 0.0337
    for node in range(8):
        distance = abs(x / 0.01 - node)
        inner = distance**3 / 2 - distance**2 + 2 / 3
        outer = (2 - distance) ** 3 / 6
        expected = inner if distance < 1 else outer if distance < 2 else 0.0
        assert _weight_at(x, node, "cubic") == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("kernel", list(NODES_PER_AXIS))
def test_the_compiled_stencil_is_the_torch_form(kernel):
    torch.manual_seed(0)
    positions = torch.rand(40, 3, dtype=torch.float64) * 0.09 - 0.01  # some reach beyond the grid
    batch = torch.randint(0, 2, (40,))
    positions.requires_grad_()
    stencil = build_stencil(positions, 0.01, (7, 6, 5), kernel, batch, 2)
    first, weights = axis_weights(positions / 0.01, kernel)
    nodes, product = _spread(first, weights, batch * 210, (7, 6, 5))
    assert torch.equal(stencil.nodes, nodes) and stencil.node_count == 420
    torch.testing.assert_close(stencil.weights, product)
    grad = torch.randn_like(product)
    wanted = torch.autograd.grad((product * grad).sum(), positions)[0]
    torch.testing.assert_close(torch.autograd.grad((stencil.weights * grad).sum(), positions)[0], wanted)
