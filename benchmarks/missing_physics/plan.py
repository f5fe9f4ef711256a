"""What is hidden, where and when: the order in which sets are made and judged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.missing_physics.cuts import Cuts
from benchmarks.missing_physics.makers import Foreign, Own

GROUPS = ("null", "single", "outside", "pair", "sensor")
CAMERAS = "cameras"
"""The world of `plop simulate`, measured through cameras by the commands of a user."""
FILMED = ("mujoco-cameras", "drake-cameras", "disect-cameras")
"""Worlds of other simulators, measured in the same way; the last one cuts."""
TWINS = ("stiffness", "damping")
"""Laws that another one of the library equals, so that nothing is outside it when they are left out: the density in
quasi-static motions, and viscosity."""
FAULTS = ("clock=0.03", "depth_scale=1.01", "pose_error.x_m=0.003", "pose_error.z_deg=1.0")
TOOL_FAULTS = ("robot_clock=0.03", "tool_offset.x_m=0.003", "tool_thickness=0.003")


class Set(NamedTuple):
    """Recordings to be judged."""

    world: str
    seed: int
    """Of the base."""
    group: str
    """One of GROUPS; outside: the law is left out of the library of the diagnosis."""
    law: str
    """Of a sensor fault: as typed after --fault."""
    repeated: bool
    """With the motions of the reference."""

    @property
    def name(self) -> str:
        """Of its row and of its artifacts."""
        law = self.law.replace("=", "-") or "none"
        return f"{self.world}-{self.seed}-{self.group}-{law}-{int(self.repeated)}"

    @property
    def first(self) -> int:
        """Number of the first motion; those of the reference begin with 0."""
        return 0 if self.repeated else 60 + 6 * len(self.law)


def laws_of(world: str) -> tuple[str, ...]:
    """List what can be hidden in a world."""
    if world in ("own", CAMERAS):
        return Own.laws
    return (Cuts if world.startswith("disect") else Foreign).laws


def plan(first_seed: int, bases: int, worlds: Sequence[str]) -> Iterator[Set]:
    """List the sets in the order in which they are made."""
    for k in range(bases):
        for world in worlds:
            seed = first_seed + k
            random = np.random.default_rng([seed, 7])
            first, second, *others = (str(law) for law in random.permutation(laws_of(world)))
            outside = next(law for law in others if law not in TWINS)
            for repeated in (False, True):
                yield Set(world, seed, "null", "", repeated)
            yield Set(world, seed, "single", first, bool(k % 2))
            yield Set(world, seed, "single", second, not k % 2)
            yield Set(world, seed, "outside", outside, bool(k % 2))
            yield Set(world, seed, "pair", f"{first}+{others[0]}", not k % 2)
            if world in (CAMERAS, *FILMED):
                for faults in (FAULTS, TOOL_FAULTS):
                    yield Set(world, seed, "sensor", faults[seed % len(faults)], bool(k % 2))
