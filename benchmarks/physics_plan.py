"""What the missing-physics benchmark hides, in the order in which it runs: a stop leaves all sets represented."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from plop.physics.effects.effect import Effect
from plop.physics.effects.library import EffectType

SINGLE = {
    "swelling": ({"rate_per_s": -0.06}, {"rate_per_s": 0.12}),
    "viscosity": ({"viscosity_pa_s": 40.0}, {"viscosity_pa_s": 100.0}),
    "table_friction": ({"d_mu": 0.4}, {"d_mu": -0.35}),
    "plasticity": ({"softness_per_kpa": 1.5}, {"softness_per_kpa": 3.0}),
    "tilt": ({"gx_m_s2": 1.2, "gy_m_s2": 0.6}, {"gx_m_s2": -2.0, "gy_m_s2": 1.0}),
    "relaxation": ({"ratio": 0.5, "tau_s": 0.2}, {"ratio": 0.7, "tau_s": 0.05}),
    "fibres": ({"ratio": 3.0, "angle_deg": 45.0}, {"ratio": 6.0, "angle_deg": 0.0}),
    "softening": ({"loss": 0.7, "strain": 0.02}, {"loss": 0.9, "strain": 0.02}),
    "stiffening": ({"growth": 100.0}, {"growth": 250.0}),
    "adhesion": ({"traction_pa": 150.0, "release_s": 0.1}, {"traction_pa": 300.0, "release_s": 0.1}),
    "toughness": ({"d_j_m2": 25.0}, {"d_j_m2": 60.0}),
    "blade_friction": ({"d_mu": 1.0}, {"d_mu": 2.0}),
}
"""Effect -> a smaller and a larger amplitude."""
BASE = {"stiffness": {"d_ln_e": 0.4}, "damping": {"d_per_s": 40.0}}
DECOYS = {"drag": {"per_m": 200.0}, "inertia": {"ratio": 0.7}}
PAIRS = (("swelling", "table_friction"), ("viscosity", "plasticity"), ("tilt", "swelling"),
         ("fibres", "table_friction"))  # fmt: skip
OUTSIDE = ("swelling", "plasticity", "table_friction", "tilt")


@dataclass(frozen=True)
class Plan:
    """One run."""

    name: str
    set: str
    """null, single, base, decoy, pair or outside."""
    seed: int
    hidden: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = ()
    without: tuple[str, ...] = ()
    """Effects taken out of the library of the diagnosis."""

    def effects(self, types: Mapping[str, EffectType]) -> list[Effect]:
        """Build what is hidden."""
        return [types[name](**dict(values)) for name, values in self.hidden]


def _values(table: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    return tuple(sorted(table.items()))


def _plan() -> list[Plan]:
    singles = [Plan(f"single-{name}-{level}", "single", 100 + 10 * k + level, ((name, _values(values[level])),))
               for level in (1, 0) for k, (name, values) in enumerate(SINGLE.items())]  # fmt: skip
    nulls = [Plan(f"null-{k}", "null", 400 + k) for k in range(12)]
    base = [Plan(f"base-{name}", "base", 500 + k, ((name, _values(v)),)) for k, (name, v) in enumerate(BASE.items())]
    decoys = [Plan(f"decoy-{name}", "decoy", 550 + k, ((name, _values(v)),))
              for k, (name, v) in enumerate(DECOYS.items())]  # fmt: skip
    pairs = [Plan(f"pair-{a}-{b}", "pair", 600 + k, ((a, _values(SINGLE[a][1])), (b, _values(SINGLE[b][1]))))
             for k, (a, b) in enumerate(PAIRS)]  # fmt: skip
    outside = [Plan(f"outside-{name}", "outside", 700 + k, ((name, _values(SINGLE[name][1])),), (name,))
               for k, name in enumerate(OUTSIDE)]  # fmt: skip
    mixed: list[Plan] = []
    queues = [singles, nulls, [*base, *decoys], pairs, outside]
    shares = [4, 1, 1, 1, 1]
    while any(queues):
        for queue, share in zip(queues, shares, strict=True):
            mixed += [queue.pop(0) for _ in range(min(share, len(queue)))]
    return mixed


PLAN = _plan()

DEVELOPED = frozenset(plan.name for plan in PLAN[:33])
"""Runs that were looked at while the rules of the verdict were being fixed; the others came afterwards."""
