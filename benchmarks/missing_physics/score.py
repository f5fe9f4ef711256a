"""How often the verdicts are right: from rows to docs/results/*.json.

What docs/results/physics*.json hold is made here and nowhere else; goals stand in them beside the rates.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.missing_physics.plan import DEVELOPED
from benchmarks.missing_physics.row import Group, Row
from plop.artifacts.atomic_file import write_json
from plop.pipeline.execute import versions


@dataclass(frozen=True)
class Goal:
    """What a rate or a median shall be, 0 to 1."""

    low: float = 0.0
    high: float = 1.0

    def __str__(self) -> str:
        """Give it as tables show it."""
        if self.high == 1:
            return f">= {100 * self.low:g} %"
        return f"<= {100 * self.high:g} %" if self.low == 0 else f"{100 * self.low:g} to {100 * self.high:g} %"

    def reached(self, value: float | None) -> bool | None:
        """Tell whether a value meets it, to the whole per cent that tables show; None where it was not run."""
        return None if value is None else self.low <= round(value, 2) <= self.high


GOALS = {
    ("single", "top1"): Goal(0.9),
    ("single", "in_set"): Goal(0.95),
    ("null", "false_alarm"): Goal(high=0.02),
    ("outside", "none_or_partly"): Goal(0.8),
    ("pairs", "both_in_turn"): Goal(0.7),
    ("pairs", "one"): Goal(0.95),
    ("sensor", "called_physics"): Goal(high=0.05),
    ("decoys", "chosen"): Goal(high=0.02),
    ("parameter_error", "covered"): Goal(0.9, 0.98),
    ("parameter_error", "median"): Goal(high=0.1),
    ("gap_closed", "median"): Goal(0.8),
    ("wrong_law", "median"): Goal(high=0.2),
}
"""Rate or median -> what it should be, where there is a goal."""
LEAST_SNR = 2.0
"""From which on single laws count for the goals: RMS displacement over the noise."""
Test = Callable[[Row], Any]


def wilson(hits: int, n: int) -> dict[str, Any]:
    """Give a rate with its 95 % interval (Wilson 1927)."""
    if n == 0:
        return {"rate": None, "low": None, "high": None, "n": 0}
    z, p = 1.96, hits / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    return {"rate": p, "low": max(0.0, middle - half), "high": min(1.0, middle + half), "n": n}


def _rate(rows: list[Row], test: Test) -> dict[str, Any]:
    return wilson(sum(bool(test(row)) for row in rows), len(rows))


def _median(values: list[float]) -> dict[str, Any]:
    return {"median": float(np.median(values)) if values else None, "n": len(values)}


def verdict_rates(rows: Iterable[Row]) -> dict[str, Any]:
    """Count how often the verdict was right, by group; what no amplitude could make visible is left out."""
    rows = [row for row in rows if row.set is not Group.UNREACHABLE]
    groups = {group: [row for row in rows if row.set is group] for group in Group}
    pairs, outside, null = groups[Group.PAIR], groups[Group.OUTSIDE], groups[Group.NULL]
    return {
        **_single_rates(groups[Group.SINGLE]),
        "null": {
            "false_alarm": _rate(null, lambda r: r.names_something),
            "none_of_these": _rate(null, lambda r: r.verdict == "NONE OF THESE"),
        },
        "base": {"named": _rate(groups[Group.BASE], lambda r: r.some_is_hidden)},
        "outside": {
            "none_or_partly": _rate(outside, lambda r: r.verdict in ("NONE OF THESE", "PARTLY")),
            "full_name": _rate(outside, lambda r: r.verdict in ("EFFECT", "CONFOUNDED")),
        },
        "pairs": {
            "both": _rate(pairs, lambda r: {*r.hidden} <= {*r.named}),
            "one": _rate(pairs, lambda r: r.some_is_hidden),
            "both_in_turn": _rate(
                [r for r in pairs if r.next_named is not None],
                lambda r: {*r.hidden} <= {*r.named, *(r.next_named or ())},
            ),
        },
        "decoys": {
            "chosen": _rate(rows, lambda r: {*r.named} & {"drag", "inertia"}),
            "called_physics": _rate(groups[Group.DECOY], lambda r: r.verdict in ("EFFECT", "PARTLY")),
        },
        "sensor": {
            "called_physics": _rate(groups[Group.SENSOR], lambda r: r.names_something),
            "stopped": _rate(groups[Group.SENSOR], lambda r: r.verdict == "SENSOR"),
        },
    }


def _single_rates(single: list[Row]) -> dict[str, Any]:
    """Count runs in which one law is hidden, and measure what its name is worth where it was named first."""
    strong = [row for row in single if row.snr >= LEAST_SNR]
    visible = [row for row in single if row.snr >= 1]
    named = [row.amplitude() for row in single if row.names_something and row.first_is_hidden]
    covered = [held for _, each in named for held in each]
    closed = [row.gap_closed() for row in single if row.names_something and row.first_is_hidden]
    wrong = [row.closed_by_wrong_law() for row in single]

    def first(rows: list[Row]) -> dict[str, Any]:
        return _rate(rows, lambda r: r.first_is_hidden)

    return {
        "recovery": {
            "snr_2_and_more": first(strong),
            "snr_1_to_2": first([row for row in visible if row.snr < 2]),
            "snr_below_1": first([row for row in single if row.snr < 1]),
        },
        "single": {
            "least_snr": LEAST_SNR,
            "top1": first(strong),
            "in_set": _rate(strong, lambda r: r.some_is_hidden),
            "from_snr_1_top1": first(visible),
            "from_snr_1_in_set": _rate(visible, lambda r: r.some_is_hidden),
            "ranked_first": _rate(visible, lambda r: r.ranks and r.ranks[0] == 1),
            "all_amplitudes_top1": first(single),
            "wrong_name": _rate(single, lambda r: r.named and not r.some_is_hidden),
        },
        "gap_closed": _median([share for share in closed if share is not None]),
        "wrong_law": _median([share for share in wrong if share is not None]),
        "parameter_error": {**_median([off for off, _ in named]), "covered": wilson(sum(covered), len(covered))},
    }


def other_rates(rows: Iterable[Row]) -> dict[str, Any]:
    """Count what other methods make of the same evidence."""
    told = [(row, row.baselines) for row in rows if row.baselines is not None]
    single, null = ([(r, b) for r, b in told if r.set is group] for group in (Group.SINGLE, Group.NULL))
    visible = [(r, b) for r, b in single if r.snr >= 1]
    shares = [b["residual_error_share"] for _, b in single]

    def rate(pairs: list[tuple[Row, dict[str, Any]]], method: str, test: Callable[[Row, list[Any]], Any]) -> Any:
        known = [(r, b[method]) for r, b in pairs if method in b]
        return wilson(sum(bool(test(r, said)) for r, said in known), len(known))

    def terms(said: list[list[str]]) -> set[str]:
        return {effect for term in said for effect in term}

    return {
        "bic_first": rate(visible, "bic", lambda r, said: said and said[0] in r.hidden),
        "bic_null_false_alarm": rate(null, "bic", lambda r, said: said),
        "sparse_first": rate(visible, "sparse", lambda r, said: said and said[0] in r.hidden),
        "sindy_first": rate(visible, "sindy", lambda r, said: terms(said[:1]) & {*r.hidden}),
        "sindy_among": rate(visible, "sindy", lambda r, said: terms(said) & {*r.hidden}),
        "sindy_null_false_alarm": rate(null, "sindy", lambda r, said: said),
        "residual_error_share": float(np.median(shares)) if shares else None,
    }


def confusion(rows: Iterable[Row]) -> dict[str, dict[str, int]]:
    """Count what was named first for each hidden effect."""
    table: dict[str, Counter[str]] = {}
    for row in rows:
        if row.set in (Group.SINGLE, Group.BASE, Group.DECOY, Group.NULL):
            hidden = next(iter(row.hidden), "nothing")
            table.setdefault(hidden, Counter())[row.named[0] if row.named else row.verdict.lower()] += 1
    return {key: dict(value) for key, value in sorted(table.items())}


def missed_faults(results: Path) -> dict[str, Any]:
    """Give the rate of single sensor faults that `diagnose` would not stop at, from sensor_faults.json.

    A fault that is found ends as SENSOR before any law is judged; one that is missed may be called physics.
    """
    path = results / "sensor_faults.json"
    if not path.is_file():
        return wilson(0, 0)
    found = json.loads(path.read_text())["rates"]
    rates = [found[f"{kind}_found"] for kind in ("clock", "depth_scale", "pose_shift", "pose_turn")]
    cameras = sum(rate["n"] for rate in rates)
    return wilson(cameras - round(sum(rate["rate"] * rate["n"] for rate in rates)), cameras)


def write_rows(path: Path, rows: list[Row], command: str, **facts: Any) -> None:
    """Write a result file; of each row what its folder alone keeps, the whole ranking, is left out."""
    found = {
        "command": command,
        "versions": versions(),
        "seeds": sorted({row.seed for row in rows}),
        **facts,
        "runs": [replace(row, ranking=None).to_json() for row in rows],
    }
    write_json(path, found, sort_keys=False)


def points_facts(rows: list[Row], results: Path) -> dict[str, Any]:
    """Score the rows on followed points, and once more those whose recordings did not shape the rules."""

    def scored(chosen: list[Row]) -> dict[str, Any]:
        return {**verdict_rates(chosen), "baselines": other_rates(chosen)}

    fresh = [row for row in rows if row.name not in DEVELOPED]
    sets = {**scored(rows), "sensor": {"called_physics": missed_faults(results)}}
    return {"sets": sets, "sets_after_rules_were_fixed": scored(fresh), "confusion": confusion(rows)}


def overview(cameras: Mapping[str, Any], points: Mapping[str, Any]) -> dict[str, Any]:
    """Give the content of physics.json: rates through cameras, and the other benchmark's beside them.

    Args:
        cameras: Content of physics_cameras.json.
        points: Content of physics_points.json.
    """
    chosen = _overview_of(cameras)
    # other methods were given an ideal tracker's points
    others = {**points["sets"]["baselines"], "measured_on": "followed points"}
    chosen["sets"] = {**chosen["sets"], "baselines": others}
    return {
        "command": "make bench-physics",
        "versions": cameras["versions"],
        "measured_on": "recordings through cameras",
        **chosen,
        "followed_points": _overview_of(points),
    }


def _overview_of(result: Mapping[str, Any]) -> dict[str, Any]:
    """Choose from one benchmark's file what concerns all of its runs."""
    rows = [Row.from_json(row) for row in result["runs"]]
    judges = [row.judged_by for row in rows if row.set is not Group.UNREACHABLE]
    return {
        "seeds": result["seeds"],
        "judged_by": {str(version): judges.count(version) for version in sorted({*judges}, key=lambda v: v or 0)},
        "sets": result["sets"],
        "confusion": confusion(rows),
    }
