"""One effect after the other: add what was named, and diagnose again."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from joblib import Parallel, delayed

from plop.comparison.discretisations import predicted_by_each
from plop.diagnosis.conclusion import Conclusion
from plop.diagnosis.diagnose import diagnose
from plop.diagnosis.finding import Finding
from plop.diagnosis.runs import Runs
from plop.diagnosis.table import Measured
from plop.diagnosis.verdict import VerdictKind
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import EffectType
from plop.tracking.episode import Episode

_ADDED = {VerdictKind.EFFECT: None, VerdictKind.PARTLY: 1, VerdictKind.CONFOUNDED: 1, VerdictKind.BASE_PARAMETER: 1}
"""Verdict -> how many of the named are added (None: all; the others name alternatives, the likeliest first)."""


def named_effects(found: Conclusion, types: Mapping[str, EffectType]) -> list[Effect]:
    """Build what the verdict names, with the fitted parameters; empty when it names nothing to add."""
    if found.verdict.kind not in _ADDED:
        return []
    names = found.verdict.named[: _ADDED[found.verdict.kind]]
    return [effect for name in names for effect in _built(name, found.findings, types)]


def _built(name: str, findings: list[Finding], types: Mapping[str, EffectType]) -> list[Effect]:
    parameters = next((f.parameters for f in findings if f.name == name), findings[-1].parameters)
    values = {key: found.value for key, found in parameters.items()}
    kind = types[name]
    own = {p.name: values[p.name] for p in kind.parameters() if p.name in values}
    return [kind(**own)] if own else []


def next_round(
    found: Conclusion,
    episodes: list[Episode],
    reference: list[Episode],
    base: EngineBase,
    types: Mapping[str, EffectType],
    runs: Runs,
) -> Conclusion | None:
    """Diagnose again with what was named added to the base; None when nothing was named.

    The reference has nothing hidden, so that its episodes are predicted by the base alone.
    """
    added = named_effects(found, types)
    if not added:
        return None

    def predicted(episode: Episode) -> list[np.ndarray]:
        return predicted_by_each(base, episode, added)

    points = Parallel(n_jobs=runs.jobs)(delayed(predicted)(episode) for episode in episodes)
    predictions = {e.name: p for e, p in zip(episodes, points, strict=True)}
    return diagnose(Measured(episodes, predictions), base, types, runs, reference=Measured(reference))
