"""Lateral gravity: the table is not level, or the whole scene accelerates sideways."""

from __future__ import annotations

from dataclasses import replace

from plop.parameters import Parameter
from plop.physics.effects.effect import Effect
from plop.physics.engine.config import EngineConfig


class Tilt(Effect):
    """A uniform sideways acceleration; a table tilted by a small angle a gives 9.81 sin(a)."""

    name = "tilt"
    help = "gravity pulls sideways: the table is not level"
    law = "g += (gx, gy, 0)"
    source = "Newton's second law in a tilted frame"
    amplitudes = (
        Parameter("gx_m_s2", "m/s^2", -5.0, 5.0, step=0.1, typical=1.0, help="sideways acceleration along x"),
        Parameter("gy_m_s2", "m/s^2", -5.0, 5.0, step=0.1, typical=1.0, help="sideways acceleration along y"),
    )

    def config(self, config: EngineConfig) -> EngineConfig:
        """Add to the engine's gravity."""
        x, y, z = config.gravity_m_s2
        return replace(config, gravity_m_s2=(x + self["gx_m_s2"], y + self["gy_m_s2"], z))
