"""Inertia, a decoy: the object resists acceleration more than its weight implies."""

from __future__ import annotations

from dataclasses import replace

from plop.parameters import Parameter
from plop.physics.effects.effect import Effect
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material


class Inertia(Effect):
    """Added mass: inertia grows and weight does not; it is invisible in slow motion."""

    name = "inertia"
    kind = "decoy"
    help = "added mass: acceleration is resisted, weight is not changed"
    law = "(1 + ratio) rho v' = div(stress) + rho g"
    source = "added mass: Lamb, Hydrodynamics, 1932"
    amplitudes = (Parameter("ratio", "-", 0.0, 10.0, step=0.2, typical=1.0, help="added mass over the object's own"),)

    def material(self, material: Material) -> Material:
        """Make the mass larger."""
        return replace(material, density_kg_m3=material.density_kg_m3 * (1 + self["ratio"]))

    def config(self, config: EngineConfig) -> EngineConfig:
        """Keep the weight."""
        x, y, z = (g / (1 + self["ratio"]) for g in config.gravity_m_s2)
        return replace(config, gravity_m_s2=(x, y, z))
