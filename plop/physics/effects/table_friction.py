"""Table friction: the object slides more or less easily than in the base."""

from __future__ import annotations

from dataclasses import replace

from plop.parameters import Parameter
from plop.physics.effects.effect import Effect
from plop.physics.engine.material import Material


class TableFriction(Effect):
    """Coulomb friction at the table beyond the base's; the sum is not below 0."""

    name = "table_friction"
    help = "the table is rougher or more slippery"
    law = "|t| <= (mu + d_mu) p at the table"
    source = "Coulomb 1785; Johnson, Contact Mechanics, 1985, ch. 7"
    amplitudes = (
        Parameter(
            "d_mu",
            "-",
            -2.0,
            2.0,
            step=0.05,
            typical=0.5,
            help="change of the coefficient",
            tried=(-0.4, -0.3, -0.2, -0.1, 0.25),
        ),
    )

    def material(self, material: Material) -> Material:
        """Add to the base's own friction."""
        return replace(material, table_friction=max(0.0, material.table_friction + self["d_mu"]))
