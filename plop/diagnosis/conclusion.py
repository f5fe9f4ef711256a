"""What was found: scores, findings, shams and limits on the way from evidence to a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from plop.diagnosis.error_size import ErrorSize
from plop.diagnosis.evidence import Evidence, MisfitModel
from plop.diagnosis.finding import Finding
from plop.diagnosis.findings import base_finding, beyond, finding_of
from plop.diagnosis.judge import first_of, judge
from plop.diagnosis.limits import Limit, detection_limits
from plop.diagnosis.screen import Score, confounded
from plop.diagnosis.shams import sham_gains
from plop.diagnosis.state import State
from plop.diagnosis.verdict import Verdict
from plop.parameters import Estimate


@dataclass(frozen=True)
class Conclusion:
    """All that was found, with the arrays behind it; a `Diagnosis` is what is kept of it."""

    verdict: Verdict
    scores: list[Score]
    """Best first, one for each effect; the best were refitted."""
    findings: list[Finding]
    """The same with parameters, p and contrast; the base's own parameters come last."""
    shams: np.ndarray
    """Best gain over the library under each sham."""
    limits: dict[str, Limit]
    """Effect -> smallest detectable amplitude and displacement."""
    size: ErrorSize
    """How large the base's error is, here and in the reference."""
    dropped: dict[str, str]
    """Episodes and columns left out, with the reason."""
    evidence: list[Evidence]
    control: list[Evidence]
    misfit: MisfitModel
    settings: list[tuple[Score, dict[str, Estimate]]]
    """Other settings of the best law that do as well, with their amplitudes."""
    screen_s: float = 0.0
    """Seconds until every law had been tried and ranked, before any was fitted again."""


def conclusion(state: State, sensors: Sequence[str], shams: int, seed: int) -> Conclusion:
    """Judge by what has been computed.

    Args:
        state: It.
        sensors: Significant sensor faults, in words.
        shams: Number of shams.
        seed: Draws them.
    """
    scores = state.judged()
    sham = sham_gains(state.screen, seed=seed, count=shams, alone=not state.control)
    findings = [finding_of(state, score, sham) for score in scores]
    base = base_finding(state, sham)
    first = scores[first_of(findings) or 0] if scores else None
    left = None if first is None else state.left(first)
    alike = [] if first is None else [s.candidate.effect for s in confounded(state.screen, first, scores)]
    second = None if first is None else beyond(state, first, sham)
    verdict = judge(findings, alike, base, list(sensors), state.size, left=left, second=second)
    contrasts = {f.name: f.contrast for f in findings if f.contrast is not None}
    limits = detection_limits(state.screen, scores, sham, state.response_rms_m, contrasts, state.would_stand_out)
    where = ("", "reference ")  # both sets may have an episode of the same name
    dropped = {f"{where[k]}{key}": why for k, table in enumerate(state.tables) for key, why in table.dropped.items()}
    settings = [] if first is None else [(score, state.amplitudes(score)) for score in state.settings(first)]
    return Conclusion(
        verdict,
        scores,
        [*findings, base],
        sham,
        limits,
        state.size,
        dropped,
        state.evidence,
        state.control,
        state.misfit,
        settings,
    )
