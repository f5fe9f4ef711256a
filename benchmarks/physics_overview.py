"""Goals of the missing-physics benchmark beside what was measured: `python -m benchmarks.physics_overview`.

Reads docs/results/physics.json (followed points) and physics_cameras.json (through cameras), which other commands
write, and rewrites the first table of docs/results-physics.md.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from benchmarks.goals import ShareGoal
from benchmarks.physics_tables import GOALS, MEDIANS, percent, shown
from plop.metrics.table import replace_between_markers

NAMES = {
    ("recovery", "snr_2_and_more"): "one hidden effect, at least twice the noise: named first",
    ("recovery", "snr_2_and_more_in_set"): "the same: in the named set",
    ("single", "all_amplitudes_top1"): "one hidden effect of any strength: named first",
    ("null", "false_alarm"): "nothing hidden: something is named",
    ("sensor", "called_physics"): "only a sensor fault: called physics",
    ("outside", "none_or_partly"): "a law outside the library: NONE OF THESE or PARTLY",
    ("pairs", "both_in_turn"): "two hidden effects: both, one after the other",
    ("pairs", "one"): "two hidden effects: at least one",
    ("decoys", "chosen"): "decoys chosen, over all runs",
    ("parameter_error", "covered"): "95 % intervals that hold the hidden amplitude",
}


def overview(points: dict[str, Any], cameras: dict[str, Any]) -> str:
    """Give the table from the "sets" of both results."""
    lines = ["| what | goal | followed points | reached | through cameras | reached |", "|---|---|---|---|---|---|"]
    for (group, key), name in NAMES.items():
        goal = GOALS.get((group, key))
        rates = [sets.get(group, {}).get(key) for sets in (points, cameras)]
        cells = [cell for rate in rates for cell in (shown(rate), _reached(goal, rate))]
        lines.append(f"| {name} | {goal or ''} | {' | '.join(cells)} |")
    for name, key, goal in MEDIANS:
        values = [sets[key]["median"] for sets in (points, cameras)]
        cells = [cell for value in values for cell in (percent(value), goal.reached(value))]
        lines.append(f"| {name} | {goal} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _reached(goal: ShareGoal | None, rate: dict[str, Any] | None) -> str:
    return "" if goal is None else goal.reached((rate or {}).get("rate"))


def main() -> None:
    """Rewrite the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs"), help="Folder with results-physics.md and results/.")
    out = parser.parse_args().out
    points, cameras = (json.loads((out / "results" / f"{name}.json").read_text())["sets"]
                       for name in ("physics", "physics_cameras"))  # fmt: skip
    page = out / "results-physics.md"
    page.write_text(replace_between_markers(page.read_text(), "overview", overview(points, cameras)))


if __name__ == "__main__":
    main()
