"""Tables and docs/results/physics_points.json from the runs of the missing-physics benchmark."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.goals import ShareGoal
from benchmarks.physics_plan import DEVELOPED
from benchmarks.physics_rows import amplitude_of, closed_by_wrong_law, gap_closed
from plop.metrics.table import replace_between_markers
from plop.pipeline.execute import versions

RESULT = "physics_points"
"""Name of the file of the benchmark's own result."""
GOALS = {
    ("single", "top1"): ShareGoal(0.9),
    ("single", "in_set"): ShareGoal(0.95),
    ("null", "false_alarm"): ShareGoal(high=0.02),
    ("outside", "none_or_partly"): ShareGoal(0.8),
    ("pairs", "both_in_turn"): ShareGoal(0.7),
    ("pairs", "one"): ShareGoal(0.95),
    ("sensor", "called_physics"): ShareGoal(high=0.05),
    ("decoys", "chosen"): ShareGoal(high=0.02),
    ("parameter_error", "covered"): ShareGoal(0.9, 0.98),
}
"""Rate -> what it should be, where there is a goal."""
BASELINE = "baseline"
"""What stands in place of a goal beside another method's rate; all of the group baselines."""
MEDIANS = (
    ("median error of the parameter", "parameter_error", ShareGoal(high=0.1)),
    ("explainable gap closed, median", "gap_closed", ShareGoal(0.8)),
    ("the best of the wrong laws closes, median", "wrong_law", ShareGoal(high=0.2)),
)
"""What a median is called, where it is found, and its goal."""
LEAST_SNR = 2.0
"""From which on single laws count for the goals: RMS displacement over the noise."""
_NAMING = ("EFFECT", "CONFOUNDED", "PARTLY", "BASE PARAMETER")


def wilson(hits: int, n: int) -> dict[str, Any]:
    """Give a rate with its 95 % interval (Wilson 1927)."""
    if n == 0:
        return {"rate": None, "low": None, "high": None, "n": 0}
    z, p = 1.96, hits / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    return {"rate": p, "low": max(0.0, middle - half), "high": min(1.0, middle + half), "n": n}


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Count what the benchmark's table asks for, baselines included."""
    single = [r for r in rows if r["set"] == "single"]
    return {
        **verdict_rates(rows),
        "baselines": _baseline_rates(
            [r for r in single if r["snr"] >= 1], [r for r in rows if r["set"] == "null"], single
        ),
    }


