"""Laws of the model: symmetries, independence of a batch, resampling that follows the lineage."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch.testing import assert_close

from plop.dynamics.i2n.features import object_features, rigid_displacement
from plop.dynamics.i2n.model import PlopConfig, PlopModel
from plop.dynamics.i2n.model_io import load_model, save_model
from plop.dynamics.i2n.network import I2NConfig
from plop.dynamics.i2n.tool_frame import tool_frame
from plop.dynamics.interface import ParticleState, ToolStep, at_rest
from plop.dynamics.resampling import ResamplingConfig, resample
from plop.errors import PlopError
from plop.geometry.rigid import matrix_to_quat, quat_multiply
from tests.dynamics.conftest import block_of, pose


@pytest.fixture
def model() -> PlopModel:
    return moving_model(I2NConfig(width=8, cells_across=6))


def moving_model(network: I2NConfig) -> PlopModel:
    torch.manual_seed(0)
    made = PlopModel(PlopConfig(network=network, length_m=0.06))
    # A fresh model hardly moves anything; laws need motion to be tested on.
    torch.nn.init.normal_(made.network.decode[-1].weight, std=0.3)
    return made.eval()


def transformed(state: ParticleState, action: ToolStep, change: torch.Tensor) -> tuple[ParticleState, ToolStep]:
    """Move the whole experiment by a rigid transform about the vertical."""
    turn, shift = change[:3, :3], change[:3, 3]
    g = state.gaussians
    quats = quat_multiply(matrix_to_quat(turn).expand(len(g), 4), g.quats)
    moved = g.with_(means=g.means @ turn.T + shift, quats=quats)
    state = replace(
        state,
        gaussians=moved,
        last_translation=state.last_translation @ turn.T,
        last_rotation=state.last_rotation @ turn.T,
    )
    return state, replace(
        action,
        world_from_tool=change @ action.world_from_tool,
        next_world_from_tool=change @ action.next_world_from_tool,
    )


def moving(block) -> ParticleState:
    torch.manual_seed(3)
    side = torch.sign(block.means[:, 0] - 0.03)
    return ParticleState(block, 1e-3 * torch.randn(len(block), 3), 0.01 * torch.randn(len(block), 3), side, True)


def test_prediction_turns_and_moves_with_the_experiment(model, block, cut_step):
    state = moving(block)
    change = pose(0.3, -0.2, 0.0, yaw=0.7)
    with torch.no_grad():
        here = model.predict([state], [cut_step])[0]
        there = model.predict(*[[x] for x in transformed(state, cut_step, change)])[0]
    assert here.last_translation.norm(dim=-1).mean() > 1e-4
    assert_close(there.last_translation, here.last_translation @ change[:3, :3].T, atol=2e-6, rtol=1e-3)
    assert_close(there.last_rotation, here.last_rotation @ change[:3, :3].T, atol=2e-4, rtol=1e-3)


@pytest.mark.parametrize(("yaw", "same"), [(torch.pi, True), (0.7, False)])
def test_a_model_that_is_told_the_table_s_axes_is_indifferent_to_half_a_turn_alone(block, cut_step, yaw, same):
    model, state = moving_model(I2NConfig(features="oriented", width=8, cells_across=6)), moving(block)
    change = pose(0.3, -0.2, 0.0, yaw=yaw)
    with torch.no_grad():
        here = model.predict([state], [cut_step])[0].last_translation @ change[:3, :3].T
        there = model.predict(*[[x] for x in transformed(state, cut_step, change)])[0].last_translation
    assert here.norm(dim=-1).mean() > 1e-4
    assert torch.allclose(there, here, atol=2e-6, rtol=1e-3) == same


def test_a_mirrored_window_shows_the_mirrored_experiment(block, cut_step):
    """The tool's motion and its image in the table's axis are mirrored alike."""
    step = replace(cut_step, next_world_from_tool=pose(0.004, 0.001, 0) @ cut_step.next_world_from_tool)
    turned = pose(0, 0, 0, yaw=0.3)
    step = replace(
        step, world_from_tool=turned @ step.world_from_tool, next_world_from_tool=turned @ step.next_world_from_tool
    )
    state, frame = moving(block), tool_frame(step)
    with_tool = rigid_displacement(state.gaussians.means, step)
    plain, mirrored = (
        object_features(
            state, step, f, with_tool, f.points_in(state.gaussians.means), length_m=0.06, motion_m=1e-3, kind="oriented"
        )[:, -2:]
        for f in (frame, frame.reflected(True, False))
    )
    assert plain.abs().min() > 0.1
    assert_close(mirrored, plain * torch.tensor([-1.0, 1.0]))


def test_steps_of_a_batch_do_not_see_each_other(model, cut_step):
    states = [moving(block_of(300, 1)), moving(block_of(200, 2))]
    with torch.no_grad():
        together = model.predict(states, [cut_step, cut_step])
        alone = [model.predict([s], [cut_step])[0] for s in states]
    # Batch statistics do not exist, but a common grid shape may differ in padding far from the object.
    for one, other in zip(together, alone, strict=True):
        assert_close(one.last_translation, other.last_translation, atol=5e-5, rtol=0.1)


def test_order_of_particles_does_not_matter(model, block, cut_step):
    state = moving(block)
    order = torch.randperm(len(block))
    with torch.no_grad():
        one = model.predict([state], [cut_step])[0].last_translation[order]
        other = model.predict([state.select(order)], [cut_step])[0].last_translation
    assert_close(one, other, atol=1e-6, rtol=1e-3)


def test_first_frame_needs_no_history(model, block, cut_step):
    with torch.no_grad():
        after = model.step(at_rest(block), cut_step)
    assert after.has_history
    assert torch.isfinite(after.gaussians.means).all()


def test_save_and_load_give_the_same_prediction(model, block, cut_step, tmp_path):
    save_model(tmp_path, model, training={"step": 3})
    again = load_model(tmp_path)
    with torch.no_grad():
        one = model.predict([at_rest(block)], [cut_step])[0]
        other = again.predict([at_rest(block)], [cut_step])[0]
    assert torch.equal(one.gaussians.means, other.gaussians.means)


def test_damaged_weights_are_named(model, tmp_path):
    save_model(tmp_path, model)
    weights = tmp_path / "model.safetensors"
    weights.write_bytes(weights.read_bytes()[:100])
    with pytest.raises(PlopError, match="weights cannot be read"):
        load_model(tmp_path)


def test_motion_and_side_follow_merging_and_splitting(block):
    state = moving(block)
    long = block.scales.clone()
    long[5, 0] = 10 * long[5, 1:].amin()
    opacities = block.opacities.clone()
    opacities[7] = 0.01
    scales = torch.full_like(long, 0.001)
    scales[5, 0] = 0.01
    state = replace(state, gaussians=block.with_(scales=scales, opacities=opacities))
    after = resample(state, ResamplingConfig(split_above=4.0), generator=torch.Generator().manual_seed(0))
    assert 7 not in after.gaussians.ids
    assert (after.gaussians.ids == 5).sum() == 2
    assert_close(after.last_translation[after.gaussians.ids == 5], state.last_translation[[5, 5]])
    assert_close(after.side, state.side[after.gaussians.ids])
    assert (after.resampling.merges, after.resampling.splits) == (1, 1)
    assert torch.equal(block.ids[after.resampling.parents], after.gaussians.ids)
    assert after.select(torch.arange(3)).resampling is None, "a selection is of other Gaussians"


def test_a_step_says_what_it_did_to_the_set_and_the_next_one_forgets(block, model, cut_step):
    splitting = replace(model.config, resampling=ResamplingConfig(split_above=2.0, max_count=len(block) + 9))
    model.config = splitting
    with torch.no_grad():
        after = model.step(at_rest(block), cut_step, generator=torch.Generator().manual_seed(0))
        assert after.resampling.splits == 9 and len(after.side) == len(block) + 9
        assert model.step(after, cut_step).resampling is None, "there is no room for more, and nothing merges"


def test_resampling_can_be_switched_off(block):
    state = moving(block)
    assert resample(state, ResamplingConfig(enabled=False)) is state
