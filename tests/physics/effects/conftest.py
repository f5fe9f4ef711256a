"""What the tests of effects share: a plate, a swinging bar, and an engine whose particles are strained as told."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from plop.physics.engine.config import EngineConfig
from plop.physics.engine.engine import Engine
from plop.physics.engine.material import Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.solver import simulate
from plop.physics.engine.tool_motion import ToolMotion
from tests.support.box import BOX_FACES


@pytest.fixture(scope="session")
def plate() -> Callable[..., ToolMotion]:
    """A plate of 60 x 60 x 30 mm whose lower side follows points (x, z) at the given times."""
    low, high = np.array([-0.03, -0.03, 0.0]), np.array([0.03, 0.03, 0.03])
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (high - low) + low
    faces = BOX_FACES

    def lead(*points: tuple[float, float], times: list[float]) -> ToolMotion:
        poses = np.tile(np.eye(4), (len(points), 1, 1))
        poses[:, [0, 2], 3] = points
        return ToolMotion(corners, faces, np.array(times), poses)

    return lead


@pytest.fixture(scope="session")
def strained() -> Callable[..., Engine]:
    """An engine that rests with the given deformation gradients [N, 3, 3] and effects; nothing acts on it."""

    def build(f: np.ndarray, effects: list, material: Material | None = None) -> Engine:
        count = len(f)
        places = np.stack([np.arange(count) * 0.005, np.zeros(count), np.zeros(count)], 1)
        engine = Engine(
            Particles(places, np.full(count, 1e-7), F=f),
            material or Material(),
            None,
            EngineConfig(gravity_m_s2=(0, 0, 0), table_z_m=None),
            effects,
        )
        engine.extra = np.zeros((count, 6), np.float32)
        return engine

    return build


@pytest.fixture(scope="session")
def half_period_s(block) -> Callable[..., float]:
    """Half the period of a free bar's first longitudinal mode along x [s], with the given effects."""
    body = block((0.12, 0.02, 0.02), 0.01)
    mode = np.sin(np.pi * body.positions[:, 0] / 0.12)
    moving = Particles(body.positions, body.volumes, 0.02 * mode[:, None] * [1, 0, 0])
    times = np.linspace(0, 0.075, 61)

    def measure(*effects) -> float:
        run = simulate(
            moving,
            Material(youngs_modulus_pa=2e4, poisson=0.0),
            None,
            times,
            EngineConfig(dx_m=0.02, gravity_m_s2=(0, 0, 0), table_z_m=None, courant=0.3),
            effects=effects,
        )
        stretch = ((run.positions - run.positions[0])[:, :, 0] * mode).mean(1)
        falls = np.nonzero((stretch[1:-1] > 0) & (stretch[2:] <= 0))[0][0] + 1
        return times[falls] + (times[1] - times[0]) * stretch[falls] / (stretch[falls] - stretch[falls + 1])

    return measure
