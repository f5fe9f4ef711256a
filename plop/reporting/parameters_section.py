"""Parameters with units and intervals; what the recordings do not determine is grey and says so."""

from __future__ import annotations

from collections.abc import Mapping

from plop.parameters import NOT_DETERMINED, Estimate, alternatives_text, with_unit
from plop.physics.calibration.gauss_newton import PARAMETERS
from plop.reporting.compared import Compared, ReportFacts
from plop.reporting.html import short, table, text

ENGINE = "engine"
"""What a parameter belongs to that is none of an effect."""


def parameters_text(parameters: Mapping[str, Estimate]) -> str:
    """Write parameters with intervals and units as HTML."""
    return "<br>".join(_one(name, found) for name, found in parameters.items())


def _one(name: str, found: Estimate) -> str:
    span = _interval(found, " ({})") or alternatives_text(found) or " (no interval)"
    bound = ", at its bound" if found.at_bound else ""
    written = text(with_unit(f"{name} = {short(found.value)}{span}", found.unit)) + bound
    return written if found.determined else f'<span class="open">{written}: {NOT_DETERMINED}</span>'


def _interval(found: Estimate, form: str = "{}") -> str:
    return form.format(f"{short(found.low)} to {short(found.high)}") if found.bounded else ""


def parameters_section(facts: ReportFacts) -> str:
    """List the parameters of every model with units and intervals: what was fitted first, what was given folded."""
    fitted = [row for compared in facts.compared for row in _fitted(compared)]
    given = [row for compared in facts.compared for row in _given(compared)]
    if not fitted and not given:
        return ""
    return f"<h2>Parameters</h2>{_table(fitted) if fitted else '<p>Nothing was fitted.</p>'}" + (
        f"<details><summary>Given, not fitted</summary>{_table(given)}</details>" if given else ""
    )


_HEAD = ["model", "part", "parameter", "value", "95 % interval", "unit", ""]


def _table(rows: list[tuple[list[str], bool]]) -> str:
    greyed = [place for place, (_, known) in enumerate(rows) if not known]
    head = _HEAD if greyed else _HEAD[:-1]
    cells = [[*row, *([NOT_DETERMINED if not known else ""] if greyed else [])] for row, known in rows]
    return table(head, cells, numeric=(3, 4), greyed=greyed, cards=True)


def _fitted(compared: Compared) -> list[tuple[list[str], bool]]:
    parts = [(ENGINE, compared.model.estimates), *compared.model.effects]
    return [_parameter(compared.label, part, name, found) for part, own in parts for name, found in own.items()]


def _given(compared: Compared) -> list[tuple[list[str], bool]]:
    declared = [(name, value, PARAMETERS.get(name)) for name, value in compared.model.given.items()]
    return [
        _parameter(compared.label, ENGINE, name, Estimate(value, unit=p.unit if p else "-", fitted=False))
        for name, value, p in declared
    ]


def _parameter(label: str, part: str, name: str, found: Estimate) -> tuple[list[str], bool]:
    span = _interval(found) or alternatives_text(found).strip(" ()") or "–"
    return [text(label), text(part), text(name), short(found.value), span, text(found.unit or "-")], found.determined
