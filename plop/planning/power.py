"""Which laws would be seen with these motions, from which amplitude on, and with how many repeats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plop.diagnosis.decision.limits import least_seen
from plop.diagnosis.responses.hypotheses import Hypothesis
from plop.diagnosis.rule import RULE, DecisionRule
from plop.planning.design import DRAWS, Design
from plop.planning.motions import Motion

MOST_EPISODES = 60
"""Recordings of both sets together, at most: more are seldom made, and the products grow with their square."""


@dataclass(frozen=True)
class LawPower:
    """How well one law is seen, in the setting and direction in which it is seen worst."""

    effect: str
    kind: str
    """physics or base."""
    parameter: str
    unit: str
    typical: float
    """Typical amplitude."""
    amplitude: float | None
    """Smallest that is seen nine times in ten with each motion once in each set; None where none in its range is."""
    displacement_mm: float | None
    """RMS displacement that it makes then [mm]."""
    chances: tuple[float, ...]
    """Chance that the typical amplitude is seen, each motion recorded once, twice, ... in each set."""
    repeats: int | None
    """Recordings of each motion in each set with which that is nine in ten; None: more than were tried."""


def powers(
    motions: Sequence[Motion], hypotheses: Sequence[Hypothesis], most: int, *, seed: int = 0, rule: DecisionRule = RULE
) -> tuple[list[LawPower], list[int]]:
    """Judge every law.

    Args:
        motions: Recorded as the reference; they are repeated, in both sets alike.
        hypotheses: All that the diagnosis tries, in the order of the motions' responses.
        most: Repeats that are tried at most.
        seed: Of the draws.
        rule: Error rates and margins.

    Returns:
        Laws, those that are seen most easily first; and in how many ways the episodes can be dealt out, for each
        number of repeats that was tried.
    """
    counts = [r for r in range(1, most + 1) if r == 1 or 2 * r * len(motions) <= MOST_EPISODES]
    designs = [Design([*motions] * r, [*motions] * r, seed) for r in counts]
    laws: dict[str, list[int]] = {}
    for k, hypothesis in enumerate(hypotheses):
        if hypothesis.candidate.kind != "decoy" and hypothesis.is_typical:
            laws.setdefault(hypothesis.effect, []).append(k)
    found = []
    for own in laws.values():
        limits = [_limit(designs[0], k, hypotheses[k].most, rule) for k in own]
        worst = own[int(np.argmax(limits))]
        chances = tuple(min(seen_chance(design, k, rule) for k in own) for design in designs)
        found.append(_power(motions, hypotheses[worst], worst, max(limits), chances, rule))
    ranked = sorted(found, key=lambda p: (p.repeats or most + 1, -p.chances[0], -p.chances[-1], p.effect))
    return ranked, [len(design.ways) for design in designs]


def _limit(design: Design, k: int, most: float, rule: DecisionRule) -> float:
    """Give the least multiple of an amplitude that is seen nine times in ten; infinite where none is."""
    critical = design.critical(k, rule)
    least = [least_seen(design.products(d, k), design.here, float(critical[d]), most) for d in range(DRAWS)]
    factors = design.factors(rule)
    needed = np.where(factors > 0, np.array(least) / np.where(factors > 0, factors, 1.0), np.inf)
    found = float(np.quantile(needed, rule.seen, method="higher"))
    return found if found <= most else float("inf")


def seen_chance(design: Design, k: int, rule: DecisionRule = RULE, amount: float = 1.0) -> float:
    """Give the chance that a law at some multiple of its amplitude is found stronger than chance allows."""
    labels, chances = design.here[None].astype(float), list[float]()
    for d, factor in enumerate(design.factors(rule).tolist()):
        drawn = design.products(d, k, k, amount * factor)
        chances.append(design.by_chance[d].chance(float(drawn.strength(labels)[0]), drawn.freedom))
    return float(np.mean(np.array(chances) <= rule.alarm))


def _power(
    motions: Sequence[Motion],
    hypothesis: Hypothesis,
    column: int,
    multiple: float,
    chances: tuple[float, ...],
    rule: DecisionRule,
) -> LawPower:
    own, value = max(zip(hypothesis.candidate.columns, hypothesis.values, strict=True), key=lambda pair: abs(pair[1]))
    size_m = float(np.sqrt(np.mean([(m.responses[column] ** 2).sum(-1).mean() for m in motions])))
    seen = np.isfinite(multiple)
    enough = [count for count, chance in enumerate(chances, 1) if chance >= rule.seen]
    return LawPower(
        hypothesis.effect,
        hypothesis.candidate.kind,
        own.amplitude,
        own.unit,
        own.value,
        abs(multiple * value) * np.sign(own.value) if seen else None,
        1000 * multiple * size_m if seen else None,
        chances,
        enough[0] if enough else None,
    )
