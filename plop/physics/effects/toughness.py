"""Toughness: new surface costs energy, so the material resists the cutting edge."""

from __future__ import annotations

from dataclasses import replace

from plop.parameters import Parameter
from plop.physics.effects.effect import Effect
from plop.physics.engine.material import Material


class Toughness(Effect):
    """Fracture energy beyond the base's, in `plop.physics.engine.kernels.toughness`; the sum is not below 0."""

    name = "toughness"
    help = "cutting costs energy: the edge drags the material along"
    law = "force on the edge += d_G x width of the cut"
    source = "Griffith 1921; Atkins, The Science and Engineering of Cutting, 2009, ch. 2"
    acts_at_rest = False
    needs_blade = True
    amplitudes = (
        Parameter(
            "d_j_m2", "J/m^2", -1e3, 1e3, step=5.0, typical=50.0, help="change of fracture energy", tried=(-50.0, 200.0)
        ),
    )

    def material(self, material: Material) -> Material:
        """Add to the base's own toughness."""
        return replace(material, toughness_j_m2=max(0.0, material.toughness_j_m2 + self["d_j_m2"]))
