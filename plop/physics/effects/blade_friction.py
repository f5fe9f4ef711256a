"""Blade friction: the friction at the tool's faces differs from the base's."""

from __future__ import annotations

from dataclasses import replace

from plop.parameters import Parameter
from plop.physics.effects.effect import Effect
from plop.physics.engine.material import Material


class BladeFriction(Effect):
    """Coulomb friction at the tool beyond the base's; the sum is not below 0."""

    name = "blade_friction"
    help = "the tool is rougher or more slippery"
    law = "|t| <= (mu + d_mu) p at the tool"
    source = "Coulomb 1785; Johnson, Contact Mechanics, 1985, ch. 7"
    acts_at_rest = False
    amplitudes = (
        Parameter(
            "d_mu", "-", -2.0, 2.0, step=0.1, typical=1.0, help="change of the coefficient", tried=(-0.5, -0.25, 0.5)
        ),
    )

    def material(self, material: Material) -> Material:
        """Add to the base's own friction."""
        return replace(material, tool_friction=max(0.0, material.tool_friction + self["d_mu"]))
