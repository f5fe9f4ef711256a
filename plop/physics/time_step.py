"""How long a time step may be."""

from __future__ import annotations

import numpy as np

from plop.physics.config import EngineConfig
from plop.physics.material import Material
from plop.physics.tool_motion import ToolMotion


def stable_step_s(material: Material, config: EngineConfig, speed_m_s: float = 0.0) -> float:
    """Give the longest time step that waves, viscosity and motion allow [s].

    A pressure wave and the fastest body cross `courant` cells a step; an explicit viscous step obeys
    dt <= 0.1 dx^2 density / viscosity.
    """
    if config.dt_s is not None:
        return config.dt_s
    step = config.courant * config.dx_m / (material.wave_speed_m_s + speed_m_s)
    if material.viscosity_pa_s > 0:
        step = min(step, 0.1 * config.dx_m**2 * material.density_kg_m3 / material.viscosity_pa_s)
    return step


def wave_step_s(extra_pa: float, material: Material, config: EngineConfig) -> float:
    """Give the time step for a law that adds `extra_pa` to the modulus of pressure waves [s]."""
    stiffness_pa = material.lame_pa + 2 * material.shear_pa + extra_pa
    return float(config.courant * config.dx_m / np.sqrt(stiffness_pa / material.density_kg_m3))


def highest_speed_m_s(velocities: np.ndarray, tool: ToolMotion | None) -> float:
    """Give the highest speed of particles [N, 3] [m/s] and tool [m/s]."""
    speed = float(np.linalg.norm(velocities, axis=1).max())
    if tool is not None and len(tool.times) > 1:
        path = np.linalg.norm(np.diff(tool.world_from_tool[:, :3, 3], axis=0), axis=1)
        speed = max(speed, float((path / np.diff(tool.times)).max()))
    return speed
