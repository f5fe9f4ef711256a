"""The grid follows the particles, and stays bounded."""

from __future__ import annotations

import pytest
import torch

from plop.dynamics.particle_grid.grid import MOST_NODES, fit_grid
from plop.errors import PlopError

ALONE = torch.zeros(100, dtype=torch.int64)


def test_it_covers_the_particles_with_room_on_all_sides():
    points = torch.rand(100, 3, generator=torch.Generator().manual_seed(0)) - 0.3
    box = fit_grid(points, ALONE, 1, 0.05, stride=4)
    high = box.origin[0] + 0.05 * (torch.tensor(box.shape) - 1)
    assert (box.origin[0] <= points.amin(0) - 0.1 + 1e-6).all() and (high >= points.amax(0) + 0.1 - 1e-6).all()
    assert all(n % 4 == 0 for n in box.shape)


@pytest.mark.parametrize("stray", [1e3, 1e30, float("nan"), float("inf")])
def test_a_particle_that_flew_away_is_an_error_and_not_a_huge_grid(stray):
    points = torch.rand(100, 3)
    points[7] = stray
    with pytest.raises(PlopError, match="flown apart") as raised:
        fit_grid(points, ALONE, 1, 0.05, stride=4)
    assert str(MOST_NODES) in raised.value.render()
