"""The engine as a dynamics model: the same motion as one long run, covariances that follow."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from plop.physics.model import EngineModel

from plop.dynamics.interface import ParticleState, ToolStep, at_rest
from plop.gaussians.state import Gaussians
from plop.geometry.rigid import quat_from_rotation_vector, quat_to_matrix
from plop.geometry.tool import ToolGeometry
from plop.physics.config import EngineConfig
from plop.physics.fill import particle_volumes
from plop.physics.material import Material
from plop.physics.particles import Particles
from plop.physics.solver import simulate
from plop.physics.tool_motion import ToolMotion
from plop.physics.tools import blade_mesh

SOFT = Material(youngs_modulus_pa=1.5e4, tool_friction=0, damping_per_s=5)
CONFIG = EngineConfig(dx_m=0.01)
HEIGHTS = np.array([0.034, 0.022, 0.008, -0.004])
DT = 0.1


def gaussians(positions: np.ndarray) -> Gaussians:
    count = len(positions)
    return Gaussians(
        means=torch.tensor(positions, dtype=torch.float32),
        quats=torch.tensor([[1.0, 0, 0, 0]]).repeat(count, 1),
        scales=torch.tensor([[0.001, 0.002, 0.003]]).repeat(count, 1),
        opacities=torch.ones(count),
        sh=torch.zeros(count, 1, 3),
        ids=torch.arange(count),
    )


def actions() -> list[ToolStep]:
    vertices, faces = blade_mesh()
    poses = torch.eye(4).repeat(len(HEIGHTS), 1, 1)
    poses[:, 2, 3] = torch.tensor(HEIGHTS, dtype=torch.float32)
    tool = ToolGeometry.from_mesh(vertices, faces)
    return [ToolStep(tool, a, b, DT, 0.0) for a, b in zip(poses[:-1], poses[1:], strict=True)]


def rollout(state: ParticleState, model: EngineModel) -> ParticleState:
    for action in actions():
        state = model.step(state, action)
    return state


def test_steps_follow_one_long_run(block):
    body = block((0.06, 0.03, 0.03), 0.005)
    end = rollout(at_rest(gaussians(body.positions)), EngineModel(SOFT, CONFIG))
    poses = np.tile(np.eye(4), (len(HEIGHTS), 1, 1))
    poses[:, 2, 3] = HEIGHTS
    volumes, _ = particle_volumes(body.positions)
    times = DT * np.arange(len(HEIGHTS))
    whole = simulate(Particles(body.positions, volumes), SOFT, ToolMotion(*blade_mesh(), times, poses), times, CONFIG)
    np.testing.assert_allclose(end.gaussians.means, whole.positions[-1], atol=2e-4)
    normal = actions()[0].tool.axes[:, 0].numpy()
    ahead = np.sign(body.positions @ normal)
    known = end.side.numpy() != 0
    assert known.mean() > 0.9
    assert (end.side.numpy() == ahead)[known].all()
    assert (known == (whole.sides[-1] != 0)).mean() > 0.99


def test_covariance_follows_the_deformation(block):
    body = block((0.03, 0.03, 0.03), 0.005, bottom_m=0.2)
    model = EngineModel(Material(), EngineConfig(dx_m=0.01, gravity_m_s2=(0, 0, 0)))
    state = at_rest(gaussians(body.positions))
    spin = torch.tensor([[0.0, 0, 1.5]])
    turn = DT * torch.cross(spin, state.gaussians.means - state.gaussians.means.mean(0), dim=1)
    after = model.step(ParticleState(state.gaussians, turn, turn, state.side, has_history=True), actions()[0])
    angle = after.last_rotation.median(0).values
    # a cloud whose local velocities are not known yet loses a part of its spin
    assert angle[2] == pytest.approx(1.5 * DT, rel=0.25)
    rotation = quat_to_matrix(quat_from_rotation_vector(angle))
    expected = rotation @ state.gaussians.covariances[0] @ rotation.T
    np.testing.assert_allclose(after.gaussians.covariances.median(0).values, expected, atol=3e-7)


def test_a_new_rollout_forgets_the_last_one(block):
    start = at_rest(gaussians(block((0.06, 0.03, 0.03), 0.005).positions))
    model = EngineModel(SOFT, CONFIG)
    first = rollout(start, model)
    again = rollout(start, model)
    assert torch.equal(first.gaussians.means, again.gaussians.means)


def test_particle_volumes_add_up(block):
    body = block((0.06, 0.04, 0.03), 0.005)
    jitter = np.random.default_rng(0).normal(0, 5e-4, body.positions.shape)
    for positions in (body.positions, body.positions + jitter):
        volumes, spacing = particle_volumes(positions)
        assert volumes.sum() == pytest.approx(0.06 * 0.04 * 0.03, rel=0.25)
        assert spacing == pytest.approx(0.005, rel=0.25)