def _rate(group: list[dict[str, Any]], test: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    return wilson(sum(bool(test(r)) for r in group), len(group))


def _baseline_rates(
    visible: list[dict[str, Any]], null: list[dict[str, Any]], single: list[dict[str, Any]]
) -> dict[str, Any]:
    return {
        "bic_first": _rate(visible, lambda r: r["baselines"]["bic"][:1] and r["baselines"]["bic"][0] in r["hidden"]),
        "bic_null_false_alarm": _rate(null, lambda r: r["baselines"]["bic"]),
        "sparse_first": _rate(
            visible, lambda r: r["baselines"]["sparse"][:1] and r["baselines"]["sparse"][0] in r["hidden"]
        ),
        "sindy_first": _rate(
            [r for r in visible if "sindy" in r["baselines"]],
            lambda r: set(sum(r["baselines"]["sindy"][:1], [])) & set(r["hidden"]),
        ),
        "sindy_among": _rate(
            [r for r in visible if "sindy" in r["baselines"]],
            lambda r: set(sum(r["baselines"]["sindy"], [])) & set(r["hidden"]),
        ),
        "sindy_null_false_alarm": _rate(
            [r for r in null if "sindy" in r["baselines"]], lambda r: r["baselines"]["sindy"]
        ),
        "residual_error_share": float(np.median([r["baselines"]["residual_error_share"] for r in single]))
        if single
        else None,
    }


def verdict_rates(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Count how often the verdict was right, by set; what no amplitude could make visible is left out."""
    rows = [r for r in rows if r["set"] != "unreachable"]
    names = ("single", "null", "base", "decoy", "pair", "outside", "sensor")
    sets = {name: [r for r in rows if r["set"] == name] for name in names}
    single, rate = sets["single"], _rate
    visible = [r for r in single if r["snr"] >= 1]
    loud = [r for r in single if r["snr"] >= LEAST_SNR]
    faint = [r for r in single if r["snr"] < 1]
    named = [r for r in single if r["named"] and r["verdict"] in _NAMING and r["named"][0] in r["hidden"]]

    def first(r: dict[str, Any]) -> bool:
        return bool(r["named"]) and r["named"][0] in r["hidden"]

    def inside(r: dict[str, Any]) -> bool:
        return bool(set(r["named"]) & set(r["hidden"]))

    errors, covered = [], []
    for r in named:
        error, inside_each = amplitude_of(r)
        errors.append(error)
        covered += inside_each
    closed = [share for r in named if (share := gap_closed(r, r["left"])) is not None]
    wrongly = [share for r in single if (share := closed_by_wrong_law(r)) is not None]
    return {
        "recovery": {
            "snr_2_and_more": rate(loud, first),
            "snr_1_to_2": rate([r for r in visible if r["snr"] < 2], first),
            "snr_below_1": rate(faint, first),
        },
        "single": {
            "least_snr": LEAST_SNR,
            "top1": rate(loud, first),
            "in_set": rate(loud, inside),
            "from_snr_1_top1": rate(visible, first),
            "from_snr_1_in_set": rate(visible, inside),
            "ranked_first": rate(visible, lambda r: r["ranks"] and r["ranks"][0] == 1),
            "all_amplitudes_top1": rate(single, first),
            "wrong_name": rate(single, lambda r: r["named"] and not inside(r)),
        },
        "null": {
            "false_alarm": rate(sets["null"], lambda r: r["verdict"] in _NAMING),
            "none_of_these": rate(sets["null"], lambda r: r["verdict"] == "NONE OF THESE"),
        },
        "base": {"named": rate(sets["base"], inside)},
        "outside": {
            "none_or_partly": rate(sets["outside"], lambda r: r["verdict"] in ("NONE OF THESE", "PARTLY")),
            "full_name": rate(sets["outside"], lambda r: r["verdict"] in ("EFFECT", "CONFOUNDED")),
        },
        "pairs": {
            "both": rate(sets["pair"], lambda r: set(r["hidden"]) <= set(r["named"])),
            "one": rate(sets["pair"], inside),
            "both_in_turn": rate(
                [r for r in sets["pair"] if "next_named" in r],
                lambda r: set(r["hidden"]) <= {*r["named"], *r["next_named"]},
            ),
        },
        "decoys": {
            "chosen": rate(rows, lambda r: set(r["named"]) & {"drag", "inertia"}),
            "called_physics": rate(sets["decoy"], lambda r: r["verdict"] in ("EFFECT", "PARTLY")),
        },
        "gap_closed": _median(closed),
        "wrong_law": _median(wrongly),
        "parameter_error": {**_median(errors), "covered": wilson(sum(covered), len(covered))},
        "sensor": {
            "called_physics": rate(sets["sensor"], lambda r: r["verdict"] in _NAMING),
            "stopped": rate(sets["sensor"], lambda r: r["verdict"] == "SENSOR"),
        },
    }


def _median(values: list[float]) -> dict[str, Any]:
    return {"median": float(np.median(values)) if values else None, "n": len(values)}


def confusion(rows: list[dict[str, Any]]) -> dict[str, dict[str, int]]:
    """Count what was named first for each hidden effect."""
    table: dict[str, Counter[str]] = {}
    for r in rows:
        if r["set"] in ("single", "base", "decoy", "null"):
            hidden = next(iter(r["hidden"]), "nothing")
            table.setdefault(hidden, Counter())[r["named"][0] if r["named"] else r["verdict"].lower()] += 1
    return {key: dict(value) for key, value in sorted(table.items())}


def sensor_faults_missed(out: Path) -> dict[str, Any]:
    """Give the rate of single sensor faults that `diagnose` would not stop at, from docs/results/sensors.json.

    A fault that is found ends as SENSOR before any law is judged; one that is missed may be called physics.
    """
    path = out / "results" / "sensors.json"
    if not path.is_file():
        return wilson(0, 0)
    rates = [entry["found"] for entry in json.loads(path.read_text())["single"].values()]
    cameras = sum(rate["n"] for rate in rates)
    return wilson(cameras - round(sum(rate["rate"] * rate["n"] for rate in rates)), cameras)


def write_results(
    rows: list[dict[str, Any]], out: Path, *, command: str, engine: dict[str, Any] | None = None, result: str = RESULT
) -> None:
    """Write results/<result>.json and the tables of results-physics.md between their markers.

    Markers are called rates, runs and confusion; those of another result than RESULT begin with its name and a hyphen.

    Args:
        rows: Of the runs.
        out: Folder with results-physics.md and results/.
        command: That made them.
        engine: What diagnosed them; as it was written before when empty.
        result: Name of the file.
    """
    path = out / "results" / f"{result}.json"
    kept = json.loads(path.read_text()) if path.is_file() else {}
    fresh = [r for r in rows if r["name"] not in DEVELOPED]
    if engine:
        kept["engine"] = engine
    facts = {
        **kept,
        "command": command,
        "versions": versions(),
        "seeds": sorted({r["seed"] for r in rows}),
        "sets": {**summary(rows), "sensor": {"called_physics": sensor_faults_missed(out)}},
        "sets_after_rules_were_fixed": summary(fresh),
        "confusion": confusion(rows),
        "runs": [_kept(r) for r in rows],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(facts, indent=1))
    page = out / "results-physics.md"
    if page.is_file():
        text = page.read_text()
        rates = _rates(facts["sets"], facts["sets_after_rules_were_fixed"])
        tables = {"rates": rates, "runs": runs_table(rows), "confusion": _confused(facts)}
        prefix = "" if result == RESULT else f"{result}-"
        tables = {f"{prefix}{name}": table for name, table in tables.items()}
        for name, table in tables.items():
            if f"<!-- {name}:begin -->" in text:
                text = replace_between_markers(text, name, table)
        page.write_text(text)


def shown(rate: dict[str, Any] | None) -> str:
    if not rate or rate.get("rate") is None:
        return "not run"
    return f"{100 * rate['rate']:.0f} % ({100 * rate['low']:.0f} to {100 * rate['high']:.0f} %, n = {rate['n']})"


def _kept(row: dict[str, Any]) -> dict[str, Any]:
    """Leave out of a run what its folder keeps in full: the page's file stays small enough to be read."""
    kept = {key: value for key, value in row.items() if key not in ("judged", "limits_mm", "parameters", "ranking")}
    if row["set"] == "single" and row["named"][:1] and row["named"][0] in row["hidden"]:
        kept["amplitude_off"], kept["amplitude_held"] = amplitude_of(row)
    return kept


def _rates(sets: dict[str, Any], fresh: dict[str, Any]) -> str:
    rows = [
        ("one effect, SNR >= 2: named first", ("single", "top1")),
        ("one effect, SNR >= 2: in the named set", ("single", "in_set")),
        ("one effect, SNR 1 to 2: named first", ("recovery", "snr_1_to_2")),
        ("one effect, SNR < 1: named first", ("recovery", "snr_below_1")),
        ("one effect, SNR >= 1: named first", ("single", "from_snr_1_top1")),
        ("one effect, SNR >= 1: in the named set", ("single", "from_snr_1_in_set")),
        ("one effect, SNR >= 1: ranked first", ("single", "ranked_first")),
        ("one effect, any amplitude: named first", ("single", "all_amplitudes_top1")),
        ("one effect, any amplitude: a wrong name", ("single", "wrong_name")),
        ("nothing hidden: false alarm", ("null", "false_alarm")),
        ("nothing hidden: NONE OF THESE", ("null", "none_of_these")),
        ("base parameter changed: in the named set", ("base", "named")),
        ("outside the library: NONE or PARTLY", ("outside", "none_or_partly")),
        ("two effects: both in the named set", ("pairs", "both")),
        ("two effects: both, one after the other", ("pairs", "both_in_turn")),
        ("two effects: at least one", ("pairs", "one")),
        ("a sensor fault only: missed, so that it may be called physics", ("sensor", "called_physics")),
        ("decoys chosen, over all runs", ("decoys", "chosen")),
        ("95 % interval covers the parameter", ("parameter_error", "covered")),
        ("forward selection by BIC: right effect first", ("baselines", "bic_first")),
        ("forward selection by BIC: false alarm", ("baselines", "bic_null_false_alarm")),
        ("sparse regression: right effect first", ("baselines", "sparse_first")),
        ("PySINDy ensemble on accelerations: largest term stands for it", ("baselines", "sindy_first")),
        ("PySINDy ensemble on accelerations: some term stands for it", ("baselines", "sindy_among")),
        ("PySINDy ensemble on accelerations: false alarm", ("baselines", "sindy_null_false_alarm")),
    ]
    lines = ["| what | all runs | runs after the rules were fixed | goal |", "|---|---|---|---|"]
    for name, (group, key) in rows:
        goal = BASELINE if group == "baselines" else GOALS.get((group, key), "")
        lines.append(f"| {name} | {shown(sets[group][key])} | {shown(fresh.get(group, {}).get(key))} | {goal} |")
    for name, key, goal in MEDIANS:
        lines.append(f"| {name} | {median_shown(sets[key])} | {median_shown(fresh[key])} | {goal} |")
    left = [percent(each["baselines"]["residual_error_share"]) for each in (sets, fresh)]
    lines.append(f"| learned residual: error left, in-sample, median | {left[0]} | {left[1]} | {BASELINE} |")
    return "\n".join(lines)


def median_shown(found: dict[str, Any]) -> str:
    """Give a median and of how many."""
    return percent(found["median"]) + (f" (n = {found['n']})" if found["n"] else "")


def percent(value: float | None) -> str:
    return "not run" if value is None else f"{100 * value:.0f} %"


def runs_table(rows: list[dict[str, Any]]) -> str:
    """Show all runs, with the version of `diagnose` that judged them where they tell."""
    told = any("judged_by" in r for r in rows)
    columns = ["run", "hidden", "moves [mm]", "SNR", "verdict", "named", "rank", *(["judged by"] if told else [])]
    lines = [f"| {' | '.join(columns)} |", f"|{'---|' * len(columns)}"]
    for r in sorted(rows, key=lambda r: (r["set"], -r["snr"])):
        hidden = "; ".join(
            ": ".join(filter(None, (effect, ", ".join(f"{k} {v:g}" for k, v in values.items()))))
            for effect, values in r["hidden"].items()
        )
        then = f", then {', '.join(r['next_named'])}" if r.get("next_named") else ""
        cells = [
            f"{r['set']} {r['seed']}",
            hidden or "-",
            f"{r['rms_mm']:.2f}" if "rms_mm" in r else "-",
            f"{r['snr']:.1f}",
            r["verdict"],
            (", ".join(r["named"]) or "-") + then,
            ", ".join(map(str, r.get("ranks", []))) or "-",
        ]
        cells += [str(r.get("judged_by", "-"))] if told else []
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _confused(facts: dict[str, Any]) -> str:
    lines = ["| hidden | what was named first (runs) |", "|---|---|"]
    lines += [
        f"| {hidden} | {', '.join(f'{name} ({n})' for name, n in named.items())} |"
        for hidden, named in facts["confusion"].items()
    ]
    return "\n".join(lines)
