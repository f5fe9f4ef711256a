"""Laws of the interpolation kernels."""

from __future__ import annotations

import pytest
import torch

from plop.dynamics.kernels import NODES_PER_AXIS, build_stencil


@pytest.mark.parametrize("kernel", list(NODES_PER_AXIS))
def test_weights_are_a_partition_of_unity(kernel):
    positions = torch.rand(50, 3, dtype=torch.float64) * 0.05 + 0.03
    nodes, weights = build_stencil(positions, 0.01, (12, 12, 12), kernel).spread()
    assert nodes.shape == (50, NODES_PER_AXIS[kernel] ** 3)
    torch.testing.assert_close(weights.sum(1), torch.ones(50, dtype=torch.float64))
    assert (weights >= 0).all()


@pytest.mark.parametrize("kernel", ["quadratic", "cubic"])
def test_smooth_kernels_reproduce_a_linear_field(kernel):
    positions = torch.rand(50, 3, dtype=torch.float64) * 0.05 + 0.03
    nodes, weights = build_stencil(positions, 0.01, (12, 12, 12), kernel).spread()
    places = torch.stack(torch.meshgrid(*[torch.arange(12.0, dtype=torch.float64) * 0.01] * 3, indexing="ij"), -1)
    found = (places.reshape(-1, 3)[nodes] * weights[..., None]).sum(1)
    torch.testing.assert_close(found, positions)


def _weight_at(x: float, node: int, kernel: str) -> float:
    place = torch.tensor([[x, 0.03, 0.03]], dtype=torch.float64)
    nodes, weights = build_stencil(place, 0.01, (8, 8, 8), kernel).spread()
    return float(weights[nodes // 64 == node].sum())


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
