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
PAIRS = (
    ("swelling", "table_friction"),
    ("viscosity", "plasticity"),
    ("tilt", "swelling"),
    ("fibres", "table_friction"),
)
OUTSIDE = ("swelling", "plasticity", "table_friction", "tilt")
SNRS = (2.0, 4.0)
"""Signals that the second part of the plan is made for."""
TURNED = {
    "swelling": ({"rate_per_s": 0.08}, {"rate_per_s": -0.1}),
    "viscosity": ({"viscosity_pa_s": 60.0}, {"viscosity_pa_s": 120.0}),
    "table_friction": ({"d_mu": -0.3}, {"d_mu": 0.6}),
    "plasticity": ({"softness_per_kpa": 1.5}, {"softness_per_kpa": 3.0}),
    "tilt": ({"gx_m_s2": 0.8, "gy_m_s2": -0.8}, {"gx_m_s2": -0.5, "gy_m_s2": -2.0}),
    "relaxation": ({"ratio": 0.6, "tau_s": 0.1}, {"ratio": 0.8, "tau_s": 0.03}),
    "fibres": ({"ratio": 4.0, "angle_deg": 30.0}, {"ratio": 10.0, "angle_deg": 100.0}),
    "softening": ({"loss": 0.8, "strain": 0.02}, {"loss": 0.9, "strain": 0.01}),
    "stiffening": ({"growth": 200.0}, {"growth": 800.0}),
    "adhesion": ({"traction_pa": 250.0, "release_s": 0.1}, {"traction_pa": 600.0, "release_s": 0.05}),
    "toughness": ({"d_j_m2": 80.0}, {"d_j_m2": 150.0}),
    "blade_friction": ({"d_mu": 2.0}, {"d_mu": 2.0}),
}
"""Effect -> direction and shape for each of SNRS; the amplitude there is where the search for the signal starts."""
MORE_PAIRS = (
    ("stiffening", "swelling"),
    ("adhesion", "tilt"),
    ("relaxation", "tilt"),
    ("plasticity", "swelling"),
    ("softening", "table_friction"),
    ("fibres", "swelling"),
)
MORE_OUTSIDE = ("relaxation", "adhesion", "stiffening", "fibres", "tilt", "swelling")
FRESH_OUTSIDE = ("plasticity", "table_friction", "toughness", "fibres", "tilt", "relaxation")
MORE_BASE = {"stiffness": {"d_ln_e": -0.5}, "damping": {"d_per_s": 60.0}}


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
    snr: float | None = None
    """Signal that each hidden effect is scaled to, in noise floors; None: amplitudes as they are written here."""

    def effects(self, types: Mapping[str, EffectType]) -> list[Effect]:
        """Build what is hidden."""
        return [types[name](**dict(values)) for name, values in self.hidden]


def _values(table: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    return tuple(sorted(table.items()))


def _mixed(queues: list[list[Plan]], shares: list[int]) -> list[Plan]:
    """Take from all queues in turn, so that a stop leaves all of them represented."""
    mixed: list[Plan] = []
    while any(queues):
        for queue, share in zip(queues, shares, strict=True):
            mixed += [queue.pop(0) for _ in range(min(share, len(queue)))]
    return mixed


def _plan() -> list[Plan]:
    singles = [
        Plan(f"single-{name}-{level}", "single", 100 + 10 * k + level, ((name, _values(values[level])),))
        for level in (1, 0)
        for k, (name, values) in enumerate(SINGLE.items())
    ]
    nulls = [Plan(f"null-{k}", "null", 400 + k) for k in range(12)]
    base = [Plan(f"base-{name}", "base", 500 + k, ((name, _values(v)),)) for k, (name, v) in enumerate(BASE.items())]
    decoys = [
        Plan(f"decoy-{name}", "decoy", 550 + k, ((name, _values(v)),)) for k, (name, v) in enumerate(DECOYS.items())
    ]
    pairs = [
        Plan(f"pair-{a}-{b}", "pair", 600 + k, ((a, _values(SINGLE[a][1])), (b, _values(SINGLE[b][1]))))
        for k, (a, b) in enumerate(PAIRS)
    ]
    outside = [
        Plan(f"outside-{name}", "outside", 700 + k, ((name, _values(SINGLE[name][1])),), (name,))
        for k, name in enumerate(OUTSIDE)
    ]
    return _mixed([singles, nulls, [*base, *decoys], pairs, outside], [4, 1, 1, 1, 1])


def _designed() -> list[Plan]:
    """Runs at a given signal, with other seeds, directions and shapes than the first part's."""
    singles = [
        Plan(
            f"snr{SNRS[level]:g}-{name}",
            "single",
            2000 + 100 * level + k,
            ((name, _values(values[level])),),
            (),
            SNRS[level],
        )
        for level in (1, 0)
        for k, (name, values) in enumerate(TURNED.items())
    ]
    nulls = [Plan(f"null-more-{k}", "null", 2400 + k) for k in range(12)]
    base = [
        Plan(f"base-more-{name}", "base", 2500 + k, ((name, _values(v)),), (), 2.0)
        for k, (name, v) in enumerate(MORE_BASE.items())
    ]
    pairs = [
        Plan(f"pair-more-{a}-{b}", "pair", 2600 + k, tuple((n, _values(TURNED[n][0])) for n in (a, b)), (), 2.5)
        for k, (a, b) in enumerate(MORE_PAIRS)
    ]
    outside = [
        Plan(f"outside-more-{name}", "outside", 2700 + k, ((name, _values(TURNED[name][1])),), (name,), 3.0)
        for k, name in enumerate(MORE_OUTSIDE)
    ]
    return _mixed([singles, nulls, base, pairs, outside], [4, 2, 1, 1, 1])


def _fresh() -> list[Plan]:
    """Runs that were first made after the diagnosis and the finer engine were fixed."""
    return [
        Plan(f"outside-fresh-{name}", "outside", 2800 + k, ((name, _values(TURNED[name][0])),), (name,), 3.0)
        for k, name in enumerate(FRESH_OUTSIDE)
    ]


PLAN = [*_designed(), *_fresh(), *_plan()]

REASONS = frozenset(
    {
        "snr4-relaxation",
        "snr2-softening",
        "pair-more-relaxation-tilt",
        "base-more-damping",
        "null-more-2",
        "pair-more-adhesion-tilt",
        "null-more-4",
        "null-more-5",
        "null-more-6",
        "null-more-7",
    }
)
"""Runs for whose sake rules of the verdict were changed: laws at the end of their range, base parameters, laws that one
episode alone carries, and the mean over discretisations (the last four)."""
DEVELOPED = REASONS | {plan.name for plan in _plan()}
"""Runs whose recordings were looked at while the rules of the verdict were being changed; the others' never were."""
