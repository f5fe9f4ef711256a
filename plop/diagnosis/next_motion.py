"""Which motion to record next: judged by the motions that were recorded.

Confounded effects are told apart by the motion in which their responses differ most; an effect that one episode alone
shows, by more of its kind.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from plop.diagnosis.diagnose import Diagnosis
from plop.diagnosis.evidence import Evidence


def next_motion(found: Diagnosis) -> dict[str, Any] | None:
    """Choose the motion to record next.

    Returns:
        {"episode", "separation" (per effect pair, standard deviations), "text"}; None where no motion would help.
    """
    lone = found.verdict.evidence.get("lone")
    if lone is not None:
        text = (f"Only {lone['episode']} shows {lone['effect']}: record more motions like it, at other speeds and "
                "places, so that it can be told from chance.")  # fmt: skip
        return {"episode": lone["episode"], "separation": {}, "text": text}
    return _apart(found) if found.verdict.evidence.get("alternatives") else None


def _apart(found: Diagnosis) -> dict[str, Any] | None:
    """Compare the best effect's response with its rivals', episode by episode.

    In an episode two effects are told apart by what is left of one response when the other's multiple is taken
    off, in units of the expected error. The episode with the most left shows the motion to repeat, larger.
    """
    named = [s for s in found.scores if s.candidate.effect in found.verdict.named]
    if len(named) < 2:
        return None
    best, rivals = named[0], named[1:]
    rows = []
    for evidence in found.evidence:
        mine = _response(evidence, best)
        sigma = found.misfit.sigma(evidence)
        apart = []
        for rival in rivals:
            other = _response(evidence, rival)
            a, b = (mine / sigma).ravel(), (other / sigma).ravel()
            factor = (a @ b) / max(float(b @ b), 1e-30)
            apart.append(float(np.linalg.norm(a - factor * b)))
        rows.append((min(apart), evidence.name, dict(zip([r.candidate.effect for r in rivals], apart, strict=True))))
    separation, episode, pairs = max(rows)
    text = (f"The motion of {episode} tells {best.candidate.effect} from {', '.join(pairs)} best "
            f"({separation:.1f} standard deviations); record more like it, larger or slower and faster.")  # fmt: skip
    return {"episode": episode, "separation": pairs, "text": text}


def _response(evidence: Evidence, score: Any) -> np.ndarray:
    """Response of a fitted effect in one episode, [F, K, 3] [m]."""
    total = np.zeros_like(evidence.residual)
    for column, value in zip(score.candidate.columns, score.values, strict=True):
        total = total + value * evidence.responses[column.key]
    return total
