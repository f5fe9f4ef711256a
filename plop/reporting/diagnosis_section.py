"""What was diagnosed: the ranking with its intervals, parameters, detection limits, sensors."""

from __future__ import annotations

import re
from typing import Any

from plop.law_values import also_text, with_unit
from plop.reporting.compared import Compared, ReportFacts
from plop.reporting.html import interval, number, short, table, text


def diagnosis_sections(facts: ReportFacts) -> str:
    """Show every diagnosis in turn."""
    return "".join(_one(label, found) for label, found in facts.diagnoses)


def _one(label: str, found: dict[str, Any]) -> str:
    closed = found.get("closed_share")
    # the verdict's sentence says it of what is named; beside a base parameter the best effect's share says nothing
    if found["verdict"]["named"]:
        closed = None
    share = "" if closed is None else f" The best effect closes {100 * min(closed, 1):.0f} % of the explainable gap."
    floor = "" if found.get("floor") is None else f" (in the reference recordings {number(found['floor'])})"
    says = (f"<p><b>{text(found['verdict']['kind'])}</b>. {text(found['verdict']['text'])}</p><p class='soft'>Mean "
            f"squared residual in units of its expectation: {number(found['error'])}{floor}.{share} "
            f"False alarms are judged by {found['shams']['count']} shams.</p>")  # fmt: skip
    return (f"<h2>What is missing in {text(label)}</h2>{says}{_ranking(found)}{_next(found)}{_sensors(found)}"
            f"{_limits(found)}{_dropped(found)}")  # fmt: skip


def _ranking(found: dict[str, Any]) -> str:
    base = [found["base"]] if found.get("base") else []
    rows = [*found["ranking"], *base]
    if not rows:
        return ""
    reach = max([row["gain"] + row["gain_error"] for row in rows] + [0.05])
    lowest = max(min([row["gain"] - row["gain_error"] for row in rows] + [0.0]), -0.5 * reach)
    cells, marked = [], []
    for place, row in enumerate(rows):
        named = row["effect"] in found["verdict"]["named"]
        marked += [place] if named else []
        kind = "" if row["kind"] == "physics" else f" <span class='soft'>({text(row['kind'])})</span>"
        name = f"<span title='{text(row.get('help', ''))}'>{text(row['effect'])}</span>{kind}"
        colour = "#0072b2" if named else "#8a8f96"
        cells.append([
            name, interval(row["gain"], row["gain_error"], lowest, reach, colour),
            f"{100 * row['gain']:.1f} ± {100 * row['gain_error']:.1f} %",
            "–" if row["p"] is None else f"{row['p']:.3f}", number(row.get("size_mm")),
            parameters_text(row["parameters"]),
            "<b>named</b>" if named else _why_not(row["reasons"]),
        ])  # fmt: skip
    head = ["effect", "gain", "share of held-out error", "p", "moves [mm]", "parameters, 95 % interval", "why not"]
    return "<h3>Ranking</h3>" + table(head, cells, numeric=(2, 3, 4), marked=marked)


def _why_not(reasons: list[str]) -> str:
    """Show the first reason and fold the others: a law that explains nothing fails every test."""
    if len(reasons) < 2:
        return text(reasons[0] if reasons else "passes, but another explains more")
    rest = "<br>".join(map(text, reasons[1:]))
    return f"<details><summary>{text(reasons[0])}, and {len(reasons) - 1} more</summary>{rest}</details>"


def parameters_text(parameters: dict[str, dict[str, Any]]) -> str:
    """Write parameters with intervals and units as HTML."""
    parts = []
    for name, p in parameters.items():
        known = p.get("low") is not None and p.get("high") is not None
        span = f" ({short(p['low'])} to {short(p['high'])})" if known else also_text(p) or " (no interval)"
        bound = ", at its bound" if p.get("at_bound") else ""
        parts.append(text(with_unit(f"{name} = {short(p['value'])}{span}", p.get("unit"))) + bound)
    return "<br>".join(parts)


