"""Which motion to record next, judged by the motions that were recorded.

Laws that cannot be distinguished, or settings of one law, are distinguished by the motion in which their responses
differ most.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from plop.diagnosis.conclusion import Conclusion
from plop.diagnosis.search import Score
from plop.diagnosis.verdict import VerdictKind
from plop.parameters import short_number, with_unit


@dataclass(frozen=True)
class NextMotion:
    """A motion to record."""

    episode: str
    """The recorded episode that is like it."""
    separation: Mapping[str, float]
    """From each rival, in standard deviations."""
    text: str


def next_motion(found: Conclusion) -> NextMotion | None:
    """Choose the motion that distinguishes the best law from its rivals; None where there are none."""
    if not found.rivals or found.verdict.kind in (VerdictKind.SENSOR, VerdictKind.NOTHING_DETECTABLE):
        return None
    best = found.findings[0].score
    laws = any(rival.hypothesis.effect != best.hypothesis.effect for rival in found.rivals)
    rivals = {(rival.hypothesis.effect if laws else _setting(rival)): rival for rival in found.rivals}
    separation, episode, pairs = _most_apart(found, best, rivals)
    if laws:
        text = (
            f"The motion of {episode} distinguishes {best.hypothesis.effect} from {', '.join(pairs)} best "
            f"({separation:.1f} standard deviations); record more like it, larger or slower and faster."
        )
    else:
        either = ", or ".join(f"{_setting(score)} with {_amplitudes(score)}" for score in (best, *found.rivals))
        text = (
            f"These motions do not determine its setting: {either}. The predictions differ most in the motion of "
            f"{episode}; record more like it, slower and faster."
        )
    return NextMotion(episode, pairs, text)


def _setting(score: Score) -> str:
    candidate = score.hypothesis.candidate
    units = dict(candidate.shape_units)
    shapes = candidate.columns[0].shapes
    return ", ".join(with_unit(f"{name} = {short_number(value)}", units.get(name)) for name, value in shapes)


def _amplitudes(score: Score) -> str:
    columns = score.hypothesis.candidate.columns
    return ", ".join(
        with_unit(f"{column.amplitude} = {short_number(value)}", column.unit)
        for column, value in zip(columns, score.values, strict=True)
    )


def _most_apart(found: Conclusion, best: Score, rivals: Mapping[str, Score]) -> tuple[float, str, dict[str, float]]:
    """Compare a response with those of its rivals, by label, episode by episode.

    In an episode two laws are distinguished by what is left of one response when the other's multiple is taken off, in
    units of the expected error. The episode with the most left shows the motion to repeat, larger.

    Returns:
        Separation from the nearest rival, the episode, and the separation from each rival.
    """
    search = found.search
    own, others = _whitened(found, best), {label: _whitened(found, rival) for label, rival in rivals.items()}
    rows = []
    for k in np.flatnonzero(search.here).tolist():
        apart = {label: _left(own[k], other[k]) for label, other in others.items()}
        rows.append((min(apart.values()), search.evidence[k].name, apart))
    return max(rows, key=lambda row: row[:2])


def _whitened(found: Conclusion, score: Score) -> Sequence[np.ndarray]:
    response = found.search.response(score.hypothesis)
    weights = found.search.field.weights
    return [
        (score.amount * np.sqrt(w)[:, None] * r.reshape(-1, 3)).ravel() for r, w in zip(response, weights, strict=True)
    ]


def _left(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - (a @ b) / max(float(b @ b), 1e-30) * b))
