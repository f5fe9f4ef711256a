"""Tables of results over environments, from the scores.json files of `plop eval`.

    {"environments": {"prism-jelly": {"plop": {"cd_mm": {"mean", "low", "high", "n"}, ...,
                                               "end": {"cd_mm": {...}, ...},
                                               "start": {...}},
                                      "persistence": ..., "rigid": ...}, ...}, ...}

The scores directly under a method are means over the predicted frames of the test episodes;
"end" is the last frame, "start" the given frame 0, which is the floor.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from plop.metrics.frame import HIGHER_IS_BETTER, mean_defined
from plop.metrics.scores import Scores
from plop.statistics.bootstrap import bootstrap_interval

COLUMNS = {
    "cd_mm": ("CD [mm]", 2),
    "emd_mm": ("EMD [mm]", 2),
    "hd_mm": ("HD [mm]", 1),
    "ssim": ("SSIM", 3),
    "psnr_db": ("PSNR [dB]", 2),
    "lpips": ("LPIPS", 3),
    "j_score": ("J", 3),
    "f_score": ("F", 3),
    "truth_rms_mm": ("nodes [mm]", 2),
}
"""Columns of a printed table: heading and digits."""

ScoreFiles = Mapping[str, Path | Sequence[Path]]


def collect(
    scores: ScoreFiles,
    *,
    chosen: Callable[[str], bool] | None = None,
    command: str = "",
    versions: Mapping[str, str] | None = None,
    seeds: Sequence[int] = (),
) -> dict[str, Any]:
    """Collect the scores of several environments.

    Args:
        scores: Per environment its scores.json, or one per training seed; seeds are averaged
            within each episode, so that episodes stay the units of the interval.
        chosen: Which episodes count, by name; all when absent. An environment without any is left out.
        command: Command that made them.
        versions: Versions of the software.
        seeds: Seeds of the runs.

    Returns:
        The content of docs/results/disect.json.

    Raises:
        PlopError: A file is missing, is not scores.json, or has another layout.
    """
    environments: dict[str, Any] = {}
    conventions: dict[str, str] = {}
    for environment, paths in scores.items():
        reports = [Scores.load(path) for path in ([paths] if isinstance(paths, Path) else paths)]
        conventions |= reports[0].conventions
        names = [name for name in _names(reports) if chosen is None or chosen(name)]
        if names:
            environments[environment] = _environment(reports, names)
    facts = {"command": command, "versions": dict(versions or {}), "seeds": list(seeds), "conventions": conventions}
    return facts | {"environments": environments, "mean": _mean_improvement(environments)}


def to_markdown(results: Mapping[str, Any], *, part: str = "episode") -> str:
    """Print a table, environment by environment, as "mean [low, high]".

    Args:
        results: From `collect`.
        part: "episode", "end" or "start".

    Returns:
        A Markdown table; a dash is undefined or unavailable.
    """
    rows = [
        (name, method, entry if part == "episode" else entry[part])
        for name, methods in results["environments"].items()
        for method, entry in methods.items()
    ]
    shown = [metric for metric in COLUMNS if any(row[2].get(metric) for row in rows)]
    lines = ["| " + " | ".join(["environment", "method", "n", *(COLUMNS[metric][0] for metric in shown)]) + " |"]
    lines.append("|---|---|---|" + "---|" * len(shown))
    for name, method, entry in rows:
        count = max((cell["n"] for cell in map(entry.get, shown) if cell), default=0)
        cells = [_cell(entry.get(metric), COLUMNS[metric][1]) for metric in shown]
        lines.append("| " + " | ".join([name, method, str(count), *cells]) + " |")
    return "\n".join(lines)


def gains_to_markdown(results: Mapping[str, Any]) -> str:
    """Print how far the model's errors are below persistence's, averaged over environments, and by environment [%]."""
    shown = {key: COLUMNS[key][0].split(" [")[0] for key in ("cd_mm", "emd_mm", "truth_rms_mm")}
    head = [f"{title}, {part}" for part in ("whole", "end") for title in shown.values()]
    lines = ["| environment | " + " | ".join(head) + " |", "|---|" + "---|" * len(head)]
    for name, methods in results["environments"].items():
        cells = [_gain(methods, part, key) for part in ("episode", "end") for key in shown]
        lines.append(f"| {name} | " + " | ".join("-" if c is None else f"{c:.0f}" for c in cells) + " |")
    mean = results["mean"]["better_than_persistence_percent"]
    means = [mean[part].get("plop", {}).get(key) for part in ("episode", "end") for key in shown]
    lines.append("| **mean** | " + " | ".join("-" if m is None else f"**{m:.0f}**" for m in means) + " |")
    return "\n".join(lines)


def _gain(methods: Mapping[str, Any], part: str, metric: str, method: str = "plop") -> float | None:
    """How far a method's error is below persistence's [%]; None where one of the two is undefined."""
    both = [(e if part == "episode" else e[part]).get(metric) for e in (methods[method], methods["persistence"])]
    return 100 * (1 - both[0]["mean"] / both[1]["mean"]) if all(both) and both[1]["mean"] > 0 else None


def _names(reports: list[Scores]) -> list[str]:
    return list(dict.fromkeys(name for report in reports for name in report.episodes))


def _environment(reports: list[Scores], names: list[str]) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for method, parts in reports[0].methods.items():
        per_part = {
            part: {metric: _interval(reports, names, method, part, metric) for metric in metrics}
            for part, metrics in parts.items()
        }
        table[method] = per_part.pop("episode") | per_part
    return table


def _interval(reports: list[Scores], names: list[str], method: str, part: str, metric: str) -> dict[str, Any] | None:
    values = [mean_defined([_score(report, name, method, part, metric) for report in reports]) for name in names]
    found = bootstrap_interval(values, seed=reports[0].seed)
    return None if found is None else asdict(found)


def _score(report: Scores, name: str, method: str, part: str, metric: str) -> float | None:
    return report.episodes.get(name, {}).get(method, {}).get(part, {}).get(metric)


def _mean_improvement(environments: Mapping[str, Any]) -> dict[str, Any]:
    """Average over environments how far each method's error is below persistence's [%]."""
    out: dict[str, Any] = {}
    for part in ("episode", "end"):
        gains: dict[str, dict[str, list[float]]] = {}
        for methods in environments.values():
            for method in methods.keys() - {"persistence"}:
                for metric in COLUMNS.keys() - HIGHER_IS_BETTER:
                    gain = _gain(methods, part, metric, method)
                    if gain is not None:
                        gains.setdefault(method, {}).setdefault(metric, []).append(gain)
        out[part] = {
            method: {metric: round(sum(values) / len(values), 2) for metric, values in sorted(found.items())}
            for method, found in gains.items()
        }
    return {"better_than_persistence_percent": out}


def _cell(interval: Mapping[str, Any] | None, digits: int) -> str:
    if interval is None:
        return "-"
    if interval["low"] is None:
        return f"{interval['mean']:.{digits}f}"
    return f"{interval['mean']:.{digits}f} [{interval['low']:.{digits}f}, {interval['high']:.{digits}f}]"
