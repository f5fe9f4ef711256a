"""A step depends on its arguments alone: episodes may be followed in turn, and a state stepped twice."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from plop.dynamics.baselines import ConstantVelocity
from plop.dynamics.i2n.model import PlopConfig, PlopModel
from plop.dynamics.initial_scene import InitialScene
from plop.dynamics.interface import DynamicsModel, ParticleState
from plop.dynamics.peers.model import PeerConfig, PeerModel
from plop.dynamics.peers.settings import PeerName, PeerSettings
from plop.dynamics.rollout import rollout
from plop.models import augment
from plop.physics.adapters.filled_model import EngineState, FilledEngineModel
from plop.physics.effects.library import effect_type
from plop.tracking.episode import Episode
from tests.support.coarse_episodes import BASE, actions, coarse_episode, gaussians

FRAMES = 5
TILT, STIFFER = effect_type("tilt")(gx_m_s2=3.0), effect_type("stiffness")(d_ln_e=0.5)


def learned() -> PlopModel:
    torch.manual_seed(0)
    return PlopModel(PlopConfig())


def peer(name: PeerName) -> PeerModel:
    torch.manual_seed(0)
    return PeerModel(PeerConfig(name, PeerSettings().of(name)))


MODELS: dict[str, Callable[[], DynamicsModel]] = {
    "persistence": lambda: ConstantVelocity(keep=0),
    "constant velocity": ConstantVelocity,
    "learned": learned,
    "gs-dynamics": lambda: peer("gs-dynamics"),
    "dpi-net": lambda: peer("dpi-net"),
    "transformer": lambda: peer("transformer"),
    "engine": lambda: FilledEngineModel(BASE, cut_faces=True),
    "engine with an effect that remembers": lambda: augment(
        FilledEngineModel(BASE), effect_type("plasticity")(softness_per_kpa=2.0)
    ),
    "augmented": lambda: augment(ConstantVelocity(), STIFFER, engine=BASE),
    "augmented twice": lambda: augment(augment(learned(), TILT, engine=BASE), STIFFER),
}

AT_REST = ("persistence", "constant velocity")
"""They leave an object that has not moved where it is."""


def scene_of(episode: Episode) -> InitialScene:
    return InitialScene(gaussians(episode.points[0]), actions(episode).tool, episode.table_z_m)


def assert_same(one: ParticleState, other: ParticleState) -> None:
    for part in ("means", "quats", "scales", "opacities", "ids"):
        assert torch.equal(getattr(one.gaussians, part), getattr(other.gaussians, part)), part
    assert torch.equal(one.side, other.side)


@pytest.mark.parametrize("name", MODELS)
@torch.no_grad()
def test_two_episodes_in_turn_are_each_alone(name):
    episodes = [coarse_episode(0), coarse_episode(1)]
    steps = [actions(episode).steps()[: FRAMES - 1] for episode in episodes]
    alone = [rollout(MODELS[name](), scene_of(e), s, seed=3) for e, s in zip(episodes, steps, strict=True)]
    model = MODELS[name]()
    states = [model.init(scene_of(episode)) for episode in episodes]
    draws = [torch.Generator().manual_seed(3) for _ in episodes]
    for frame in range(FRAMES - 1):
        states = [
            model.step(state, each[frame], generator=draw)
            for state, each, draw in zip(states, steps, draws, strict=True)
        ]
        for state, expected in zip(states, alone, strict=True):
            assert_same(state, expected[frame + 1])
    assert name in AT_REST or not torch.equal(alone[0][-1].gaussians.means, alone[0][0].gaussians.means)


@pytest.mark.parametrize("name", MODELS)
@torch.no_grad()
def test_a_state_stepped_twice_gives_the_same_and_stays_as_it_was(name):
    episode, model = coarse_episode(0), MODELS[name]()
    steps = actions(episode).steps()
    state = model.init(scene_of(episode))
    for frame in range(2):
        state = model.step(state, steps[frame], generator=torch.Generator().manual_seed(0))
    before = state.gaussians.means.clone()
    first = model.step(state, steps[2], generator=torch.Generator().manual_seed(0))
    other = model.step(state, steps[0], generator=torch.Generator().manual_seed(0))  # another branch of a plan
    again = model.step(state, steps[2], generator=torch.Generator().manual_seed(0))
    assert_same(again, first)
    assert torch.equal(state.gaussians.means, before)
    assert name in AT_REST or not torch.equal(other.gaussians.means, first.gaussians.means)


def test_a_model_holds_nothing_of_an_episode():
    for name, make in MODELS.items():
        model = make()
        before = {key: id(value) for key, value in vars(model).items()}
        model.step(
            model.init(scene_of(coarse_episode(0))),
            actions(coarse_episode(0)).step(0),
            generator=torch.Generator().manual_seed(0),
        )
        assert {key: id(value) for key, value in vars(model).items()} == before, name


def test_a_filter_that_moves_nothing_changes_nothing_and_the_smallest_move_counts():
    episode, model = coarse_episode(0), FilledEngineModel(BASE)
    steps = actions(episode).steps()
    state = model.step(model.init(scene_of(episode)), steps[0])
    assert isinstance(state.inner, EngineState)
    kept = ParticleState(
        state.gaussians.with_(means=state.gaussians.means.clone()),
        state.last_translation,
        state.last_rotation,
        state.side,
        True,
        inner=state.inner,
    )
    assert_same(model.step(kept, steps[1]), model.step(state, steps[1]))
    shift = torch.tensor([5e-7, 0.0, 0.0])
    moved = state.gaussians.with_(means=state.gaussians.means + shift)
    particles = model._particles(
        ParticleState(moved, state.last_translation, state.last_rotation, state.side, True, inner=state.inner), steps[1]
    )
    way = particles.positions - state.inner.particles.positions
    np.testing.assert_allclose(way, np.broadcast_to(shift.numpy(), way.shape), atol=5e-8)


def test_a_state_of_another_model_starts_the_engine_anew():
    episode, engine = coarse_episode(0), FilledEngineModel(BASE)
    steps = actions(episode).steps()
    told = ConstantVelocity(keep=0).step(engine.init(scene_of(episode)), steps[0])
    stepped = engine.step(told, steps[1])
    assert isinstance(stepped.inner, EngineState)
    other = augment(ConstantVelocity(keep=0), TILT, engine=BASE).step(stepped, steps[2])
    assert torch.isfinite(other.gaussians.means).all()
