"""The object that the engine fills: in balance at the start, and the same step by step as in one run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from plop.comparison.engine_run import predict_points, start_particles
from plop.dynamics.interface import ToolStep, at_rest
from plop.errors import PlopError
from plop.geometry.meshes.convex import convex_surface
from plop.physics.adapters.base_io import base_from_dict, base_to_dict
from plop.physics.adapters.filled import EngineBase, filled_particles
from plop.physics.adapters.filled_model import FilledEngineModel
from plop.physics.effects.library import effect_type
from plop.physics.engine.fill import fill_surface
from plop.physics.engine.material import ElasticLaw, Material
from plop.physics.engine.solver import simulate
from plop.physics.scenes.scene import simulate_episode
from plop.tracking.episode import episode_from_sequence
from tests.support.coarse_episodes import (
    BASE,
    MATERIAL,
    SCENE,
    actions,
    coarse_episode,
    gaussians,
    paths,
    rollout,
    wrapped,
)

SOFT = EngineBase(replace(MATERIAL, youngs_modulus_pa=8e3), spacing_m=0.009)


def drift_m(base: EngineBase, effects=()) -> float:
    """Largest way of any followed point in 0.15 s without a tool."""
    corners = np.array([[x, y, z] for x in (-0.03, 0.03) for y in (-0.025, 0.025) for z in (0, 0.04)])
    points = corners * [0.9, 0.9, 0.9] + [0, 0, 0.002]
    particles = filled_particles(base, convex_surface(corners), points, 0.0, effects)
    np.testing.assert_allclose(particles.positions[-len(points) :], points, atol=1e-3)  # about where it was seen
    run = simulate(
        particles, base.material, None, np.array([0, 0.15]), replace(base.config, table_z_m=0.0), effects=effects
    )
    return float(np.linalg.norm(run.positions[-1] - run.positions[0], axis=1).max())


def test_a_settled_object_stays_and_an_unloaded_one_sags():
    assert drift_m(SOFT) < 3e-4
    assert drift_m(replace(SOFT, settled=False)) > 6e-4


def test_effects_have_acted_before_the_first_frame():
    tilt = (effect_type("tilt")(gx_m_s2=2.0),)
    assert drift_m(SOFT, tilt) < 4e-4


def test_a_material_that_flowed_under_its_own_weight_has_hardened_by_it():
    plastic = effect_type("plasticity")(softness_per_kpa=10.0, hardening=0.1)
    corners = np.array([[x, y, z] for x in (-0.03, 0.03) for y in (-0.025, 0.025) for z in (0, 0.04)])
    surface = convex_surface(corners)
    particles = filled_particles(SOFT, surface, corners, 0.0, (plastic,))
    assert particles.memory is not None and particles.memory["plasticity.flow"].max() > 0.01

    def sunk_m(start) -> float:
        config = replace(SOFT.config, table_z_m=0.0)
        run = simulate(start, SOFT.material, None, np.array([0, 0.3]), config, effects=(plastic,))
        return float(np.linalg.norm(run.positions[-1] - run.positions[0], axis=1).max())

    assert sunk_m(particles) < 5e-5 < 4e-4 < sunk_m(replace(particles, memory=None))


def test_what_relaxes_has_relaxed_before_the_first_frame():
    assert drift_m(SOFT, (effect_type("relaxation")(ratio=0.8, tau_s=0.2),)) < 3e-4


def test_what_slides_on_a_tilted_table_starts_where_it_was_seen():
    corners = np.array([[x, y, z] for x in (-0.03, 0.03) for y in (-0.025, 0.025) for z in (0, 0.04)])
    particles = filled_particles(SOFT, convex_surface(corners), corners, 0.0, (effect_type("tilt")(gx_m_s2=5.0),))
    upright = filled_particles(SOFT, convex_surface(corners), corners, 0.0)
    assert np.abs((particles.positions - upright.positions)[:, :2].mean(0)).max() < 2e-5


def test_filling_keeps_volume_and_tracers_weigh_nothing():
    corners = np.array([[x, y, z] for x in (-0.03, 0.03) for y in (-0.025, 0.025) for z in (0, 0.04)])
    loose = replace(SOFT, settled=False)
    particles = filled_particles(loose, convex_surface(corners), corners, 0.0)
    assert particles.volumes.sum() == pytest.approx(0.06 * 0.05 * 0.04, rel=0.03)
    assert (particles.volumes[-8:] == 0).all()


def test_a_settled_object_starts_where_it_was_seen_and_stays_there():
    corners = np.array([[x, y, z] for x in (-0.03, 0.03) for y in (-0.025, 0.025) for z in (0, 0.04)])
    wobbly = replace(SOFT, material=replace(SOFT.material, youngs_modulus_pa=2500.0))
    particles = filled_particles(wobbly, convex_surface(corners), corners, 0.0)
    filled = fill_surface(*convex_surface(corners), SOFT.spacing_m)[0]
    assert np.abs(particles.positions - np.concatenate([filled, corners])).max() < 1e-4
    run = simulate(particles, wobbly.material, None, np.array([0, 0.5]), replace(SOFT.config, table_z_m=0.0))
    assert np.abs(run.positions[-1] - run.positions[0]).max() < 5e-5
    sagging = simulate(
        replace(particles, F=None), wobbly.material, None, np.array([0, 0.5]), replace(SOFT.config, table_z_m=0.0)
    )
    assert np.abs(sagging.positions[-1] - sagging.positions[0]).max() > 1e-3


@pytest.mark.parametrize("effect", [None, "tilt"])
def test_steps_of_the_model_are_the_run_of_the_diagnosis(effect):
    episode = wrapped(coarse_episode(0))
    effects = () if effect is None else (effect_type(effect)(gx_m_s2=1.0),)
    long = predict_points(BASE, episode, start_particles(BASE, episode, effects), effects)
    long = episode.points[0] + long - long[0]
    steps = paths(rollout(FilledEngineModel(BASE, effects), episode))
    moved = np.linalg.norm(long[-1] - long[0], axis=1).max()
    assert moved > 2e-3
    assert np.abs(steps - long).max() < 2e-5  # float32 poses and means


def test_a_new_episode_forgets_the_last():
    episode = wrapped(coarse_episode(0))
    model = FilledEngineModel(BASE)
    one, two = (paths(rollout(model, episode, 4)) for _ in range(2))
    np.testing.assert_array_equal(one, two)


def test_what_a_filter_moves_takes_the_material_along():
    episode = wrapped(coarse_episode(0))
    model = FilledEngineModel(BASE)
    state = rollout(model, episode, 3)[-1]
    filled = state.inner.particles.positions.mean(0)
    shift = torch.tensor([0.002, 0.0, 0.0])
    moved = replace(state, gaussians=state.gaussians.with_(means=state.gaussians.means + shift))
    particles = model._particles(moved, None)
    np.testing.assert_allclose(particles.positions.mean(0) - filled, shift.numpy(), atol=2e-5)


def test_split_and_merged_gaussians_keep_the_material():
    episode = wrapped(coarse_episode(0))
    model = FilledEngineModel(BASE)
    state = rollout(model, episode, 3)[-1]
    rows = torch.tensor([0, 0, 1, 5, 9])
    fewer = state.select(rows)
    particles = model._particles(fewer, None)
    filling = len(state.inner.particles) - len(state.gaussians)
    assert len(particles) == filling + len(rows)
    known = state.inner.particles.positions[filling:]
    np.testing.assert_allclose(particles.positions[filling:], known[rows.numpy()], atol=1e-6)
    assert particles.F is not None and len(particles.F) == len(particles)


def blade_normal(action: ToolStep) -> np.ndarray:
    return action.world_from_tool[:3, :3].double().numpy() @ action.tool.axes[:, 0].double().numpy()


def test_a_cut_narrows_gaussians_and_moves_none_elsewhere():
    scene = replace(SCENE, motions=("cut",))
    episode = wrapped(episode_from_sequence(simulate_episode(scene, 0, ()), noise_m=0.0, seed=0, points=400))
    wide = gaussians(episode.points[0])
    start, steps, ends = at_rest(wide.with_(scales=6 * wide.scales)), actions(episode), []
    for model in (FilledEngineModel(BASE), FilledEngineModel(BASE, cut_faces=True)):
        state = start
        for frame in range(len(steps) - 1):
            state = model.step(state, steps.step(frame))
        ends.append(state)
    plain, faced = ends
    assert (plain.side != 0).sum() > 100
    ahead = np.sign((episode.points[0] - steps.step(0).world_from_tool[:3, 3].numpy()) @ blade_normal(steps.step(0)))
    assert (plain.side.numpy() == ahead)[plain.side.numpy() != 0].mean() > 0.97
    assert torch.equal(faced.gaussians.means, plain.gaussians.means)
    narrowed = faced.gaussians.scales.prod(-1) < 0.95 * plain.gaussians.scales.prod(-1)
    assert 5 < narrowed.sum() < 200 and (plain.side[narrowed] != 0).all()


def test_settings_survive_a_round_trip_through_json():
    import json

    base = EngineBase(Material(1.1e4, 0.37, law=ElasticLaw.FIXED_COROTATED), 0.0071, False, "pyramid")
    assert base_from_dict(json.loads(json.dumps(base_to_dict(base)))) == base


@pytest.mark.parametrize(
    "spoil",
    [
        lambda t: t.pop("material"),
        lambda t: t["material"].update(law="wood"),
        lambda t: t.update(colour=1),
        lambda t: t["material"].update(hardness=1),
        lambda t: t.update(material=None),
    ],
)
def test_damaged_settings_are_refused(spoil):
    table = base_to_dict(BASE)
    spoil(table)
    with pytest.raises(PlopError, match="engine's settings"):
        base_from_dict(table)


def test_gaussians_inside_decide_nothing_about_the_surface():
    points = coarse_episode(0).points[0]
    floating = np.concatenate([points, [[0.2, 0.2, 0.2]]])
    state = gaussians(floating)
    faint = state.with_(opacities=torch.cat([state.opacities[:-1], torch.tensor([0.05])]))
    particles = FilledEngineModel(replace(BASE, settled=False))._first(at_rest(faint), floating, 0.0)
    assert particles.positions[: -len(floating)].max() < 0.06


def test_a_measured_surface_is_filled_wherever_the_gaussians_lie():
    points = coarse_episode(0).points[0]
    inside = points.mean(0) + 0.9 * (points - points.mean(0))
    model = FilledEngineModel(replace(BASE, settled=False))
    corners = np.array([[x, y, z] for x in (-0.03, 0.03) for y in (-0.025, 0.025) for z in (0, 0.04)])
    particles = model._first(at_rest(gaussians(inside), convex_surface(corners)), inside, 0.0)
    np.testing.assert_allclose(np.ptp(particles.positions[: -len(inside)], axis=0), [0.06, 0.05, 0.04], atol=1e-6)
