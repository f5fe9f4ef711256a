"""Which side of the cut a particle lies on."""

from __future__ import annotations

from dataclasses import replace

import torch

from plop.dynamics.cut import advance_sides, is_blade
from tests.dynamics.conftest import blade, pose


def test_blade_marks_what_it_has_passed(block, cut_step):
    none = torch.zeros(len(block))
    side = advance_sides(none, block.means, cut_step)
    tip = cut_step.next_world_from_tool[2, 3]
    below = block.means[:, 2] < tip
    assert (side[below] == 0).all()
    assert (side[~below].abs() == 1).all()
    right = block.means[:, 0] > cut_step.next_world_from_tool[0, 3]
    same = side[~below] == side[~below][0]
    assert torch.equal(same, right[~below] == right[~below][0])


def test_a_side_once_given_stays(block, cut_step):
    side = advance_sides(torch.zeros(len(block)), block.means, cut_step)
    moved = replace(cut_step, next_world_from_tool=pose(0.06, 0.02, 0.009))
    later = advance_sides(side, block.means, moved)
    assert torch.equal(later[side != 0], side[side != 0])


def test_a_cube_is_no_blade():
    tool = blade()
    assert is_blade(tool)
    assert not is_blade(replace(tool, half_extent=torch.tensor([0.02, 0.02, 0.02])))
