"""Coarse simulated episodes, tracked ideally, and the Gaussians and actions that go with them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import torch

from plop.dynamics.episodes import Actions
from plop.dynamics.interface import DynamicsModel, ParticleState, at_rest
from plop.gaussians.state import Gaussians
from plop.geometry.meshes.convex import convex_surface
from plop.geometry.meshes.tool import ToolGeometry
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.library import effect_type
from plop.physics.engine.material import Material
from plop.physics.scenes.motions import MotionRanges
from plop.physics.scenes.scene import Scene, simulate_episode
from plop.physics.scenes.shapes import Shape
from plop.tracking.episode import Episode, episode_from_sequence

MATERIAL = Material(youngs_modulus_pa=1.5e4, poisson=0.4, damping_per_s=5, table_friction=0.4, tool_friction=0.3)
SCENE = Scene(
    name="block",
    episodes=8,
    motions=("hold", "push"),
    frame_rate_hz=20,
    spacing_m=0.008,
    dx_m=0.016,
    shape=Shape("block", (0.060, 0.050, 0.040)),
    material=MATERIAL,
    motion=MotionRanges(press_speed_m_s=(0.08, 0.12), hold_s=(0.1, 0.1), aside_speed_m_s=(0.1, 0.1)),
)
BASE = EngineBase(MATERIAL, spacing_m=0.010)


@cache
def coarse_episode(k: int, effect: str = "", value: float = 0.0, noise_m: float = 2e-4) -> Episode:
    """Simulate episode k, with one effect at an amplitude if one is named, and follow 150 points of its surface."""
    effects = ()
    if effect:
        kind = effect_type(effect)
        effects = (kind(**{kind.amplitudes[0].name: value}),)
    sequence = simulate_episode(SCENE, k, effects)
    return episode_from_sequence(sequence, noise_m=noise_m, seed=k, points=150)


def wrapped(episode: Episode) -> Episode:
    """Let the surface be that around the followed points, as a model of Gaussians sees it."""
    vertices, faces = convex_surface(episode.points[0].astype(np.float32).astype(float), episode.table_z_m)
    return replace(episode, vertices=vertices, faces=faces)


def gaussians(points: np.ndarray) -> Gaussians:
    """Put small opaque Gaussians at points."""
    count = len(points)
    return Gaussians(
        torch.tensor(points, dtype=torch.float32),
        torch.tensor([[1.0, 0, 0, 0]]).repeat(count, 1),
        torch.full((count, 3), 0.002),
        torch.full((count,), 0.9),
        torch.zeros(count, 1, 3),
        torch.arange(count),
    )


def actions(episode: Episode) -> Actions:
    """Give the tool's steps of an episode."""
    tool = ToolGeometry.from_mesh(episode.tool.vertices, episode.tool.faces)
    poses = torch.as_tensor(episode.tool.world_from_tool, dtype=torch.float32)
    return Actions(tool, poses, episode.times, episode.table_z_m)


def rollout(model: DynamicsModel, episode: Episode, frames: int | None = None) -> list[ParticleState]:
    """Step a model through an episode from Gaussians at the followed points; the first state is the start."""
    steps, states = actions(episode), [at_rest(gaussians(episode.points[0]))]
    for frame in range((frames or len(steps)) - 1):
        states.append(model.step(states[-1], steps.step(frame)))
    return states


def paths(states: list[ParticleState]) -> np.ndarray:
    """Places of the Gaussians over time, [T, N, 3] [m]."""
    return np.stack([state.gaussians.means.double().numpy() for state in states])
