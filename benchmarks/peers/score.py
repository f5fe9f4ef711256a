"""Gather what the benchmarks left behind into docs/results/peers.json, and print its tables."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.peers.pipeline import NAMES, RIVALS, Pipeline
from plop.metrics.table import collect
from plop.statistics.bootstrap import bootstrap_interval

LABELS = {"rigid": "best rigid motion (oracle)", "i2n": "I2N"}
"""What tables call a model whose name does not say what it is."""
PARTICLE_COLUMNS = {
    "mean_l2_mm": "mean L2 [mm]",
    "final_l2_mm": "final L2 [mm]",
    "mse_1e3_m2": "MSE per coordinate [10^-3 m^2]",
}
PIPELINE_COLUMNS = {
    "cd_mm": "CD [mm]",
    "emd_mm": "EMD [mm]",
    "hd_mm": "HD [mm]",
    "ssim": "SSIM",
    "psnr_db": "PSNR [dB]",
    "j_score": "J",
    "f_score": "F",
    "truth_rms_mm": "nodes [mm]",
}

Cell = dict[str, Any]
Table = dict[str, dict[str, Cell]]
"""Model -> metric -> {"mean", "low", "high", "n", "seeds"}."""


def pipeline_table(pipeline: Pipeline) -> Table:
    """Average a workspace's scores: seeds within an episode, then episodes, which are the units of the interval."""
    found: Table = {}
    for name in (*NAMES, *RIVALS):
        methods = collect({"here": pipeline.reports(name)})["environments"]["here"]
        if name not in methods:
            continue
        seeds = list(pipeline.plan.seeds) if name in NAMES else []
        row = {key: cell for key, cell in methods[name].items() if key not in ("end", "start") and cell}
        row |= {f"{key}_end": cell for key, cell in methods[name]["end"].items() if cell}
        found[name] = {key: {**cell, "seeds": seeds} for key, cell in row.items()}
    return found


def pipeline_facts(pipeline: Pipeline) -> dict[str, Any]:
    """Say how each model of a workspace was trained."""
    costs = pipeline.costs()
    return {
        name: {
            "parameters": costs[name]["parameters"],
            "training_step_ms": costs[name]["step_ms"],
            "steps": pipeline.steps_of(name),
        }
        for name in NAMES
    }


def particle_tables(rows: Iterable[Mapping[str, Any]]) -> tuple[dict[str, Table], dict[str, Any]]:
    """Average rows of particle rollouts: seeds within a test rollout, then test rollouts that every model has.

    Returns:
        Environment -> table, and environment -> model -> how it was trained.
    """
    by: dict[str, dict[str, list[Mapping[str, Any]]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        by[row["environment"]][row["model"]].append(row)
    tables: dict[str, Table] = {}
    facts: dict[str, Any] = {}
    for environment, models in by.items():
        tables[environment], facts[environment] = {}, {}
        tests = set.intersection(*({row["test"] for row in mine} for mine in models.values()))
        for name, every in models.items():
            mine = [row for row in every if row["test"] in tests]
            if not mine:
                continue
            learned = "steps" in mine[0]
            seeds = sorted({row["seed"] for row in mine}) if learned else []
            tables[environment][name] = {
                metric: {**_interval(mine, metric), "seeds": seeds} for metric in PARTICLE_COLUMNS
            }
            if learned:
                steps, seconds, rollout_ms = (
                    sum(row[key] for row in mine) / len(mine) for key in ("steps", "seconds", "step_ms")
                )
                facts[environment][name] = {
                    "parameters": mine[0]["parameters"],
                    "steps": round(steps),
                    "training_step_ms": round(1e3 * seconds / steps, 1),
                    "rollout_step_ms": round(rollout_ms, 1),
                }
    return tables, facts


def _interval(rows: list[Mapping[str, Any]], metric: str) -> Cell:
    per_test: dict[str, list[float]] = defaultdict(list)
    for row in rows:
        per_test[row["test"]].append(row["errors"][metric])
    found = bootstrap_interval([sum(values) / len(values) for values in per_test.values()])
    assert found is not None
    return {key: float(f"{value:.4g}") if isinstance(value, float) else value for key, value in asdict(found).items()}


def read_rows(work: Path) -> list[dict[str, Any]]:
    """Read the rows of the particle benchmark, in order."""
    return [json.loads(path.read_text()) for path in sorted((work / "rows").glob("*.json"))]


def columns_of(tables: Iterable[Mapping[str, Mapping[str, Cell]]], columns: Mapping[str, str]) -> dict[str, str]:
    """Keep the columns that some of the tables have."""
    found = {key for table in tables for row in table.values() for key in row}
    return {key: title for key, title in columns.items() if key in found}


def table_to_markdown(table: Mapping[str, Mapping[str, Cell]], shown: Mapping[str, str]) -> str:
    """Print the given columns of a table, one model a line, as "mean [low, high]"; a dash is undefined."""
    lines = ["| model | n | seeds | " + " | ".join(shown.values()) + " |", "|---|---|---|" + "---|" * len(shown)]
    for name, row in table.items():
        first: Cell = next(iter(row.values()), {})
        cells = [_cell(row.get(key)) for key in shown]
        seeds = str(len(first.get("seeds", ()))) if first.get("seeds") else "-"
        lines.append("| " + " | ".join([LABELS.get(name, name), str(first.get("n", 0)), seeds, *cells]) + " |")
    return "\n".join(lines)


def _cell(cell: Cell | None) -> str:
    if not cell:
        return "-"
    mean = f"{cell['mean']:.3g}"
    return mean if cell.get("low") is None else f"{mean} [{cell['low']:.3g}, {cell['high']:.3g}]"


def scaling_to_markdown(scaling: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """Print time and memory by the number of particles."""
    counts = sorted(next(iter(scaling.values())), key=int)
    lines = ["| model | " + " | ".join(f"{int(count):,}" for count in counts) + " |", "|---|" + "---|" * len(counts)]
    for name, row in scaling.items():
        cells = [
            each["left_out"]
            if "left_out" in (each := row[count])
            else f"{each['forward_ms']:.0f} / {each['training_ms']:.0f} ms, {each['peak_mb']:.0f} MB"
            for count in counts
        ]
        lines.append("| " + " | ".join([LABELS.get(name, name), *cells]) + " |")
    return "\n".join(lines)
