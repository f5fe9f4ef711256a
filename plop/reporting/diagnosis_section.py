"""What was diagnosed: the ranking with its intervals, parameters, detection limits, sensors."""

from __future__ import annotations

from typing import Any

from plop.reporting.compared import Compared, ReportFacts
from plop.reporting.html import interval, number, short, table, text

_SHOWN = 12


def diagnosis_sections(facts: ReportFacts) -> str:
    """Show every diagnosis in turn."""
    return "".join(_one(label, found) for label, found in facts.diagnoses)


def _one(label: str, found: dict[str, Any]) -> str:
    closed = found.get("closed_share")
    share = "" if closed is None else f" The best effect closes {100 * min(closed, 1):.0f} % of the explainable gap."
    floor = "" if found.get("floor") is None else f" (in the reference recordings {number(found['floor'])})"
    says = (f"<p><b>{text(found['verdict']['kind'])}</b>. {text(found['verdict']['text'])}</p><p class='soft'>Mean squared "
            f"residual in units of its expectation: {number(found['error'])}{floor}.{share} "
            f"False alarms are judged by {found['shams']['count']} shams.</p>")  # fmt: skip
    return (f"<h2>What is missing in {text(label)}</h2>{says}{_ranking(found)}{_next(found)}{_sensors(found)}"
            f"{_limits(found)}{_dropped(found)}")  # fmt: skip


def _ranking(found: dict[str, Any]) -> str:
    base = [found["base"]] if found.get("base") else []
    rows = [*found["ranking"][:_SHOWN], *base]
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
            "<b>named</b>" if named else text("; ".join(row["reasons"]) or "passes, but another explains more"),
        ])  # fmt: skip
    head = ["effect", "gain", "share of held-out error", "p", "moves [mm]", "parameters, 95 % interval", "why not"]
    return "<h3>Ranking</h3>" + table(head, cells, numeric=(2, 3, 4), marked=marked)


def parameters_text(parameters: dict[str, dict[str, Any]]) -> str:
    """Write parameters with intervals and units as HTML."""
    parts = []
    for name, p in parameters.items():
        known = p.get("low") is not None and p.get("high") is not None
        span = f" ({short(p['low'])} to {short(p['high'])})" if known else " (no interval)"
        bound = ", at its bound" if p.get("at_bound") else ""
        parts.append(f"{text(name)} = {short(p['value'])}{span} {text(p.get('unit') or '')}{bound}".strip())
    return "<br>".join(parts)


def _next(found: dict[str, Any]) -> str:
    wish = found.get("next_motion")
    return f"<p><b>What to record next:</b> {text(wish['text'])}</p>" if wish else ""


def _sensors(found: dict[str, Any]) -> str:
    if not found.get("sensors"):
        return "<h3>Sensors</h3><p>No sensor fault was found.</p>"
    rows = [[text(s["camera"]), text(s["fault"]), parameters_text(s.get("values", {}))] for s in found["sensors"]]
    return "<h3>Sensors</h3>" + table(["camera", "fault", "value, 95 % interval"], rows)


def _limits(found: dict[str, Any]) -> str:
    rows = []
    for effect, limit in found.get("limits", {}).items():
        least = limit.get("amplitude")
        size = limit.get("displacement_m")
        name = limit.get("parameter", "")
        seen = "cannot be seen in these recordings" if least is None else f"{text(name)} {short(least)} {text(limit.get('unit', ''))}"
        rows.append((float("inf") if size is None else size, [text(effect), seen, number(None if size is None else 1000 * size, 3)]))
    if not rows:
        return ""
    body = table(["effect", "smallest that would have been named", "moves [mm]"],
                 [row for _, row in sorted(rows, key=lambda pair: pair[0])], numeric=(2,))  # fmt: skip
    return f"<details><summary>Detection limits: what could have been seen in these recordings</summary>{body}</details>"


def _dropped(found: dict[str, Any]) -> str:
    if not found.get("dropped"):
        return ""
    rows = [[text(name), text(why)] for name, why in found["dropped"].items()]
    return f"<details><summary>Left out</summary>{table(['what', 'why'], rows)}</details>"


def parameters_section(facts: ReportFacts) -> str:
    """List the parameters of every model with units and intervals."""
    rows = [row for compared in facts.compared for row in _model_rows(compared)]
    if not rows:
        return ""
    head = ["model", "part", "parameter", "value", "95 % interval", "unit"]
    return "<h2>Parameters</h2>" + table(head, rows, numeric=(3, 4))


def _model_rows(compared: Compared) -> list[list[str]]:
    if compared.model is None:
        return []
    model, rows = compared.model, []
    material = {**model.get("engine", {}).get("material", {})}
    for name, estimate in model.get("estimates", {}).items():
        material.pop(name, None)
        rows.append(_parameter(compared.label, "engine, fitted", name, estimate))
    for name, value in material.items():
        if isinstance(value, (int, float)):
            rows.append(_parameter(compared.label, "engine, given", name, {"value": value, "unit": _unit(name)}))
    for effect in model.get("effects", []):
        rows += [_parameter(compared.label, effect["effect"], name, p) for name, p in effect["parameters"].items()]
    return rows


def _parameter(label: str, part: str, name: str, p: dict[str, Any]) -> list[str]:
    low, high = p.get("low"), p.get("high")
    span = "–" if low is None or high is None else f"{short(low)} to {short(high)}"
    return [text(label), text(part), text(name), short(p["value"]), span, text(p.get("unit") or "-")]


def _unit(name: str) -> str:
    endings = {"_pa_s": "Pa s", "_pa": "Pa", "_kg_m3": "kg/m^3", "_per_s": "1/s", "_j_m2": "J/m^2"}
    return next((unit for ending, unit in endings.items() if name.endswith(ending)), "-")
