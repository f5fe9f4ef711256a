"""Damping, a base parameter: motion decays faster or slower than in the base."""

from __future__ import annotations

from dataclasses import replace

from plop.parameters import Parameter
from plop.physics.effects.effect import Effect
from plop.physics.engine.material import Material


class Damping(Effect):
    """Velocity damping beyond the base's; the sum is not below 0."""

    name = "damping"
    kind = "base"
    help = "all motion decays faster or slower"
    law = "v' += -d_c v"
    source = "mass-proportional Rayleigh damping; Bathe, Finite Element Procedures, 1996, ch. 9"
    acts_at_rest = False
    amplitudes = (Parameter("d_per_s", "1/s", -100.0, 1e3, step=5.0, typical=50.0, help="change of the decay rate"),)

    def material(self, material: Material) -> Material:
        """Add to the base's own damping."""
        return replace(material, damping_per_s=max(0.0, material.damping_per_s + self["d_per_s"]))
