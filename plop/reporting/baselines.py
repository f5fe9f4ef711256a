"""The two predictions that anybody can make, and where a model is no better than they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from plop.reporting.colours import PERSISTENCE, RIGID
from plop.reporting.compared import Compared, ReportFacts
from plop.reporting.errors_over import error_over, judged_on
from plop.reporting.numbers import number


@dataclass(frozen=True)
class Baseline:
    """One of them."""

    key: str
    """As compare.json and scores.json call it."""
    label: str
    colour: str
    says: str
    """What it does, as the subject of a sentence."""


BASELINES = (
    Baseline("persistence", "nothing moves", PERSISTENCE, "Predicting that nothing moves"),
    Baseline("rigid", "best rigid motion (oracle)", RIGID, "Moving the object as one rigid body"),
)
"""In the order of every table."""
ORACLE = "The best rigid motion is fitted to the measured points of each frame: it is an oracle, not a prediction."
_SCORES = (("cd_mm", "CD"), ("emd_mm", "EMD"))


def beaten(facts: ReportFacts) -> list[str]:
    """Say which models a baseline beats, over the episodes that the headline counts and by the scores of `plop eval`.

    Returns:
        One sentence for each baseline and model; none where every model is better than both.
    """
    episodes, over = judged_on(facts)
    found = []
    for compared in facts.compared:
        error = error_over(compared, episodes)
        for baseline in BASELINES:
            closer = (
                []
                if error is None or error[baseline.key] >= error["rms"]
                else [f"{number(error[baseline.key])} mm against {number(error['rms'])} mm ({over})"]
            )
            closer += [
                f"{number(theirs)} mm against {number(ours)} mm ({name} of plop eval)"
                for name, ours, theirs in _scored(facts, compared, baseline)
                if theirs < ours
            ]
            if closer:
                found.append(
                    f"{baseline.says} is closer to the measurement than {compared.label}: {'; '.join(closer)}."
                )
    return found


def _scored(facts: ReportFacts, compared: Compared, baseline: Baseline) -> list[tuple[str, float, float]]:
    """Scores of a model and of a baseline by `plop eval`, both where they are known."""
    scores = next((s for label, s in facts.scores if label == compared.label), None)
    if scores is None:
        return []
    ours, theirs = (scores.methods.get(key, {}).get("episode", {}) for key in (scores.method, baseline.key))
    both = [(name, ours.get(metric), theirs.get(metric)) for metric, name in _SCORES]
    return [(name, mine.mean, other.mean) for name, mine, other in both if mine and other]


def is_beaten(error: float | None, others: Sequence[float | None]) -> bool:
    """Tell whether any of the baselines' errors is smaller than a model's."""
    return error is not None and any(other is not None and other < error for other in others)
