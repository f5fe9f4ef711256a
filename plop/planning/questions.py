"""What is to be distinguished: laws at amplitudes, or settings of one law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from plop.diagnosis.decision.result import Diagnosis, Ranked
from plop.diagnosis.responses.hypotheses import Candidate, Hypothesis
from plop.errors import PlopError
from plop.parameters import short_number, with_unit
from plop.planning.design import Design
from plop.planning.separation import Pair, information

SILENT = "it moves nothing that was followed in these recordings"
"""What is said of a law without response."""


@dataclass(frozen=True)
class Question:
    """Hypotheses in groups, one of which is right: laws, or settings of one law."""

    labels: tuple[str, ...]
    groups: tuple[tuple[Hypothesis, ...], ...]
    at_amplitude: bool
    """The amplitudes are those that were found; else they are typical ones."""

    @property
    def hypotheses(self) -> list[Hypothesis]:
        """All of them."""
        return [hypothesis for group in self.groups for hypothesis in group]


def typical_ones(laws: Sequence[str], hypotheses: Sequence[Hypothesis]) -> Question:
    """Ask which of some laws it is, each at its typical amplitude.

    Args:
        laws: Their names.
        hypotheses: All that are tried.
    """
    groups = (tuple(h for h in hypotheses if h.effect == law) for law in laws)
    return Question(tuple(laws), tuple(groups), False)


def answerable(asked: Question, usable: Sequence[Hypothesis], why: Mapping[str, str]) -> Question:
    """Keep the hypotheses that move something.

    Args:
        asked: What is to be distinguished.
        usable: Hypotheses that move something.
        why: Laws of which none does, with the reason.

    Raises:
        PlopError: Of a law none does.
    """
    groups = []
    for label, group in zip(asked.labels, asked.groups, strict=True):
        groups.append(tuple(h for h in group if h in usable))
        if not groups[-1]:
            raise PlopError(
                "A law cannot be distinguished: it does nothing in these motions.",
                where=label,
                expected="a law that moves the object in one of the recorded motions",
                found=why.get(label, SILENT),
                fix="Record a motion in which it acts (a cut for toughness or cohesion), or leave it out.",
            )
    return replace(asked, groups=tuple(groups))


def found_by(diagnosis: Diagnosis, candidates: Sequence[Candidate]) -> Question:
    """Ask which it is of the laws, or the settings of one law, that a diagnosis could not distinguish.

    Args:
        diagnosis: It.
        candidates: Of the whole library.

    Raises:
        PlopError: It leaves nothing to distinguish, or names a law that the library does not hold.
    """
    verdict = diagnosis.verdict
    rows = [row for row in diagnosis.named if row.parameters]
    if rows and verdict.evidence.alternatives:
        names = [rows[0].effect, *verdict.evidence.alternatives]
        rows = [row for row in rows if row.effect in names]
        groups = [(_at(candidates, row, {}),) for row in rows]
        return Question(tuple(row.effect for row in rows), tuple(groups), True)
    known = _settings_of(rows[0], candidates) if rows else {}
    if len(known) < 2:
        raise PlopError(
            "This diagnosis leaves nothing to distinguish.",
            expected="a verdict that names several laws (CONFOUNDED), or one in several settings",
            found=f"{verdict.kind}: {', '.join(verdict.named) or 'nothing'}",
            fix="Leave --diagnosis out: `plop plan` then tells how many repeats show which law.",
        )
    return Question(tuple(known), tuple((hypothesis,) for hypothesis in known.values()), True)


def _settings_of(row: Ranked, candidates: Sequence[Candidate]) -> dict[str, Hypothesis]:
    """Give the settings of a law that fit equally well, e.g. "tau_s = 0.05 s", each at the amplitude that was found."""
    open_ = {name: (p.value, *p.alternatives) for name, p in row.parameters.items() if p.alternatives}
    found = {}
    for chosen in product(*open_.values()):
        setting = dict(zip(open_, chosen, strict=True))
        hypothesis = _found(candidates, row, setting)
        if hypothesis is not None:
            words = (with_unit(f"{n} = {short_number(v)}", row.parameters[n].unit) for n, v in setting.items())
            found[", ".join(words)] = hypothesis
    return found


def _at(candidates: Sequence[Candidate], row: Ranked, setting: Mapping[str, float]) -> Hypothesis:
    """Build a law at the amplitude, and in the setting, in which it was found.

    Raises:
        PlopError: The library does not hold it.
    """
    found = _found(candidates, row, setting)
    if found is None:
        raise PlopError(
            "The diagnosis names a law that the library does not hold.",
            found=row.effect,
            fix="Give the file with its effect, as for the diagnosis: --effect-file FILE.",
        )
    return found


def _found(candidates: Sequence[Candidate], row: Ranked, setting: Mapping[str, float]) -> Hypothesis | None:
    known = {name: p.value for name, p in row.parameters.items()} | dict(setting)
    for candidate in candidates:
        shapes = candidate.columns[0].shapes
        if candidate.effect == row.effect and all(np.isclose(known.get(name, value), value) for name, value in shapes):
            values = tuple(known.get(column.amplitude, column.value) for column in candidate.columns)
            return Hypothesis(candidate, values, ()).at(1.0)
    return None


def pairs_of(asked: Question, usable: Sequence[Hypothesis], design: Design) -> list[Pair]:
    """Choose, for each two groups, the hypotheses that the recorded motions distinguish worst: these decide.

    Args:
        asked: What is to be distinguished.
        usable: All hypotheses, in the order of the design's columns.
        design: The motions as they were recorded.
    """
    found = []
    for k, own in enumerate(asked.groups):
        truths = [usable.index(h) for h in own if asked.at_amplitude or h.is_typical]
        for other in (group for j, group in enumerate(asked.groups) if j != k):
            trials = [Pair(truth, usable.index(rival)) for truth in truths for rival in other]
            found.append(min(trials, key=lambda pair: information(design, pair)))
    return found


def with_all_laws(pairs: Sequence[Pair], asked: Question, usable: Sequence[Hypothesis], design: Design) -> list[Pair]:
    """Add, for each law that may be there, the most similar hypothesis of every law that nobody asked about.

    A motion that distinguishes two laws may make a third one look like the first. Of settings of one law it is only
    asked which.
    """
    known = {hypothesis.effect for hypothesis in asked.hypotheses}
    if len(known) == 1:
        return list(pairs)
    others: dict[str, list[int]] = {}
    for k, hypothesis in enumerate(usable):
        if hypothesis.effect not in known and hypothesis.candidate.kind != "decoy":
            others.setdefault(hypothesis.effect, []).append(k)
    more = [
        min((Pair(truth, rival) for rival in rivals), key=lambda pair: information(design, pair))
        for truth in dict.fromkeys(pair.truth for pair in pairs)
        for rivals in others.values()
    ]
    return [*pairs, *more]
