"""Uneven stiffness: one side, the bottom or the skin is stiffer than the rest (heat, drying, an inclusion)."""

from __future__ import annotations

# Numba infers the types of kernels; their docstrings describe the arguments.
# mypy: disallow-untyped-defs=False
from collections.abc import Callable
from typing import ClassVar

import numpy as np
from scipy.ndimage import binary_closing, distance_transform_edt, map_coordinates

from plop.parameters import Parameter
from plop.physics.effects.body import Body
from plop.physics.effects.effect import Effect
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.jit import kernel
from plop.physics.engine.kernels.elastic import kirchhoff_stress
from plop.physics.engine.kernels.transfer import row_major
from plop.physics.engine.material import Material
from plop.physics.engine.time_step import wave_step_s

CELL = 1.5
"""Width of the cells in which depth is measured, in distances between particles: lattices and draws leave no holes."""

Fields = Callable[[Body], np.ndarray]


@kernel()
def scaled_stress(f, law, mu, lam, scale, extra):
    """Add the base's stress (scale - 1) times.

    Takes:
        f, law, mu, lam: Deformation gradient [N, 3, 3] and the base's law, see `plop.physics.engine.kernels.elastic`.
        scale: Modulus of each particle over the base's [N].
        extra: Added to, [N, 6] [Pa].
    """
    for p in range(f.shape[0]):
        stress = kirchhoff_stress(law, *row_major(f, p), mu, lam)
        for k in range(6):
            extra[p, k] += (scale[p] - np.float32(1)) * stress[k]


def along(axis: int) -> Fields:
    """Give the field that grows by 2 from one end of an axis to the other."""

    def field(body: Body) -> np.ndarray:
        place = body.x[:, axis].astype(float)
        return np.asarray((place - place.min()) / max(np.ptp(place), 1e-9) * 2)

    return field


def outside(body: Body) -> np.ndarray:
    """Give the field that grows by 2 from the innermost particle to the surface."""
    cell = CELL * float(np.median(body.volume)) ** (1 / 3)
    place = (body.x - body.x.min(0)) / cell + 2
    filled = np.zeros(np.ceil(place.max(0)).astype(int) + 3, bool)
    filled[tuple(np.round(place).astype(int).T)] = True
    depth = map_coordinates(distance_transform_edt(binary_closing(filled)), place.T, order=1)
    return np.asarray(2 - 2 * depth / max(depth.max(), 1e-9))


def _end(name: str, end: str) -> Parameter:
    return Parameter(name, "-", -3.0, 3.0, step=0.05, typical=0.7, help=f"logarithm of the modulus {end}")


class _Uneven(Effect):
    """The base's stress with a modulus of E exp(sum of amplitude times field), each field with a mean of 0."""

    source = "Hooke's law with a modulus that differs from place to place; the mean of its logarithm is the base's"
    fields: ClassVar[tuple[Fields, ...]]
    """One for each amplitude; of the places at which the law first acts."""
    remembers = {"scale": ((), np.nan)}

    def stress(self, body: Body, dt: float) -> None:
        """Scale the base's stress."""
        scale = body.memory[f"{self.name}.scale"]
        if len(scale) and np.isnan(scale[0]):
            amounts = [self[p.name] for p in self.amplitudes]
            total = np.sum([amount * field(body) for amount, field in zip(amounts, self.fields, strict=True)], 0)
            scale[:] = np.exp(total - np.average(total, weights=body.volume))
        scaled_stress(body.f, *body.elastic, scale, body.extra)

    def slowest_step_s(self, material: Material, config: EngineConfig) -> float:
        """Waves are fastest where it is stiffest: in blocks, balls and wedges at most 1.5 amplitudes above the mean."""
        ln_e = sum(abs(self[p.name]) for p in self.amplitudes)
        return wave_step_s((np.exp(1.5 * ln_e) - 1) * (material.lame_pa + 2 * material.shear_pa), material, config)


class Graded(_Uneven):
    """The modulus' logarithm changes evenly from one side to the other."""

    name = "graded"
    help = "one side is stiffer than the other"
    law = "E -> E exp(ln_e_x X + ln_e_y Y), X, Y from -1 to 1 across the object"
    amplitudes = (_end("ln_e_x", "at the end at large x"), _end("ln_e_y", "at the end at large y"))
    fields = (along(0), along(1))


class Layered(_Uneven):
    """The modulus' logarithm changes evenly from the bottom to the top."""

    name = "layered"
    help = "the top is stiffer or softer than the bottom"
    law = "E -> E exp(ln_e Z), Z from -1 to 1 from the bottom to the top"
    amplitudes = (_end("ln_e", "at the top"),)
    fields = (along(2),)


class Crust(_Uneven):
    """The modulus' logarithm changes evenly with depth, from the innermost point to the surface."""

    name = "crust"
    help = "the skin is stiffer or softer than the inside"
    law = "E -> E exp(ln_e (D - mean of D)), D from -1 inside to 1 at the surface"
    amplitudes = (_end("ln_e", "of the skin over the mean, per half of the way in"),)
    fields = (outside,)
