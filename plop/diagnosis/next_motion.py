"""Which motion to record next: judged by the motions that were recorded.

Confounded effects, and settings of one effect, are told apart by the motion in which their responses differ most; an
effect that one episode alone shows, by more of its kind.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from plop.diagnosis.conclusion import Conclusion
from plop.diagnosis.evidence import Evidence
from plop.diagnosis.screen import Score
from plop.parameters import Estimate, short_number, with_unit


@dataclass(frozen=True)
class NextMotion:
    """A motion to record."""

    episode: str
    """The recorded episode that is like it."""
    separation: Mapping[str, float]
    """From each rival, in standard deviations."""
    text: str


def next_motion(found: Conclusion) -> NextMotion | None:
    """Choose the motion to record next; None where no motion would help."""
    lone = found.verdict.evidence.lone
    if lone is not None:
        text = (
            f"Only {lone.episode} shows {lone.effect}: record more motions like it, at other speeds and "
            "places, so that it can be told from chance."
        )
        return NextMotion(lone.episode, {}, text)
    return _apart(found) if found.verdict.evidence.alternatives else None


def settling_motion(found: Conclusion) -> NextMotion | None:
    """Choose the motion that would tell the settings of a law, a time or a direction, that do as well now.

    Returns:
        None where one effect is not all that is named, or its setting is known.
    """
    best = next((s for s in found.scores if (s.candidate.effect,) == found.verdict.named), None)
    if best is None or {score.candidate.effect for score, _ in found.settings} != {best.candidate.effect}:
        return None
    own = next(f.parameters for f in found.findings if f.name == best.candidate.effect)
    rivals = {_setting(score): score for score, _ in found.settings}
    _, episode, pairs = _most_apart(found, best, rivals)
    either = ", or ".join(
        f"{_setting(score)} with {_amplitudes(score, parameters)}"
        for score, parameters in ((best, own), *found.settings)
    )
    text = (
        f"These motions do not tell its setting: {either}. They differ most in that of {episode}; "
        "record more like it, slower and faster."
    )
    return NextMotion(episode, pairs, text)


def _setting(score: Score) -> str:
    units = dict(score.candidate.shape_units)
    return _listed((name, value, units.get(name)) for name, value in score.candidate.columns[0].shapes)


def _amplitudes(score: Score, parameters: Mapping[str, Estimate]) -> str:
    return _listed((c.amplitude, parameters[c.amplitude].value, c.unit) for c in score.candidate.columns)


def _listed(numbers: Iterable[tuple[str, float, str | None]]) -> str:
    return ", ".join(with_unit(f"{name} = {short_number(value)}", unit) for name, value, unit in numbers)


def _apart(found: Conclusion) -> NextMotion | None:
    """Choose the motion that tells the best effect from its rivals."""
    named = [s for s in found.scores if s.candidate.effect in found.verdict.named]
    if len(named) < 2:
        return None
    best, rivals = named[0], {s.candidate.effect: s for s in named[1:]}
    separation, episode, pairs = _most_apart(found, best, rivals)
    text = (
        f"The motion of {episode} tells {best.candidate.effect} from {', '.join(pairs)} best "
        f"({separation:.1f} standard deviations); record more like it, larger or slower and faster."
    )
    return NextMotion(episode, pairs, text)


def _most_apart(found: Conclusion, best: Score, rivals: Mapping[str, Score]) -> tuple[float, str, dict[str, float]]:
    """Compare a response with those of its rivals, by label, episode by episode.

    In an episode two effects are told apart by what is left of one response when the other's multiple is taken
    off, in units of the expected error. The episode with the most left shows the motion to repeat, larger.

    Returns:
        Separation from the nearest rival, the episode, and the separation from each rival.
    """
    rows = []
    for evidence in found.evidence:
        sigma = found.misfit.sigma(evidence)
        a = (_response(evidence, best) / sigma).ravel()
        apart = {}
        for label, rival in rivals.items():
            b = (_response(evidence, rival) / sigma).ravel()
            apart[label] = float(np.linalg.norm(a - (a @ b) / max(float(b @ b), 1e-30) * b))
        rows.append((min(apart.values()), evidence.name, apart))
    return max(rows, key=lambda row: row[:2])


def _response(evidence: Evidence, score: Score) -> np.ndarray:
    """Response of a fitted effect in one episode, [F, K, 3] [m]."""
    total = np.zeros_like(evidence.residual)
    for column, value in zip(score.candidate.columns, score.values, strict=True):
        total = total + value * evidence.responses[column.key]
    return total