def _next(found: dict[str, Any]) -> str:
    step = found.get("next_step")
    with_code = re.sub("`(.*?)`", r"<code>\1</code>", text(step)) if step else ""
    return f"<p><b>What to do next:</b> {with_code}</p>" if step else ""


def _sensors(found: dict[str, Any]) -> str:
    if found.get("sensors") is None:
        return "<h3>Sensors</h3><p>Sensor faults were not looked for.</p>"
    if not found["sensors"]:
        return "<h3>Sensors</h3><p>No sensor fault was found.</p>"
    rows = [[text(s["camera"]), text(s["fault"]), parameters_text(s.get("values", {}))] for s in found["sensors"]]
    return "<h3>Sensors</h3>" + table(["camera", "fault", "value, 95 % interval"], rows)


def _limits(found: dict[str, Any]) -> str:
    rows = []
    for effect, limit in found.get("limits", {}).items():
        least = limit.get("amplitude")
        size = limit.get("displacement_m")
        seen = with_unit(f"{limit.get('parameter', '')} {short(least)}", limit.get("unit"))
        cells = [text(effect), text(seen) if least is not None else "none in its range",
                 number(None if size is None else 1000 * size, 3)]  # fmt: skip
        rows.append((float("inf") if size is None else size, cells))
    if not rows:
        return ""
    ordered = [cells for _, cells in sorted(rows, key=lambda pair: pair[0])]
    body = table(["effect", "smallest that would have been named", "moves [mm]"], ordered, numeric=(2,))
    title = "Detection limits: what could have been seen in these recordings"
    return f"<details><summary>{title}</summary>{body}</details>"


def _dropped(found: dict[str, Any]) -> str:
    if not found.get("dropped"):
        return ""
    rows = [[text(name), text(why)] for name, why in found["dropped"].items()]
    return f"<details><summary>Left out</summary>{table(['what', 'why'], rows)}</details>"


def parameters_section(facts: ReportFacts) -> str:
    """List the parameters of every model with units and intervals: what was fitted first, what was given folded."""
    fitted = [row for compared in facts.compared for row in _fitted(compared)]
    given = [row for compared in facts.compared for row in _given(compared)]
    if not fitted and not given:
        return ""
    head = ["model", "part", "parameter", "value", "95 % interval", "unit"]
    shown = table(head, fitted, numeric=(3, 4)) if fitted else "<p>Nothing was fitted.</p>"
    if not given:
        return f"<h2>Parameters</h2>{shown}"
    folded = f"<details><summary>Given, not fitted</summary>{table(head, given, numeric=(3, 4))}</details>"
    return f"<h2>Parameters</h2>{shown}{folded}"


def _fitted(compared: Compared) -> list[list[str]]:
    model = compared.model or {}
    rows = [_parameter(compared.label, "engine", name, p) for name, p in model.get("estimates", {}).items()]
    for effect in model.get("effects", []):
        rows += [_parameter(compared.label, effect["effect"], name, p) for name, p in effect["parameters"].items()]
    return rows


def _given(compared: Compared) -> list[list[str]]:
    model = compared.model or {}
    fitted = model.get("estimates", {})
    values = model.get("engine", {}).get("material", {}) if model.get("kind") == "engine" else {}
    return [_parameter(compared.label, "engine", name, {"value": value, "unit": _unit(name)})
            for name, value in values.items() if isinstance(value, (int, float)) and name not in fitted]  # fmt: skip


def _parameter(label: str, part: str, name: str, p: dict[str, Any]) -> list[str]:
    low, high = p.get("low"), p.get("high")
    span = also_text(p).strip(" ()") or "–" if low is None or high is None else f"{short(low)} to {short(high)}"
    return [text(label), text(part), text(name), short(p["value"]), span, text(p.get("unit") or "-")]


def _unit(name: str) -> str:
    endings = {"_pa_s": "Pa s", "_pa": "Pa", "_kg_m3": "kg/m^3", "_per_s": "1/s", "_j_m2": "J/m^2"}
    return next((unit for ending, unit in endings.items() if name.endswith(ending)), "-")
