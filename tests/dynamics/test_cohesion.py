"""What no blade has parted stays together; what one has parted does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from torch.testing import assert_close

from plop.dynamics.cohesion import expected_places, held_together, natural_strays_m
from plop.dynamics.i2n.model import PlopConfig, PlopModel
from plop.dynamics.interface import at_rest
from plop.dynamics.resampling import ResamplingConfig, resample
from plop.dynamics.rest import RestPlaces
from tests.dynamics.conftest import block_of

TURN = Rotation.from_rotvec([0.4, -1.1, 0.9])
LIMIT_M = 1e-4


def moved_rigidly(means: torch.Tensor) -> torch.Tensor:
    turn = torch.from_numpy(TURN.as_matrix()).to(means)
    return means @ turn.T + torch.tensor([0.02, -0.01, 0.03])


def state_at(block, means: torch.Tensor, side: torch.Tensor | None = None):
    state = at_rest(block)
    side = state.side if side is None else side
    return replace(state, gaussians=block.with_(means=means), side=side, has_history=True)


def test_strays_come_back_and_the_others_stay(block):
    places = moved_rigidly(block.means)
    strays = torch.arange(0, 400, 40)
    off = torch.zeros_like(places)
    off[strays] = 0.01 * torch.nn.functional.normalize(torch.randn(len(strays), 3), dim=-1)
    before, after = state_at(block, places), state_at(block, places + off)
    held = held_together(before, after, LIMIT_M)
    apart = (held.gaussians.means - places).norm(dim=-1)
    assert apart[strays].max() < LIMIT_M + 5e-5
    others = torch.ones(400, dtype=torch.bool)
    others[strays] = False
    assert torch.equal(held.gaussians.means[others], after.gaussians.means[others])
    assert_close(held.last_translation - after.last_translation, held.gaussians.means - after.gaussians.means)


def test_a_rigid_motion_however_large_is_left_as_it_is(block):
    after = state_at(block, moved_rigidly(block.means))
    assert held_together(state_at(block, block.means), after, LIMIT_M) is after
    assert_close(
        expected_places(after.rest, after.gaussians.means, after.side), after.gaussians.means, atol=2e-6, rtol=0
    )


def test_halves_that_a_blade_has_parted_go_their_own_ways(block):
    side = torch.where(block.means[:, 0] < 0.03, -1.0, 1.0)
    means = block.means + torch.relu(side)[:, None] * torch.tensor([0.03, 0.0, 0.0])
    parted = state_at(block, means, side)
    assert held_together(state_at(block, block.means, side), parted, LIMIT_M) is parted
    whole = state_at(block, means)
    assert held_together(state_at(block, block.means), whole, LIMIT_M) is not whole


def test_where_a_filter_has_put_a_gaussian_it_may_stay(block):
    off = torch.zeros(400, 3)
    off[7, 2] = 0.004
    before = state_at(block, block.means + off)
    for way, kept in ((1.0, 0.004), (2.0, 0.004), (0.5, 0.002)):
        held = held_together(before, state_at(block, block.means + way * off), LIMIT_M)
        assert float(held.gaussians.means[7, 2] - block.means[7, 2]) == pytest.approx(kept, abs=1e-4)


def test_without_a_limit_or_a_first_frame_nothing_is_done(block):
    after = state_at(block, block.means + 0.01 * torch.randn(400, 3))
    before = state_at(block, block.means)
    assert held_together(before, after, None) is after
    unknown = replace(after, rest=None)
    assert held_together(before, unknown, LIMIT_M) is unknown


def test_a_few_gaussians_tell_nothing():
    block = block_of(4)
    after = state_at(block, block.means + 0.01 * torch.randn(4, 3))
    assert held_together(state_at(block, block.means), after, LIMIT_M) is after


def reference_place(rest: np.ndarray, now: np.ndarray, i: int) -> np.ndarray:
    """The same fit by scipy's solution of Wahba's problem."""
    distance, near = cKDTree(rest).query(rest[i], k=range(2, 22))
    weight = np.ones(20)
    for attempt in range(3):
        then, here = (np.average(points[near], axis=0, weights=weight) for points in (rest, now))
        turn = Rotation.align_vectors(now[near] - here, rest[near] - then, weights=weight)[0]
        miss = np.linalg.norm(now[near] - here - turn.apply(rest[near] - then), axis=1)
        if attempt < 2:
            weight = 1 / (1 + (miss / (0.05 * distance.max())) ** 2)
    return here + turn.apply(rest[i] - then)


def test_places_agree_with_scipy(block):
    torch.manual_seed(1)
    now = moved_rigidly(block.means) + 3e-4 * torch.randn(400, 3)
    now[::13] += 0.01
    rows = torch.arange(0, 400, 7)
    found = expected_places(RestPlaces(block.means), now, torch.zeros(400), rows)
    rest, places = block.means.double().numpy(), now.double().numpy()
    wanted = np.stack([reference_place(rest, places, int(i)) for i in rows])
    np.testing.assert_allclose(found.numpy(), wanted, atol=2e-6)


def test_what_is_natural_is_measured_frame_by_frame(block):
    torch.manual_seed(2)
    loose = moved_rigidly(block.means) + 5e-4 * torch.randn(400, 3)
    frames = torch.stack([moved_rigidly(block.means), loose])
    found = natural_strays_m(RestPlaces(block.means), frames, torch.zeros(2, 400))
    offset = loose - expected_places(RestPlaces(block.means), loose, torch.zeros(400))
    assert found == pytest.approx(float(np.quantile(offset.norm(dim=-1), 0.99)), rel=1e-5)
    assert 1e-3 < found < 3e-3


def test_places_of_rest_follow_merging_and_splitting(block):
    long, opacities = block.scales.clone(), block.opacities.clone()
    long[5, 0], opacities[9] = 30 * long[5, 1:].amin(), 0.01
    state = at_rest(block.with_(scales=long, opacities=opacities))
    after = resample(state, ResamplingConfig(), generator=torch.Generator().manual_seed(0))
    halves = after.gaussians.ids == 5
    assert halves.sum() == 2 and not (after.gaussians.ids == 9).any()
    assert_close(after.rest.places[halves], after.gaussians.means[halves])
    unchanged = (after.gaussians.ids != 5) & (after.gaussians.ids != 9)
    assert_close(after.rest.places[unchanged], block.means[after.gaussians.ids[unchanged]])


def test_a_model_holds_its_prediction_together(block, cut_step):
    torch.manual_seed(0)
    model = PlopModel(PlopConfig(length_m=0.06, tool_points=50))
    torch.nn.init.normal_(model.network.decode[-1].weight, std=0.3)
    state = at_rest(block)
    with torch.no_grad():
        free = model.step(state, cut_step)
        model.config = replace(model.config, stray_m=1e-5)
        held = model.step(state, cut_step)

    def apart(state) -> float:
        return natural_strays_m(state.rest, state.gaussians.means[None], state.side[None])

    assert apart(held) < 0.5 * apart(free)
    assert torch.equal(held.side, free.side)
