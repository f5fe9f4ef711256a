"""Density, a base parameter: the object is heavier or lighter than in the base."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plop.parameters import Parameter
from plop.physics.effects.effect import Effect
from plop.physics.engine.material import Material


class Density(Effect):
    """Another density: weight and inertia change together."""

    name = "density"
    kind = "base"
    help = "the object is heavier or lighter"
    law = "rho -> rho exp(d_ln_rho)"
    source = "Newton's second law"
    amplitudes = (
        Parameter(
            "d_ln_rho",
            "-",
            -3.0,
            3.0,
            step=0.05,
            typical=0.7,
            help="change of the density's logarithm",
            tried=(0.2, -0.2),
        ),
    )

    def material(self, material: Material) -> Material:
        """Scale the base's density."""
        return replace(material, density_kg_m3=material.density_kg_m3 * float(np.exp(self["d_ln_rho"])))
