"""What was diagnosed: the ranking with its intervals, detection limits, sensors."""

from __future__ import annotations

import re
from collections.abc import Sequence

from plop.diagnosis.finding import GAIN_LEAST, NO_HELP, explained_text
from plop.diagnosis.result import Diagnosis, Ranked
from plop.parameters import NOT_DETERMINED, with_unit
from plop.reporting.compared import ReportFacts
from plop.reporting.html import interval, number, short, table, text
from plop.reporting.parameters_section import parameters_text


def diagnosis_sections(facts: ReportFacts) -> str:
    """Show every diagnosis in turn."""
    return "".join(_one(label, found) for label, found in facts.diagnoses)


def _one(label: str, found: Diagnosis) -> str:
    closed = found.closed_share
    # the verdict's sentence says it of what is named; beside a base parameter the best effect's share says nothing
    told = closed is not None and closed > 0 and not found.verdict.named
    share = f" The best effect closes {100 * min(closed or 0, 1):.0f} % of the explainable gap." if told else ""
    floor = "" if found.floor is None else f" (in the reference recordings {number(found.floor)})"
    says = (
        f"<p><b>{text(found.verdict.kind)}</b>. {text(found.verdict.text)}</p><p class='soft'>Mean "
        f"squared residual in units of its expectation: {number(found.error)}{floor}.{share} "
        f"False alarms are judged by {found.shams.count} shams.</p>"
    )
    return (
        f"<h2>What is missing in {text(label)}</h2>{says}{_ranking(found)}{_next(found)}{_sensors(found)}"
        f"{_limits(found)}{_dropped(found)}"
    )


def _ranking(found: Diagnosis) -> str:
    named = found.verdict.named
    rows = [*found.ranking, found.base]
    idle = [row for row in found.ranking if row.gain <= 0 and row.effect not in named]
    told = [row for row in rows if all(row is not other for other in idle)]
    reach = min(max([row.gain + row.gain_error for row in rows if row.gain > 0] + [0.05]), 1.0)
    folded = ""
    if idle:
        summary = f"{NO_HELP.capitalize()}: {', '.join(row.effect for row in idle)}"
        folded = f"<details><summary>{text(summary)}</summary>{_table(idle, named, reach)}</details>"
    return f"<h3>Ranking</h3>{_RANKING_NOTE}{_table(told, named, reach)}{folded}"


def _table(rows: Sequence[Ranked], named: Sequence[str], reach: float) -> str:
    """Make a table of laws; those that take nothing away are grey."""
    head = ["effect", "", "explains", "p", "moves [mm]", "parameters, 95 % interval", "why not"]
    marked = [k for k, row in enumerate(rows) if row.effect in named]
    greyed = [k for k, row in enumerate(rows) if row.gain <= 0 and k not in marked]
    cells = [_ranked(row, reach, k in marked) for k, row in enumerate(rows)]
    return table(head, cells, numeric=(3, 4), marked=marked, greyed=greyed, cards=True)


def _ranked(row: Ranked, reach: float, named: bool) -> list[str]:
    kind = "" if row.kind == "physics" else f" <span class='soft'>({text(row.kind)})</span>"
    helps = row.gain > 0
    dot = interval(row.gain, row.gain_error, 0.0, reach, "#0072b2" if named else "#8a8f96") if helps else ""
    explains = explained_text(row.gain, row.gain_error)
    if not helps and row.alone > GAIN_LEAST:
        explains += f" once the stiffness is refitted, too ({100 * row.alone:.0f} % as the base is)"
    share = f"<span class='whole'>{text(explains)}</span>" if helps else text(explains)
    return [
        f"<span title='{text(row.help)}'>{text(row.effect)}</span>{kind}",
        dot,
        share,
        "–" if row.p is None else f"{row.p:.3f}",
        number(row.size_mm),
        parameters_text(row.parameters),
        "<b>named</b>" if named else "–" if not helps else _why_not(row.why_not()),
    ]


_RANKING_NOTE = (
    f"<p class='soft'>Explains: the share of the held-out squared error that goes away when the law is "
    f"added, with its standard error. “{NO_HELP.capitalize()}”: fitted to the other episodes, the law "
    f"makes the held-out ones no better, or worse. Grey parameters are {NOT_DETERMINED}.</p>"
)


def _why_not(reasons: list[str]) -> str:
    """Show the first reason and fold the others: a law that explains nothing fails every test."""
    if len(reasons) < 2:
        return text(reasons[0] if reasons else "passes, but another explains more")
    rest = "<br>".join(map(text, reasons[1:]))
    return f"<details><summary>{text(reasons[0])}, and {len(reasons) - 1} more</summary>{rest}</details>"


def _next(found: Diagnosis) -> str:
    with_code = re.sub("`(.*?)`", r"<code>\1</code>", text(found.next_step))
    return f"<p><b>What to do next:</b> {with_code}</p>" if found.next_step else ""


def _sensors(found: Diagnosis) -> str:
    if found.sensors is None:
        return "<h3>Sensors</h3><p>Sensor faults were not looked for.</p>"
    if not found.sensors:
        return "<h3>Sensors</h3><p>No sensor fault was found.</p>"
    rows = [[text(s.camera), text(s.fault), parameters_text(s.values)] for s in found.sensors]
    return "<h3>Sensors</h3>" + table(["camera", "fault", "value, 95 % interval"], rows, cards=True)


def _limits(found: Diagnosis) -> str:
    rows = []
    for effect, limit in found.limits.items():
        least, size = limit.amplitude, limit.displacement_m
        seen = with_unit(f"{limit.parameter} {short(least)}", limit.unit)
        cells = [
            text(effect),
            text(seen) if least is not None else "none in its range",
            number(None if size is None else 1000 * size, 3),
        ]
        rows.append((float("inf") if size is None else size, cells))
    if not rows:
        return ""
    ordered = [cells for _, cells in sorted(rows, key=lambda pair: pair[0])]
    body = table(["effect", "smallest that would have been named", "moves [mm]"], ordered, numeric=(2,))
    title = "Detection limits: what could have been seen in these recordings"
    return f"<details><summary>{title}</summary>{body}</details>"


def _dropped(found: Diagnosis) -> str:
    if not found.dropped:
        return ""
    rows = [[text(name), text(why)] for name, why in found.dropped.items()]
    return f"<details><summary>Left out</summary>{table(['what', 'why'], rows, cards=True)}</details>"
