"""What was diagnosed: the ranking with its intervals, detection limits, sensors."""

from __future__ import annotations

from dataclasses import dataclass

from plop.diagnosis.decision.limits import Limit
from plop.diagnosis.decision.result import Diagnosis, Ranked
from plop.diagnosis.decision.verdict import VerdictKind


@dataclass(frozen=True)
class DiagnosisSection:
    """One diagnosis, in the order in which it is shown."""

    label: str
    """The model that it is of."""
    found: Diagnosis
    shown: list[Ranked]
    """Laws that help or are named, best first."""
    idle: list[Ranked]
    """Laws that take nothing away."""
    reach: float
    """Largest share on the scale of the ranking."""
    limits: list[tuple[str, Limit]]
    """By effect, the smallest displacement first."""
    says: str
    """The verdict's own sentence; "" where headline and ranking say all of it."""


def diagnosis_section(label: str, found: Diagnosis) -> DiagnosisSection:
    """Put a diagnosis of the model `label` in order."""
    idle = [row for row in found.ranking if row.gain <= 0 and row.effect not in found.verdict.named]
    says = "" if found.verdict.kind == VerdictKind.EFFECT and len(found.named) == 1 else found.verdict.text
    return DiagnosisSection(
        label,
        found,
        [row for row in found.ranking if row not in idle],
        idle,
        min(max([row.gain + row.gain_error for row in found.ranking if row.gain > 0] + [0.05]), 1.0),
        sorted(found.limits.items(), key=lambda pair: pair[1].displacement_m or float("inf")),
        says,
    )
