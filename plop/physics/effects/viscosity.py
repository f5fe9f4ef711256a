"""Viscosity: the material resists fast deformation."""

from __future__ import annotations

from dataclasses import replace

from plop.parameters import Parameter
from plop.physics.effects.effect import Effect
from plop.physics.engine.material import Material


class Viscosity(Effect):
    """Kelvin-Voigt viscosity beside the elastic stress; the engine's own term with another number."""

    name = "viscosity"
    help = "the material resists fast deformation"
    law = "tau += 2 eta dev(D), D the symmetric velocity gradient"
    source = "Kelvin-Voigt solid; Larson, The Structure and Rheology of Complex Fluids, 1999"
    acts_at_rest = False
    amplitudes = (
        Parameter("viscosity_pa_s", "Pa s", 0.0, 1e3, step=2.0, typical=100.0, help="viscosity beyond the base's"),
    )

    def material(self, material: Material) -> Material:
        """Add to the base's own viscosity."""
        return replace(material, viscosity_pa_s=material.viscosity_pa_s + self["viscosity_pa_s"])
