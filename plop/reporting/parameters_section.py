"""Parameters with units and intervals; what the recordings do not determine is grey and says so."""

from __future__ import annotations

from typing import Any

from plop.parameters import also_text, with_unit
from plop.physics.calibration.gauss_newton import PARAMETERS
from plop.physics.effects.library import library
from plop.reporting.compared import Compared, ReportFacts
from plop.reporting.html import short, table, text
from plop.statistics.determined import NOT_DETERMINED, Allowed, determined

ENGINE = "engine"
"""What a parameter belongs to that is none of an effect."""


def is_determined(part: str, name: str, p: dict[str, Any]) -> bool:
    """Tell whether the recordings determine a number, as whatever fitted it says.

    Artifacts that were made before they said so are judged by the ranges of the engine and of the library that comes
    with plop. A number that was given, and not fitted, has no interval and counts as determined.
    """
    if "determined" in p:
        return bool(p["determined"])
    given = p.get("low") is None and p.get("high") is None and not p.get("also") and not p.get("chosen")
    if given and not p.get("at_bound") and part != ENGINE:
        return True
    return determined(name, p, _allowed(part, name))


def _allowed(part: str, name: str) -> Allowed | None:
    if part == ENGINE:
        own = PARAMETERS.get(name)
        return Allowed(own.low, own.high, own.step, own.logarithmic) if own else None
    kind = library(()).get(part)
    found = next((p for p in kind.parameters() if p.name == name), None) if kind else None
    if kind is None or found is None:
        return None
    return Allowed(found.low, found.high, abs(found.step), tried=len({v.get(name) for v in kind.variants}))


def parameters_text(parameters: dict[str, dict[str, Any]], part: str) -> str:
    """Write parameters with intervals and units as HTML.

    Args:
        parameters: Name -> value, interval and unit.
        part: The effect that they belong to.
    """
    return "<br>".join(_one(part, name, p) for name, p in parameters.items())


def _one(part: str, name: str, p: dict[str, Any]) -> str:
    known = p.get("low") is not None and p.get("high") is not None
    span = f" ({short(p['low'])} to {short(p['high'])})" if known else also_text(p) or " (no interval)"
    bound = ", at its bound" if p.get("at_bound") else ""
    found = text(with_unit(f"{name} = {short(p['value'])}{span}", p.get("unit"))) + bound
    return found if is_determined(part, name, p) else f'<span class="open">{found}: {NOT_DETERMINED}</span>'


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
    model = compared.model or {}
    rows = [_parameter(compared.label, ENGINE, name, p) for name, p in model.get("estimates", {}).items()]
    for effect in model.get("effects", []):
        rows += [_parameter(compared.label, effect["effect"], name, p) for name, p in effect["parameters"].items()]
    return rows


def _given(compared: Compared) -> list[tuple[list[str], bool]]:
    model = compared.model or {}
    fitted = model.get("estimates", {})
    values = model.get("engine", {}).get("material", {}) if model.get("kind") == "engine" else {}
    return [
        (_parameter(compared.label, ENGINE, name, {"value": value, "unit": _unit(name)})[0], True)
        for name, value in values.items()
        if isinstance(value, (int, float)) and name not in fitted
    ]


def _parameter(label: str, part: str, name: str, p: dict[str, Any]) -> tuple[list[str], bool]:
    low, high = p.get("low"), p.get("high")
    span = also_text(p).strip(" ()") or "–" if low is None or high is None else f"{short(low)} to {short(high)}"
    return (
        [text(label), text(part), text(name), short(p["value"]), span, text(p.get("unit") or "-")],
        is_determined(part, name, p),
    )


def _unit(name: str) -> str:
    endings = {"_pa_s": "Pa s", "_pa": "Pa", "_kg_m3": "kg/m^3", "_per_s": "1/s", "_j_m2": "J/m^2"}
    return next((unit for ending, unit in endings.items() if name.endswith(ending)), "-")
