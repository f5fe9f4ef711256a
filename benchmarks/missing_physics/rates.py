"""Rates of the third edition with their intervals, and whether they reach their goals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest
from scipy.stats import t as student

GOALS: dict[str, tuple[str, float]] = {
    "null_false_alarm": ("<=", 0.02),
    "dealt_false_alarm": ("<=", 0.02),
    "single_named_first": (">=", 0.9),
    "single_in_named_set": (">=", 0.95),
    "base_parameter_named": (">=", 0.9),
    "outside_none_or_partly": (">=", 0.8),
    "pairs_both": (">=", 0.7),
    "sensor_called_physics": ("<=", 0.05),
    "decoy_named": ("<=", 0.02),
    "interval_coverage": (">=", 0.9),
    "base_interval_coverage": (">=", 0.9),
}


_PHYSICS = ("EFFECT", "CONFOUNDED", "PARTLY", "BASE PARAMETER")


def proportion(hits: int, n: int) -> dict[str, Any]:
    """Give a rate with its 95 % interval (Clopper & Pearson 1934)."""
    if n == 0:
        return {"rate": None, "low": None, "high": None, "n": 0}
    interval = binomtest(hits, n).proportion_ci(0.95)
    return {"rate": hits / n, "low": float(interval.low), "high": float(interval.high), "n": n}


def rates_of(rows: Sequence[Mapping[str, Any]], scenario: str) -> dict[str, Any]:
    """Count, with 95 % intervals; a goal is shown only by its one-sided 95 % bound."""
    rows = [row for row in rows if scenario in row["said"]]

    def said(row: Mapping[str, Any]) -> Mapping[str, Any]:
        return dict(row["said"][scenario]["verdict"])

    def rate(name: str, group: Sequence[Mapping[str, Any]], test: Callable[[Mapping[str, Any]], bool]) -> None:
        hits, count = sum(map(test, group)), len(group)
        found[name] = {**proportion(hits, count), "shown": False}
        if count:
            one_sided, (sign, goal) = binomtest(hits, count).proportion_ci(0.90), GOALS.get(name, (">=", 2.0))
            found[name]["shown"] = bool(one_sided.high <= goal if sign == "<=" else one_sided.low >= goal)

    found: dict[str, Any] = {}
    by = {g: [r for r in rows if r["group"] == g] for g in ("null", "single", "outside", "pair", "sensor")}
    laws = [r for r in by["single"] if r["law"] not in ("stiffness", "damping", "density")]
    base = [r for r in by["single"] if r["law"] in ("stiffness", "damping", "density")]
    rate("null_false_alarm", by["null"], lambda r: said(r)["kind"] != "NOTHING DETECTABLE")
    dealt = [r["dealt"] for r in by["null"] if r.get("dealt")] if scenario == "reference" else []
    found["dealt_false_alarm"] = _clustered(dealt, GOALS["dealt_false_alarm"][1])
    rate("single_named_first", laws, lambda r: said(r)["named"][:1] == [r["law"]])
    rate("single_in_named_set", laws, lambda r: r["law"] in said(r)["named"])
    rate("single_ranked_first", laws, lambda r: r["said"][scenario]["ranking"][0]["effect"] == r["law"])
    rate("single_wrong_name", laws, lambda r: bool(said(r)["named"]) and r["law"] not in said(r)["named"])
    rate("base_parameter_named", base, lambda r: r["law"] in said(r)["named"])
    rate("outside_none_or_partly", by["outside"], lambda r: said(r)["kind"] in ("NONE OF THESE", "PARTLY"))
    rate("outside_wrong_name", by["outside"], lambda r: said(r)["kind"] in {*_PHYSICS} - {"PARTLY"})
    rate("pairs_both", by["pair"], lambda r: {*r["law"].split("+")} <= {*said(r)["named"]})
    rate("sensor_called_physics", by["sensor"], lambda r: said(r)["kind"] in _PHYSICS)
    rate("sensor_found", by["sensor"], lambda r: said(r)["kind"] == "SENSOR")
    rate("decoy_named", list(rows), lambda r: bool({*said(r)["named"]} & {"drag", "inertia"}))
    held = [h for r in by["single"] if said(r)["named"][:1] == [r["law"]] for h in _held(r, scenario)]
    rate("interval_coverage", [{"held": h} for h in held], lambda r: bool(r["held"]))
    bases = {(r["world"], r["seed"]): r["base"] for r in rows if "base" in r}
    held = [h for base in bases.values() for h in _base_held(base)]
    rate("base_interval_coverage", [{"held": h} for h in held], lambda r: bool(r["held"]))
    errors = [e for r in by["single"] if said(r)["named"][:1] == [r["law"]] for e in _errors(r, scenario)]
    found["parameter_error"] = {"median": float(np.median(errors)) if errors else None, "n": len(errors)}
    closed = [(said(r)["evidence"].get("closed") or 0.0) if r["law"] in said(r)["named"] else 0.0 for r in by["single"]]
    found["difference_closed"] = {"median": float(np.median(closed)) if closed else None, "n": len(closed)}
    return found


def _clustered(sets: Sequence[Sequence[bool]], goal: float) -> dict[str, Any]:
    """Share of ways, with an interval by the scatter between sets (t distribution): ways of one set are alike."""
    if len(sets) < 2:
        return {"rate": None, "n": len(sets), "shown": False}
    each = np.array([np.mean(s) for s in sets])
    error = each.std(ddof=1) / np.sqrt(len(each))
    low, high, one = (each.mean() + student.ppf(q, len(each) - 1) * error for q in (0.025, 0.975, 0.95))
    shown = bool(one <= goal and error > 0)
    facts = {"rate": float(each.mean()), "low": max(float(low), 0.0), "high": float(high), "n": len(sets)}
    return {**facts, "ways": sum(map(len, sets)), "shown": shown}


def _held(row: Mapping[str, Any], scenario: str) -> list[bool]:
    parameters = row["said"][scenario]["ranking"][0]["parameters"]
    wanted = row["truth"].get(row["law"], {})
    known = {k: parameters[k] for k in wanted if k in parameters and parameters[k]["low"] is not None}
    return [p["low"] <= wanted[k] <= p["high"] for k, p in known.items()]


def _base_held(base: Mapping[str, Any]) -> list[bool]:
    """Tell of each of the base's parameters whether the interval of `identify` contains the declared value."""
    return [
        (e["low"] is None or e["low"] <= value) and (e["high"] is None or value <= e["high"])
        for name, value in base["declared"].items()
        for e in [base["estimates"][name]]
    ]


def _errors(row: Mapping[str, Any], scenario: str) -> list[float]:
    parameters, wanted = row["said"][scenario]["ranking"][0]["parameters"], row["truth"].get(row["law"], {})
    if not wanted or not all(k in parameters for k in wanted):
        return []
    off = np.sqrt(sum((parameters[k]["value"] - v) ** 2 for k, v in wanted.items()))
    return [float(off / max(np.sqrt(sum(v**2 for v in wanted.values())), 1e-12))]


def rivals_of(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Count what other methods name first, and how often they name something where nothing is hidden."""
    found = {}
    single, null = ([r for r in rows if r["group"] == g and "rivals" in r] for g in ("single", "null"))
    for method in ("bic", "sparse", "correlation"):
        found[method] = {
            "single_named_first": {
                "rate": sum(r["rivals"][method][:1] == [r["law"]] for r in single) / max(len(single), 1),
                "n": len(single),
            },
            "null_false_alarm": {
                "rate": sum(bool(r["rivals"][method]) for r in null) / max(len(null), 1),
                "n": len(null),
            },
        }
    return found
