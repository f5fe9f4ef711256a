"""The top of a report: the headline, where a baseline is better than a model, and the figures that carry it."""

from __future__ import annotations

from plop.diagnosis.finding import explained_text
from plop.diagnosis.verdict import VerdictKind
from plop.reporting.baselines import BASELINES, ORACLE, beaten
from plop.reporting.compared import Compared, ReportFacts
from plop.reporting.errors_over import closed_gap, error_over, judged_on
from plop.reporting.headline import headline
from plop.reporting.html import number, text

_QUIET = (VerdictKind.NOTHING_DETECTABLE, VerdictKind.NONE_OF_THESE)
_NOT_DIAGNOSED = "NOT DIAGNOSED"


def verdict_section(facts: ReportFacts) -> str:
    """Say what was found: the diagnosis of the first model, or, without one, where it fails most."""
    kind, sentence = _verdict(facts)
    quiet = " none" if kind in (*_QUIET, _NOT_DIAGNOSED) else ""
    more = "".join(
        f"<p>{text(label)} was diagnosed, too (<b>{text(d.verdict.kind)}</b>): {_unbroken(headline(label, d))}</p>"
        for label, d in facts.diagnoses[1:]
    )
    figures = "".join(f"<div><b>{_unbroken(value)}</b>{text(name)}</div>" for name, value in _figures(facts))
    return (
        f'<section class="verdict{quiet}" id="verdict"><b class="kind">{text(kind)}</b>'
        f'<p class="says">{_unbroken(sentence)}</p>{_beaten(facts)}{more}'
        f'<div class="facts">{figures}</div><p class="soft">{text(_held_out(facts))} {_shares(facts)}</p>'
        "</section>"
    )


def _unbroken(sentence: str) -> str:
    return text(sentence).replace(" %", "&nbsp;%").replace(" mm", "&nbsp;mm")


def _beaten(facts: ReportFacts) -> str:
    told = beaten(facts)
    if not told:
        return ""
    rows = "".join(f"<p>{_unbroken(sentence)}</p>" for sentence in told)
    return f'<div class="warning" id="beaten"><b>A baseline is better</b>{rows}<p class="soft">{text(ORACLE)}</p></div>'


def _verdict(facts: ReportFacts) -> tuple[str, str]:
    if facts.diagnoses:
        label, diagnosis = facts.diagnoses[0]
        return diagnosis.verdict.kind, headline(label, diagnosis)
    return _NOT_DIAGNOSED, worst(facts.compared[0])


def worst(compared: Compared) -> str:
    """Say in one sentence how far a model is off, where most, and that nobody has asked why."""
    tables = compared.errors.tables
    episode, phase = (max(rows, key=lambda row: row.rms_mm) for rows in (tables.episode, tables.phase))
    whole = tables.whole
    times = f", {whole.rms_mm / whole.floor_mm:.1f} times what noise explains" if whole.floor_mm > 0 else ""
    return (
        f"The model {compared.label} is off by {number(whole.rms_mm)} mm{times}, most in episode "
        f"{episode.label} ({number(episode.rms_mm)} mm) and in the phase {phase.label} "
        f"({number(phase.rms_mm)} mm), and what it is missing has not been looked for (plop diagnose "
        "does)."
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
        free = f" Neither fitted to nor kept for the test: {', '.join(rest)}." if rest else ""
        which = ", ".join(fitted) if rest else "all of them"
        return (
            f"None of these episodes was held out: {which} took part in a fit, so that the error in new recordings "
            f"may be larger.{free}"
        )
    return "Which of these episodes were held out of the fit is not known here."


def _shares(facts: ReportFacts) -> str:
    """Say what the percentages of a diagnosis are shares of."""
    if not facts.diagnoses:
        return ""
    return (
        "Errors in mm are RMS; what a law explains is a share of the squared error, in episodes that its strength "
        "was not fitted to."
    )


def _figures(facts: ReportFacts) -> list[tuple[str, str]]:
    episodes, name = judged_on(facts)
    before, after = (error_over(c, episodes) for c in (facts.compared[0], facts.compared[-1]))
    figures: list[tuple[str, str]] = []
    if before is None or after is None:
        return figures
    if len(facts.compared) > 1:
        figures.append(
            (
                f"error on {name}, {facts.compared[0].label} to {facts.compared[-1].label}",
                f"{number(before['rms'])} → {number(after['rms'])} mm",
            )
        )
        figures.append(("of the way from there to the noise floor", gap_text(closed_gap(before, after))))
    else:
        figures.append((f"error on {name}, RMS", f"{number(before['rms'])} mm"))
        times = before["rms"] / before["floor"] if before["floor"] else None
        figures.append(("times the noise floor", number(times, 1)))
    figures += [(baseline.label, f"{number(before[baseline.key])} mm") for baseline in BASELINES]
    figures.append(("noise floor", f"{number(before['floor'])} mm"))
    return figures + _diagnosis_figures(facts)


def gap_text(share: float | None) -> str:
    """Write how much of the way to the noise floor is gone; an error that has grown is not a negative share."""
    return "–" if share is None else "worse" if share < 0 else f"{100 * share:.0f} %"


def _diagnosis_figures(facts: ReportFacts) -> list[tuple[str, str]]:
    if not facts.diagnoses:
        return []
    found = facts.diagnoses[0][1]
    named = next((row for row in (*found.ranking, found.base) if row.effect in found.verdict.named), None)
    if named is None or named.gain <= 0:
        return []
    p = "" if named.p is None else f", p = {named.p:.3f}"
    return [(f"of the held-out error explained by {named.effect}{p}", explained_text(named.gain, named.gain_error))]
