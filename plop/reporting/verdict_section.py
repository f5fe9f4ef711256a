"""The top of a report: the headline, where a baseline is better than a model, and the figures behind it."""

from __future__ import annotations

from dataclasses import dataclass

from plop.diagnosis.decision.finding import explained_text
from plop.diagnosis.decision.verdict import VerdictKind
from plop.reporting.baselines import BASELINES, beaten
from plop.reporting.compared import Compared, ReportFacts
from plop.reporting.errors_over import closed_gap, error_over, judged_on
from plop.reporting.headline import headline
from plop.reporting.numbers import number, percent

_QUIET = (VerdictKind.NOTHING_DETECTABLE, VerdictKind.NONE_OF_THESE)
_NOT_DIAGNOSED = "NOT DIAGNOSED"


@dataclass(frozen=True)
class Finding:
    """One diagnosis in a sentence."""

    label: str
    """The model that it is of."""
    kind: str
    sentence: str


@dataclass(frozen=True)
class Figure:
    """A number with what it is."""

    value: str
    name: str


@dataclass(frozen=True)
class VerdictSection:
    """What stands at the top."""

    first: Finding
    quiet: bool
    """Nothing is named."""
    others: list[Finding]
    beaten: list[str]
    figures: list[Figure]
    held_out: str


def verdict_section(facts: ReportFacts) -> VerdictSection:
    """Say what was found: the diagnosis of the first model, or, without one, where it fails most."""
    found = [Finding(label, d.verdict.kind, headline(label, d)) for label, d in facts.diagnoses]
    if not found:
        found = [Finding(facts.compared[0].label, _NOT_DIAGNOSED, worst(facts.compared[0]))]
    quiet = found[0].kind in (*_QUIET, _NOT_DIAGNOSED)
    return VerdictSection(found[0], quiet, found[1:], beaten(facts), _figures(facts), _held_out(facts))


def worst(compared: Compared) -> str:
    """Say in one sentence how far a model is off, where most, and that nobody has asked why."""
    tables = compared.errors.tables
    episode, phase = (max(rows, key=lambda row: row.rms_mm) for rows in (tables.episode, tables.phase))
    whole = tables.whole
    times = f", {whole.rms_mm / whole.floor_mm:.1f} times what noise explains" if whole.floor_mm > 0 else ""
    return (
        f"The model {compared.label} is off by {number(whole.rms_mm)} mm{times}, most in episode "
        f"{episode.label} ({number(episode.rms_mm)} mm) and in the phase {phase.label} "
        f"({number(phase.rms_mm)} mm), and what it is missing was not looked for (plop "
        "diagnose does that)."
    )


def _held_out(facts: ReportFacts) -> str:
    """Say which episodes these figures are of, and whether anything was fitted to them."""
    every, _ = judged_on(ReportFacts("", facts.compared))
    fitted = [name for name in every if name in facts.fitted]
    if facts.held_out:
        others = f"; fitted to: {', '.join(fitted)}" if fitted else ""
        return f"Held out of every fit: {', '.join(facts.held_out)}{others}."
    if fitted:
        rest = [name for name in every if name not in fitted]
        free = f" Neither fitted to nor held out: {', '.join(rest)}." if rest else ""
        which = ", ".join(fitted) if rest else "all of them"
        return (
            f"None of these episodes was held out: {which} took part in a fit, so the error on new recordings may be "
            f"larger.{free}"
        )
    return "It is not known which of these episodes were held out of the fit."


def _figures(facts: ReportFacts) -> list[Figure]:
    episodes, name = judged_on(facts)
    before, after = (error_over(c, episodes) for c in (facts.compared[0], facts.compared[-1]))
    if before is None or after is None:
        return []
    if len(facts.compared) > 1:
        models = f"{facts.compared[0].label} to {facts.compared[-1].label}"
        figures = [
            Figure(f"{number(before['rms'])} → {number(after['rms'])} mm", f"RMS error on {name}, {models}"),
            Figure(gap_text(closed_gap(before, after)), "of the gap to the noise floor closed"),
        ]
    else:
        times = before["rms"] / before["floor"] if before["floor"] else None
        figures = [
            Figure(f"{number(before['rms'])} mm", f"RMS error on {name}"),
            Figure(number(times, 1), "times the noise floor"),
        ]
    baselines = [Figure(f"{number(before[b.key])} mm", f"baseline: {b.label}") for b in BASELINES]
    return [*figures, *_explained(facts), *baselines, Figure(f"{number(before['floor'])} mm", "noise floor")]


def gap_text(share: float | None) -> str:
    """Write how much of the gap to the noise floor is closed; an error that has grown is not a negative share."""
    return "–" if share is None else "worse" if share < 0 else percent(share)


def _explained(facts: ReportFacts) -> list[Figure]:
    for _, found in facts.diagnoses[:1]:
        for named in found.named[:1]:
            if named.gain > 0:
                p = f", p = {named.p:.3f}"
                name = f"of the held-out error explained by {named.effect}{p}"
                return [Figure(explained_text(named.gain, named.gain_error), name)]
    return []
