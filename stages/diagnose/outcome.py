"""What is kept of a diagnosis, and its rows for the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from plop.diagnosis.decision.conclusion import Conclusion
from plop.diagnosis.decision.finding import Finding, explained_text
from plop.diagnosis.decision.next_step import next_step
from plop.diagnosis.decision.result import Diagnosis, Ranked, SensorFault
from plop.diagnosis.decision.verdict import VerdictKind
from plop.parameters import NOT_DETERMINED, Estimate, short_number, with_unit
from plop.physics.effects.library import EffectType


def diagnosis_of(
    found: Conclusion,
    types: Mapping[str, EffectType],
    sensors: tuple[SensorFault, ...] | None,
    left_out: Mapping[str, str],
    *,
    environment: str = "",
) -> Diagnosis:
    """Collect everything that was found; see docs/reference/outputs.md.

    Args:
        found: What the evidence says.
        types: The library.
        sensors: Significant faults; None where they were not looked for.
        left_out: Episodes that were not judged, with the reason.
        environment: Of the recordings.
    """
    facts, search = found.verdict.evidence, found.search
    names = [evidence.name for evidence in search.evidence]
    count = int(search.here.sum())
    same = search.field.repeats[:count, count:]
    return Diagnosis(
        verdict=found.verdict,
        ranking=tuple(_row(finding, types, found.gains[finding.name]) for finding in found.findings),
        limits=found.limits,
        sensors=sensors,
        searches=len(search.law_ways),
        error=facts.error or 0.0,
        floor=facts.floor,
        next_step=next_step(found, sensors or ()),
        episodes=tuple(names[:count]),
        repeats={names[k]: names[count + int(row.argmax())] for k, row in enumerate(same) if row.any()},
        reference_episodes=tuple(names[count:]),
        dropped={**left_out, **found.dropped},
        environment=environment,
    )


def _row(finding: Finding, types: Mapping[str, EffectType], gains: np.ndarray) -> Ranked:
    kind, score = types.get(finding.name), finding.score
    return Ranked(
        effect=finding.name,
        kind=finding.kind,
        help=kind.help if kind else "",
        law=kind.law if kind else "",
        source=kind.source if kind else "",
        gain=finding.gain,
        gain_error=finding.gain_error,
        strength=score.strength,
        gains=tuple(gains.tolist()),
        p=score.p,
        size_mm=1000 * score.size_m,
        parameters=_parameters(finding, kind),
        passes=not finding.reasons,
        reasons=finding.reasons,
    )


def _parameters(finding: Finding, kind: EffectType | None) -> dict[str, Estimate]:
    """Judge each estimate by the range that its law declares."""
    declared = {p.name: p for p in kind.parameters()} if kind else {}

    def judged(name: str, found: Estimate) -> Estimate:
        p = declared.get(name)
        tried = 0 if kind is None or p is None else len({v.get(name, p.default) for v in kind.variants})
        return found.within(p, tried)

    return {name: judged(name, found) for name, found in finding.parameters.items()}


def rows_of(found: Diagnosis, most: int = 6) -> list[dict[str, Any]]:
    """Give the head of the ranking as rows for the terminal."""
    rows, verdict = [], found.verdict
    certain = "explains too little" if verdict.kind == VerdictKind.NONE_OF_THESE else "passes"
    for row in found.ranking[:most]:
        first = next(iter(row.parameters.items()), None)
        rows.append(
            {
                "effect": row.effect,
                "explains": explained_text(row.gain, row.gain_error),
                "p": row.p,
                "moves_mm": round(row.size_mm, 3),
                "parameter": first and _parameter_text(*first),
                "verdict": "named" if row.effect in verdict.named else (row.why_not() or [certain])[0],
            }
        )
    return rows


def _parameter_text(name: str, found: Estimate) -> str:
    written = with_unit(f"{name} = {short_number(found.value)}", found.unit)
    return written if found.determined else f"{written}, {NOT_DETERMINED}"
