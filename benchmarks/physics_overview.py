"""Both missing-physics benchmarks beside their goals: `python -m benchmarks.physics_overview`.

Reads docs/results/physics_cameras.json (the whole pipeline) and physics_points.json (followed points, with other
methods beside), which other commands write, and writes docs/results/physics.json and the first table of
docs/results-physics.md.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from benchmarks.goals import ShareGoal
from benchmarks.physics_tables import GOALS, MEDIANS, confusion, median_shown, shown
from plop.metrics.table import replace_between_markers

COMMAND = "make bench-physics"
NAMES = {
    ("single", "top1"): "one hidden effect, at least twice the noise: named first",
    ("single", "in_set"): "the same: in the named set",
    ("single", "all_amplitudes_top1"): "one hidden effect of any strength: named first",
    ("null", "false_alarm"): "nothing hidden: something is named",
    ("sensor", "called_physics"): "only a sensor fault: called physics",
    ("outside", "none_or_partly"): "a law outside the library: NONE OF THESE or PARTLY",
    ("pairs", "both_in_turn"): "two hidden effects: both, one after the other",
    ("pairs", "one"): "two hidden effects: at least one",
    ("decoys", "chosen"): "decoys chosen, over all runs",
    ("parameter_error", "covered"): "95 % intervals that hold the hidden amplitude",
}


def overview(cameras: dict[str, Any], points: dict[str, Any]) -> str:
    """Give the table from the "sets" of both results."""
    lines = ["| what | goal | through cameras | reached | followed points | reached |", "|---|---|---|---|---|---|"]
    for (group, key), name in NAMES.items():
        goal = GOALS.get((group, key))
        rates = [sets.get(group, {}).get(key) for sets in (cameras, points)]
        cells = [cell for rate in rates for cell in (shown(rate), _reached(goal, rate))]
        lines.append(f"| {name} | {goal or ''} | {' | '.join(cells)} |")
    for name, key, goal in MEDIANS:
        found = [sets[key] for sets in (cameras, points)]
        cells = [cell for each in found for cell in (median_shown(each), goal.reached(each["median"]))]
        lines.append(f"| {name} | {goal} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _reached(goal: ShareGoal | None, rate: dict[str, Any] | None) -> str:
    return "" if goal is None else goal.reached((rate or {}).get("rate"))


def facts_of(cameras: dict[str, Any], points: dict[str, Any]) -> dict[str, Any]:
    """Give what docs/results/physics.json holds: rates through cameras, and the other benchmark's beside them.

    Args:
        cameras: What physics_cameras.json holds.
        points: What physics_points.json holds.
    """
    told = _told(cameras)
    # other methods were given an ideal tracker's points
    others = {**points["sets"]["baselines"], "measured_on": "followed points"}
    told["sets"] = {**told["sets"], "baselines": others}
    return {
        "command": COMMAND,
        "versions": cameras["versions"],
        "measured_on": "recordings through cameras",
        **told,
        "followed_points": _told(points),
    }


def _told(result: dict[str, Any]) -> dict[str, Any]:
    """Choose from one benchmark's file what tells of all its runs."""
    versions = [run["judged_by"] for run in result["runs"] if run["set"] != "unreachable"]
    return {
        "seeds": result["seeds"],
        "judged_by": {str(v): versions.count(v) for v in sorted({*versions})},
        "sets": result["sets"],
        "confusion": confusion(result["runs"]),
    }


def main() -> None:
    """Write the file and the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs"), help="Folder with results-physics.md and results/.")
    out = parser.parse_args().out
    cameras, points = (
        json.loads((out / "results" / f"{name}.json").read_text()) for name in ("physics_cameras", "physics_points")
    )
    (out / "results" / "physics.json").write_text(json.dumps(facts_of(cameras, points), indent=1) + "\n")
    page = out / "results-physics.md"
    table = overview(cameras["sets"], points["sets"])
    page.write_text(replace_between_markers(page.read_text(), "overview", table))


if __name__ == "__main__":
    main()
