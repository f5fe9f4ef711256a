"""Stiffness, a base parameter: Young's modulus differs from the base's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plop.parameters import Parameter
from plop.physics.effects.effect import Effect
from plop.physics.engine.material import Material


class Stiffness(Effect):
    """Another Young's modulus at the same Poisson's ratio."""

    name = "stiffness"
    kind = "base"
    help = "the material is stiffer or softer"
    law = "E -> E exp(d_ln_e)"
    source = "Hooke's law; in the logarithm twice and half are equally far from 1"
    amplitudes = (
        Parameter(
            "d_ln_e", "-", -3.0, 3.0, step=0.05, typical=0.7, help="change of the modulus' logarithm", tried=(0.2, -0.2)
        ),
    )

    def material(self, material: Material) -> Material:
        """Scale the base's modulus."""
        return replace(material, youngs_modulus_pa=material.youngs_modulus_pa * float(np.exp(self["d_ln_e"])))
