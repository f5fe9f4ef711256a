"""A blade that passes Gaussians leaves two faces, through which none reaches."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch.testing import assert_close

from plop.dynamics.cut import advance_sides, narrowed_at_cut
from plop.dynamics.i2n.model import PlopConfig, PlopModel
from plop.dynamics.interface import at_rest
from plop.geometry.rigid import matrix_to_quat, quat_multiply
from tests.dynamics.conftest import pose

PLANE_X_M = 0.032
"""Where the blade of `cut_step` ends."""


@pytest.fixture
def cut(block, cut_step):
    """Sides before, and the state in which the blade has just come to the end of its step."""
    wide = block.with_(scales=3 * block.scales)
    state = at_rest(wide)
    return state.side, replace(state, side=advance_sides(state.side, wide.means, cut_step))


def across(gaussians) -> torch.Tensor:
    return gaussians.covariances[:, 0, 0].sqrt()


def test_those_that_the_blade_passes_end_at_the_cut(cut, cut_step):
    before, after = cut
    narrowed = narrowed_at_cut(before, after, cut_step)
    reached, distance = after.side != 0, (after.gaussians.means[:, 0] - PLANE_X_M).abs()
    assert 100 < reached.sum() < 400
    was, now = across(after.gaussians), across(narrowed.gaussians)
    assert ((was > distance) & reached).sum() > 20
    assert_close(now[reached], torch.minimum(was, distance.clamp_min(2e-4))[reached], atol=1e-6, rtol=1e-3)
    # Along the face they are as wide as before.
    changed = reached & (was > distance.clamp_min(2e-4))
    along = [g.covariances[changed][:, 1:, 1:] for g in (narrowed.gaussians, after.gaussians)]
    assert_close(along[0], along[1], atol=1e-9, rtol=1e-3)
    others = ~changed
    assert torch.equal(narrowed.gaussians.scales[others], after.gaussians.scales[others])
    assert torch.equal(narrowed.gaussians.means, after.gaussians.means)


def test_a_turned_blade_narrows_along_its_own_normal(cut, cut_step):
    before, after = cut
    change = pose(0.1, -0.2, 0.0, yaw=0.8)
    turned = replace(
        cut_step,
        world_from_tool=change @ cut_step.world_from_tool,
        next_world_from_tool=change @ cut_step.next_world_from_tool,
    )
    g = after.gaussians
    quats = quat_multiply(matrix_to_quat(change[:3, :3]).expand(len(g), 4), g.quats)
    there = replace(after, gaussians=g.with_(means=g.means @ change[:3, :3].T + change[:3, 3], quats=quats))
    here = narrowed_at_cut(before, after, cut_step).gaussians.covariances
    found = narrowed_at_cut(before, there, turned).gaussians.covariances
    assert_close(found, change[:3, :3] @ here @ change[:3, :3].T, atol=1e-9, rtol=1e-3)


def test_what_was_cut_before_keeps_its_shape(cut, cut_step):
    _, after = cut
    assert narrowed_at_cut(after.side, after, cut_step) is after


def test_a_model_does_it_when_it_is_told_to(block, cut_step):
    wide = block.with_(scales=3 * block.scales)
    with torch.no_grad():
        plain = PlopModel(PlopConfig(tool_points=50)).move(at_rest(wide), cut_step)
        cutting = PlopModel(PlopConfig(tool_points=50, cut_faces=True)).move(at_rest(wide), cut_step)
    assert (across(cutting.gaussians) < 0.9 * across(plain.gaussians)).sum() > 20
