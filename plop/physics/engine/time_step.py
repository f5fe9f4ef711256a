"""How long a time step may be."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from plop.errors import PlopError
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material
from plop.physics.engine.tool_motion import ToolMotion

LEAST_STEP_S = 2e-6
"""Shortest time step that a run begins with [s]: half a million steps for a second of motion."""
STEP_RATIO = 1.1
"""Time steps of runs that are compared differ by powers of this, so that many runs share few runs without a law."""
_ROUNDING = 1e-6
_PARTICLE_STEP_S = 2.2e-7
"""Time that a step takes for one particle [s], see docs/results/parts.md; it estimates the duration in messages."""
_VISCOUS = 0.25
"""Explicit viscous step, in dx^2 density / viscosity [-]: half the largest stable one. Shorter ones are no more exact,
since every transfer to the grid and back dissipates."""


def stable_step_s(material: Material, config: EngineConfig, speed_m_s: float = 0.0) -> float:
    """Give the longest time step that waves, viscosity and motion allow [s].

    A pressure wave and the fastest body cross `courant` cells a step; an explicit viscous step obeys
    dt <= 0.25 dx^2 density / viscosity.
    """
    if config.dt_s is not None:
        return config.dt_s
    step = config.courant * config.dx_m / (material.wave_speed_m_s + speed_m_s)
    if material.viscosity_pa_s > 0:
        step = min(step, _VISCOUS * config.dx_m**2 * material.density_kg_m3 / material.viscosity_pa_s)
    return step


def run_step_s(
    material: Material, config: EngineConfig, speed_m_s: float, limits: Mapping[str, float], particles: int
) -> float:
    """Choose the time step that a run begins with [s].

    Args:
        material: With what the effects change of it.
        config: The same.
        speed_m_s: See `highest_speed_m_s`.
        limits: Effect, in words -> longest time step at which it is stable [s].
        particles: Their number, to tell the time.

    Raises:
        PlopError: It would be shorter than LEAST_STEP_S, so that a run takes hours; names what makes it so short, and
            from where on it would not.
    """
    own = stable_step_s(material, config, speed_m_s)
    step = min([own, *limits.values()])
    if step >= LEAST_STEP_S or config.dt_s is not None:
        return step
    where, fix = _shortest(material, config, speed_m_s)
    if step < own:
        where = f"effect {min(limits, key=lambda effect: limits[effect])}"
        fix = "Choose a smaller amplitude; in an effect of your own, look at `slowest_step_s`."
    minutes = max(1.0, particles * _PARTICLE_STEP_S / step / 60)
    raise PlopError(
        "The run would take far too many time steps.",
        where=where,
        expected=f"time steps of {LEAST_STEP_S:g} s or more",
        found=f"{step:.2g} s: {1e-6 / step:.1f} million steps, about {minutes:.0f} min, for each second of motion",
        fix=fix,
    )


def comparable_step_s(stable_s: float, longest_s: float, ratio: float = 1.0) -> float:
    """Give the longest stable time step, up to `longest_s`; where that is not stable, it over a power of `ratio` [s].

    Any stable one with a ratio of 1.
    """
    if ratio <= 1 or not np.isfinite(longest_s):
        return min(stable_s, longest_s)
    powers = np.ceil(np.log(longest_s / stable_s) / np.log(ratio) - _ROUNDING)
    return float(longest_s / ratio ** max(powers, 0.0))


def _shortest(material: Material, config: EngineConfig, speed_m_s: float) -> tuple[str, str]:
    """Name what makes the step of the material so short, and the value up to which it would be long enough."""
    viscosity = _VISCOUS * config.dx_m**2 * material.density_kg_m3 / LEAST_STEP_S
    if material.viscosity_pa_s > viscosity:
        return (
            f"viscosity_pa_s = {material.viscosity_pa_s:g}",
            f"On a grid of {1000 * config.dx_m:.3g} mm the engine takes up to {viscosity:.2g} Pa s.",
        )
    fastest = config.courant * config.dx_m / LEAST_STEP_S
    if speed_m_s > material.wave_speed_m_s:
        return f"tool, {speed_m_s:.3g} m/s", "Check that its poses are in metres and its times in seconds."
    modulus = material.youngs_modulus_pa * (fastest / material.wave_speed_m_s) ** 2
    return (
        f"youngs_modulus_pa = {material.youngs_modulus_pa:g}",
        f"On a grid of {1000 * config.dx_m:.3g} mm the engine takes up to {modulus:.2g} Pa, and more on a coarser "
        "one; check that stiffness is in Pa and density in kg/m^3.",
    )


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
