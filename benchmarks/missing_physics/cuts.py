"""Cuts by DiSECt with something hidden: a knife goes through an object of jelly and pushes one part aside.

The environment variable PLOP_DISECT names the folder of the simulator (DiSECt without), see `benchmarks.worlds.disect`.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.missing_physics.makers import Foreign, Values
from benchmarks.worlds.disect import record
from benchmarks.worlds.knife_cuts import Motion, World, drawn
from plop.recordings.readers.mesh.sequence import MeshSequence

FIRST = 2.0
"""Amplitudes begin with twice those of the other worlds: an episode takes a minute, and a jelly that is cut moves."""


class Cuts(Foreign):
    """A block of jelly, 100 x 100 x 50 mm; in rounder objects the simulator's cut catches on the knife."""

    laws = ("tilt", "table_friction", "stiffness", "swelling")
    """Viscosity and the friction of the knife move these cuts by a third of the noise, however large they are."""

    def __init__(self, seed: int) -> None:
        r = np.random.default_rng([seed, 3])
        self.seed = seed
        self.world = World(
            youngs_modulus_pa=float(np.exp(r.uniform(np.log(8e3), np.log(1.6e4)))),
            viscosity_pa_s=float(r.uniform(3, 10)),
            table_friction=float(r.uniform(0.3, 0.7)),
            knife_friction=float(r.uniform(0.3, 0.7)),
        )

    def sequence(self, number: int, hidden: Mapping[str, Values]) -> MeshSequence:
        """See `Foreign`."""
        changes: dict[str, Any] = {k: v for values in hidden.values() for k, v in values.items()}
        return _recorded(replace(self.world, **changes), drawn(self.seed, number))

    def drawn(self, law: str, random: np.random.Generator, times: float) -> tuple[Values, dict[str, Values]]:
        """See `Maker`."""
        if law == "swelling":
            rate = float(0.06 * FIRST * times * random.choice([-1, 1]))
            return {"swelling_per_s": rate}, {law: {"rate_per_s": rate}}
        return super().drawn(law, random, FIRST * times)


@functools.lru_cache(64)
def _recorded(world: World, motion: Motion) -> MeshSequence:
    return record(Path(os.environ.get("PLOP_DISECT", "DiSECt")), world, motion)
