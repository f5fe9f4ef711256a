"""Average scores per frame to scores per episode and environment."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plop.artifacts.atomic_file import whole
from plop.metrics.frame import CONVENTIONS, HIGHER_IS_BETTER, mean_defined
from plop.metrics.scores import BASELINES, PARTS, RIVALS, Scores
from plop.statistics.bootstrap import Interval, bootstrap_interval

if TYPE_CHECKING:
    from stages.eval.stage import EvalConfig

Rows = list[dict[str, Any]]
Parts = dict[str, dict[str, float | None]]
Means = dict[str, dict[str, Interval | None]]


def scores_of(rows: Rows, environment: str, config: EvalConfig, unavailable: dict[str, str]) -> Scores:
    """Average frames, then episodes.

    Args:
        rows: One row per episode, method and frame.
        environment: Its name.
        config: Settings.
        unavailable: Score -> why there is none.
    """
    episodes: dict[str, dict[str, Parts]] = {}
    for name in dict.fromkeys(row["episode"] for row in rows):
        mine = [row for row in rows if row["episode"] == name]
        methods = list(dict.fromkeys(row["method"] for row in mine))
        episodes[name] = {method: _parts([row for row in mine if row["method"] == method]) for method in methods}
    metrics = [metric for metric in CONVENTIONS if any(metric in row for row in rows)]
    methods = list(dict.fromkeys(row["method"] for row in rows))
    table = {method: _over_episodes(episodes, method, metrics, config.seed) for method in methods}
    return Scores(
        environment=environment,
        method=config.method,
        seed=config.seed,
        conventions={metric: CONVENTIONS[metric] for metric in metrics},
        baselines=BASELINES | {name: RIVALS[name] for name in RIVALS if name in methods},
        unavailable=unavailable,
        notes=tuple(_notes(rows, metrics, len(episodes))),
        methods=table,
        better_than_persistence_percent={part: _better(table, config.method, part) for part in ("episode", "end")},
        episodes=episodes,
    )


def summary_table(scores: Scores) -> list[dict[str, Any]]:
    """Return one row per method and part, with means over episodes."""
    table = []
    for part in PARTS:
        for method, parts in scores.methods.items():
            row: dict[str, Any] = {"over": part, "method": method}
            for metric in scores.conventions:
                entry = parts[part][metric]
                row[metric] = None if entry is None else round(entry.mean, 3)
            table.append(row)
    return table


def write_csv(path: Path, rows: Rows) -> None:
    """Write every frame's scores; an empty field is undefined."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    with whole(path) as scratch, scratch.open("w", newline="") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        for row in rows:
            writer.writerow({key: f"{value:.7g}" if isinstance(value, float) else value for key, value in row.items()})


def _parts(rows: Rows) -> Parts:
    last = max(row["frame"] for row in rows)
    wanted: dict[str, Callable[[int], bool]] = {
        "episode": lambda frame: frame > 0,
        "end": lambda frame: frame == last,
        "start": lambda frame: frame == 0,
    }
    metrics = [metric for metric in CONVENTIONS if any(metric in row for row in rows)]
    return {
        part: {metric: mean_defined([row.get(metric) for row in rows if keep(row["frame"])]) for metric in metrics}
        for part, keep in wanted.items()
    }


def _over_episodes(episodes: dict[str, dict[str, Parts]], method: str, metrics: list[str], seed: int) -> Means:
    def interval(part: str, metric: str) -> Interval | None:
        return bootstrap_interval([scores[method][part].get(metric) for scores in episodes.values()], seed=seed)

    return {part: {metric: interval(part, metric) for metric in metrics} for part in PARTS}


def _better(table: dict[str, Means], method: str, part: str) -> dict[str, float]:
    """Return by how many percent the method's error is below persistence's, for scores that are errors."""
    out = {}
    for metric, entry in table[method][part].items():
        base = table["persistence"][part][metric]
        if metric not in HIGHER_IS_BETTER and entry and base and base.mean > 0:
            out[metric] = round(100 * (1 - entry.mean / base.mean), 2)
    return out


def _notes(rows: Rows, metrics: list[str], episodes: int) -> list[str]:
    notes = []
    if episodes < 2:
        notes.append("One episode: there is no interval.")
    elif episodes == 2:
        notes.append("Two episodes: the interval is the smaller and the larger value.")
    for metric in metrics:
        for method in dict.fromkeys(row["method"] for row in rows):
            missing = [row for row in rows if row["method"] == method and row.get(metric) is None]
            if missing and metric not in ("lpips", "emd_mm"):
                first = missing[0]
                notes.append(
                    f"{metric} of {method} is undefined in {len(missing)} frame(s) (an empty mask or cloud), "
                    f"first in {first['episode']} frame {first['frame']}."
                )
    return notes
