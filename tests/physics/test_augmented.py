"""Base + (engine with effects - engine without), for any base; models of every kind from their folders."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from plop.dynamics.baselines import ConstantVelocity
from plop.dynamics.i2n.model import PlopConfig, PlopModel
from plop.dynamics.i2n.model_io import save_model
from plop.dynamics.interface import DynamicsModel, ParticleState, ToolStep, at_rest
from plop.errors import PlopError
from plop.models import effects_of, engine_of, innermost, load_model
from plop.physics.adapters.augmented import AugmentedModel, _interpolated
from plop.physics.adapters.base_io import base_to_dict
from plop.physics.adapters.filled_model import FilledEngineModel
from plop.physics.effects.library import effect_type
from tests.support.coarse_episodes import BASE, actions, coarse_episode, gaussians, paths, rollout

FRAMES = 4
TILT, SOFTER = effect_type("tilt")(gx_m_s2=3.0), effect_type("stiffness")(d_ln_e=-0.7)


def run(model: DynamicsModel) -> np.ndarray:
    return paths(rollout(model, coarse_episode(0), FRAMES))


def difference(*effects) -> np.ndarray:
    return run(FilledEngineModel(BASE, effects)) - run(FilledEngineModel(BASE))


def test_over_persistence_the_prediction_is_the_difference():
    added = difference(SOFTER)
    assert np.abs(added).max() > 2e-4
    found = run(AugmentedModel(ConstantVelocity(keep=0), BASE, (SOFTER,)))
    np.testing.assert_allclose(found, run(ConstantVelocity(keep=0)) + added, atol=1e-6)


def test_what_needs_shorter_steps_but_does_nothing_moves_nothing():
    """Cohesion acts on cut faces, and nothing is cut; shorter time steps alone would move what is pushed."""
    added = difference(effect_type("cohesion")(traction_pa=1500.0))
    base = ConstantVelocity(keep=0)
    found = run(AugmentedModel(base, BASE, (effect_type("cohesion")(traction_pa=1500.0),))) - run(base)
    assert np.abs(found).max() < 0.05 * np.abs(added).max() and np.abs(added).max() > 5e-6


def test_amplitude_zero_is_the_base():
    base = run(ConstantVelocity(keep=0))
    np.testing.assert_array_equal(run(AugmentedModel(ConstantVelocity(keep=0), BASE, (effect_type("tilt")(),))), base)
    np.testing.assert_array_equal(run(AugmentedModel(ConstantVelocity(keep=0), BASE, ())), base)


def test_the_order_of_effects_does_not_matter():
    one, other = (
        run(AugmentedModel(ConstantVelocity(keep=0), BASE, pair)) for pair in ((TILT, SOFTER), (SOFTER, TILT))
    )
    np.testing.assert_allclose(one, other, atol=2e-6)


class Shuffling:
    """A base that hands its Gaussians out in another order, one of them twice, far from where the engine has them."""

    def step(
        self, state: ParticleState, action: ToolStep, *, generator: torch.Generator | None = None
    ) -> ParticleState:
        rows = torch.cat([torch.arange(len(state.gaussians)).flip(0), torch.tensor([0])])
        moved = state.select(rows)
        means = moved.gaussians.means + torch.tensor([0.0, 0.02, 0.0])
        return replace(moved, gaussians=moved.gaussians.with_(means=means), has_history=True)


def test_descendants_get_what_their_ancestor_gets():
    episode, model = coarse_episode(0), AugmentedModel(Shuffling(), BASE, (SOFTER,))
    states = rollout(model, episode, 3)
    added = difference(SOFTER)[1]
    ids = states[1].gaussians.ids.numpy()
    start = episode.points[0][ids] + [0, 0.02, 0]
    np.testing.assert_allclose(states[1].gaussians.means.numpy(), start + added[ids], atol=1e-6)


def test_neighbours_of_the_same_side_stand_in_without_lineage():
    places = np.array([[0.01 * k, 0, 0] for k in range(-5, 6)])
    side = torch.tensor(np.sign(places[:, 0]))
    values = np.sign(places) * [1, 0, 0]
    wanted = torch.tensor([[0.004, 0, 0], [-0.004, 0, 0]])
    found = _interpolated(places, values, wanted, side, torch.tensor([1.0, -1.0]))
    np.testing.assert_allclose(found[:, 0], [1, -1])


def test_an_episode_starts_anew():
    model = AugmentedModel(ConstantVelocity(keep=0), BASE, (SOFTER,))
    np.testing.assert_array_equal(run(model), run(model))


def write(folder: Path, facts: dict) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "model.json").write_text(json.dumps({"schema": 1, **facts}))
    return folder


def augmented(folder: Path, **effects: dict[str, float]) -> Path:
    entries = [
        {"effect": name, "parameters": {k: {"value": v} for k, v in values.items()}} for name, values in effects.items()
    ]
    return write(folder, {"kind": "augmented", "engine": base_to_dict(BASE), "effects": entries})


def engine(folder: Path) -> Path:
    return write(folder, {"kind": "engine", "engine": base_to_dict(BASE)})


def learned(folder: Path) -> Path:
    folder.mkdir(parents=True)
    save_model(folder, PlopModel(PlopConfig()))
    return folder


def test_a_folder_of_each_kind_gives_its_model(tmp_path):
    assert isinstance(load_model(learned(tmp_path / "learned")), PlopModel)
    model = load_model(engine(tmp_path / "engine"))
    assert isinstance(model, FilledEngineModel) and model.effects == () and model.base == BASE
    augmented(tmp_path / "a", tilt={"gx_m_s2": 3.0})
    engine(tmp_path / "a" / "base")
    model = load_model(tmp_path / "a")
    assert isinstance(model, FilledEngineModel) and repr(model.effects) == repr((effect_type("tilt")(gx_m_s2=3.0),))
    assert engine_of(tmp_path / "a") == BASE and engine_of(tmp_path / "learned") is None


@pytest.mark.parametrize("inner", [engine, learned])
def test_effects_added_one_after_the_other_act_once_each(tmp_path, inner):
    augmented(tmp_path, tilt={"gx_m_s2": 3.0})
    augmented(tmp_path / "base", stiffness={"d_ln_e": 0.5})
    inner(tmp_path / "base" / "base")
    assert [e.name for e in effects_of(tmp_path)] == ["stiffness", "tilt"]  # innermost first
    assert innermost(tmp_path) == tmp_path / "base" / "base"
    model = load_model(tmp_path)
    assert [e.name for e in model.effects] == ["stiffness", "tilt"]
    assert isinstance(model, FilledEngineModel) if inner is engine else isinstance(model.base, PlopModel)


def test_an_unknown_kind_and_an_unknown_effect_are_refused(tmp_path):
    with pytest.raises(PlopError, match="unknown kind"):
        load_model(write(tmp_path / "a", {"kind": "oracle"}))
    augmented(tmp_path / "b", viscositty={"viscosity_pa_s": 1.0})
    engine(tmp_path / "b" / "base")
    with pytest.raises(PlopError) as caught:
        load_model(tmp_path / "b")
    assert caught.value.fix == "Did you mean viscosity?"


def test_a_step_needs_no_history():
    episode = coarse_episode(0)
    state = at_rest(gaussians(episode.points[0]))
    stepped = AugmentedModel(ConstantVelocity(keep=0), BASE, (TILT,)).step(state, actions(episode).step(0))
    assert stepped.has_history and torch.isfinite(stepped.gaussians.means).all()
