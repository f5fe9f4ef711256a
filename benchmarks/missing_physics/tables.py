"""The benchmarks' tables in Markdown, from their result files; nothing is measured or counted here."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from benchmarks.missing_physics.row import Row
from benchmarks.missing_physics.score import GOALS, LEAST_SNR

Sets = Mapping[str, Any]
RATES: dict[tuple[str, str], str] = {
    ("single", "top1"): f"one effect, SNR >= {LEAST_SNR:g}: named first",
    ("single", "in_set"): f"one effect, SNR >= {LEAST_SNR:g}: in the named set",
    ("recovery", "snr_1_to_2"): "one effect, SNR 1 to 2: named first",
    ("recovery", "snr_below_1"): "one effect, SNR < 1: named first",
    ("single", "from_snr_1_top1"): "one effect, SNR >= 1: named first",
    ("single", "from_snr_1_in_set"): "one effect, SNR >= 1: in the named set",
    ("single", "ranked_first"): "one effect, SNR >= 1: ranked first",
    ("single", "all_amplitudes_top1"): "one effect, any amplitude: named first",
    ("single", "wrong_name"): "one effect, any amplitude: a wrong name",
    ("null", "false_alarm"): "nothing hidden: something is named",
    ("null", "none_of_these"): "nothing hidden: NONE OF THESE",
    ("sensor", "called_physics"): "a sensor fault only: called physics (points: missed, so that it may be)",
    ("sensor", "stopped"): "a sensor fault only: SENSOR",
    ("base", "named"): "base parameter changed: in the named set",
    ("outside", "none_or_partly"): "outside the library: NONE or PARTLY",
    ("pairs", "both"): "two effects: both in the named set",
    ("pairs", "both_in_turn"): "two effects: both, one after the other",
    ("pairs", "one"): "two effects: at least one",
    ("decoys", "chosen"): "decoys chosen, over all runs",
    ("parameter_error", "covered"): "95 % intervals that hold the hidden amplitude",
    ("parameter_error", "median"): "error of the amplitude, median",
    ("gap_closed", "median"): "explainable gap closed, median",
    ("wrong_law", "median"): "the best of the wrong laws closes, median",
    ("baselines", "bic_first"): "forward selection by BIC: right effect first",
    ("baselines", "bic_null_false_alarm"): "forward selection by BIC: false alarm",
    ("baselines", "sparse_first"): "sparse regression: right effect first",
    ("baselines", "sindy_first"): "PySINDy ensemble on accelerations: largest term stands for it",
    ("baselines", "sindy_among"): "PySINDy ensemble on accelerations: some term stands for it",
    ("baselines", "sindy_null_false_alarm"): "PySINDy ensemble on accelerations: false alarm",
    ("baselines", "residual_error_share"): "learned residual: error left, in-sample, median",
}
"""What is shown of each benchmark, in order."""


def rates_table(columns: Mapping[str, Sets]) -> str:
    """Set rates and medians beside their goals.

    Args:
        columns: Heading -> "sets" of a result file.
    """
    lines = [f"| what | goal | {' | '.join(columns)} |", f"|---|---|{'---|' * len(columns)}"]
    for (group, key), name in RATES.items():
        goal, cells = GOALS.get((group, key)), [_cell(sets.get(group, {}), key) for sets in columns.values()]
        if not any(cells):
            continue
        marks = [_mark(goal, sets.get(group, {}), key) for sets in columns.values()]
        lines.append(f"| {name} | {goal or ''} | {' | '.join(f'{c}{m}' for c, m in zip(cells, marks))} |")
    return "\n".join(lines)


def _value(group: Sets, key: str) -> float | None:
    found = group.get(key)
    return found.get("rate") if isinstance(found, Mapping) else found


def _mark(goal: Any, group: Sets, key: str) -> str:
    return ", **missed**" if goal and goal.reached(_value(group, key)) is False else ""


def _cell(group: Sets, key: str) -> str:
    if key not in group:
        return ""
    found, value = group[key], _value(group, key)
    if value is None:
        return "not run"
    if isinstance(found, Mapping):
        return f"{100 * value:.0f} % ({100 * found['low']:.0f} to {100 * found['high']:.0f} %, n = {found['n']})"
    return f"{100 * value:.0f} %" + (f" (n = {group['n']})" if key == "median" else "")


def runs_table(rows: Iterable[Row]) -> str:
    """Show all runs, with the version of `diagnose` that judged them."""
    columns = ["run", "hidden", "moves [mm]", "SNR", "verdict", "named", "rank", "judged by"]
    lines = [f"| {' | '.join(columns)} |", f"|{'---|' * len(columns)}"]
    for row in sorted(rows, key=lambda row: (row.set, -row.snr)):
        hidden = "; ".join(
            ": ".join(filter(None, (effect, ", ".join(f"{k} {v:g}" for k, v in values.items()))))
            for effect, values in row.hidden.items()
        )
        then = f", then {', '.join(row.next_named)}" if row.next_named else ""
        cells = [
            f"{row.set} {row.seed}",
            hidden or row.fault or "-",
            "-" if row.rms_mm is None else f"{row.rms_mm:.2f}",
            f"{row.snr:.1f}",
            row.verdict,
            (", ".join(row.named) or "-") + then,
            ", ".join(map(str, row.ranks or ())) or "-",
            str(row.judged_by or "-"),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def confusion_table(found: Mapping[str, Mapping[str, int]]) -> str:
    """Show what was named first for each hidden effect."""
    lines = ["| hidden | what was named first (runs) |", "|---|---|"]
    for hidden, named in found.items():
        lines.append(f"| {hidden} | {', '.join(f'{name} ({n})' for name, n in named.items())} |")
    return "\n".join(lines)
