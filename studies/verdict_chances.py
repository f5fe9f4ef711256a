"""How often the verdict's tests are wrong: `python -m studies.verdict_chances` (half an hour of one core).

Sets of episodes drawn at random, without any engine, so that there can be many. *Contrast*: amplitudes of two sets are
compared that are of one kind, where episodes tell alike of a law, or some hold nearly all that is known of it.
*Nothing hidden*: bases that err smoothly over the object, or at each point in another way; how many sets pass the
shams, and how many the whole verdict. *Limits*: how often an effect is named that is as large as the detection limit
says, or half so large, in other takes of the same motions. Writes docs/results/verdict_chances.json and prints its
tables.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.physics_tables import shown, wilson
from plop.diagnosis.conclusion import Conclusion, conclusion
from plop.diagnosis.contrast import P_LARGEST, contrast_of
from plop.diagnosis.regression import Grams
from plop.metrics.table import replace_between_markers
from benchmarks.missing_physics.score import wilson
from plop.diagnosis.conclusion import Diagnosis, conclusion
from plop.diagnosis.contrast import P_LARGEST
from plop.pipeline.execute import versions
from tests.support.drawn_contrasts import HELD, KINDS, SCATTERS, contrast_chances
from tests.support.synthetic_evidence import episodes, state

MISFIT_M: dict[str, dict[str, Any]] = {
    "smoothly": {"misfit_m": 3e-4},
    "at each point in another way": {"rough_m": 3e-4},
}
LAWS = ("tilt", "viscosity", "swelling")


def contrast_rows(runs: int) -> Iterator[dict[str, Any]]:
    """Try all cases."""
    for (held, draw), scatter, (kinds, labels) in product(HELD.items(), SCATTERS, KINDS.items()):
        row: dict[str, Any] = {"held": held, "scatter": scatter, "kinds": kinds}
        for own in (1, 2):
            apart = float(len(set(labels[0])) > 1)
            p = contrast_chances(labels, draw, scatter, own, runs, apart=apart)
            row[f"false_{own}"] = wilson(int((p <= P_LARGEST).sum()), runs)
        p = contrast_chances(labels, draw, scatter, 1, runs // 3, apart=apart, change=3.0)
        yield row | {"seen": wilson(int((p <= P_LARGEST).sum()), runs // 3)}


def concluded(seed: int, count: int, misfit: dict[str, Any], reference: bool, **more: Any) -> Conclusion:
    """Judge a set of so many episodes; the reference is another set of as many, drawn alike."""
    control = episodes(seed + 100_000, count=count, **misfit) if reference else None
    return conclusion(state(episodes(seed, count=count, **misfit, **more), control), (), 99, seed)


def null_rows(runs: int) -> Iterator[dict[str, Any]]:
    """Hide nothing."""
    for (misfit, given), reference, count in product(MISFIT_M.items(), (False, True), (4, 6, 8)):
        found = [concluded(seed, count, given, reference) for seed in range(runs)]
        p = np.array([next(f.p for f in one.findings if f.kind != "base") for one in found])
        yield {
            "misfit": misfit,
            "reference": reference,
            "episodes": count,
            "shams_passed": wilson(int((p <= P_LARGEST).sum()), runs),
            "named": wilson(sum(bool(one.verdict.named) for one in found), runs),
        }


def limit_rows(runs: int) -> Iterator[dict[str, Any]]:
    """Hide laws at their detection limits, and at half of them, in other takes."""
    for (misfit, given), reference in product(MISFIT_M.items(), (False, True)):
        named: dict[float, list[bool]] = {1.0: [], 0.5: []}
        for seed, law in product(range(runs), LAWS):
            limit = concluded(seed, 8, given, reference).limits[law].amplitude
            for factor, found in named.items() if limit is not None else ():
                again = concluded(seed, 8, given, reference, amplitudes={law: factor * limit}, take=1)
                found.append(law in again.verdict.named)
        rates = {factor: wilson(sum(found), len(found)) for factor, found in named.items()}
        yield {"misfit": misfit, "reference": reference, "at": rates[1.0], "half": rates[0.5]}


def shown(rate: dict[str, Any]) -> str:
    """Show a rate with its interval."""
    return f"{100 * rate['rate']:.0f} % ({100 * rate['low']:.0f} to {100 * rate['high']:.0f} %, n = {rate['n']})"


def contrast_table(rows: list[dict[str, Any]]) -> str:
    """Set the rates of the contrast side by side."""
    lines = [
        "| what is known of a law lies | amplitudes scatter | motions | false alarms, one amplitude "
        "| two amplitudes | a change of 3 is seen |",
        "|---|---|---|---|---|---|",
    ]
    return "\n".join(
        lines
        + [
            f"| {r['held']} | {r['scatter']} | {r['kinds']} | {shown(r['false_1'])} | "
            f"{shown(r['false_2'])} | {shown(r['seen'])} |"
            for r in rows
        ]
    )


def null_table(rows: list[dict[str, Any]]) -> str:
    """Set the false alarms side by side."""
    lines = ["| the base errs | reference | episodes | pass the shams | something is named |", "|---|---|---|---|---|"]
    return "\n".join(
        lines
        + [
            f"| {r['misfit']} | {'yes' if r['reference'] else 'no'} | {r['episodes']} | "
            f"{shown(r['shams_passed'])} | {shown(r['named'])} |"
            for r in rows
        ]
    )


def limit_table(rows: list[dict[str, Any]]) -> str:
    """Set the recoveries side by side."""
    lines = ["| the base errs | reference | named at the limit | at half of it |", "|---|---|---|---|"]
    return "\n".join(
        lines
        + [
            f"| {r['misfit']} | {'yes' if r['reference'] else 'no'} | {shown(r['at'])} | {shown(r['half'])} |"
            for r in rows
        ]
    )


def main() -> None:
    """Draw, judge, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=600, help="Sets in each row of the contrast; a third for the rest.")
    parser.add_argument("--out", type=Path, default=Path("docs"), help="Folder with results/.")
    parser.add_argument("--part", choices=("contrast", "nothing", "limits"), action="append", help="Only this one.")
    options = parser.parse_args()
    fewer = options.runs // 3
    parts = {
        "contrast": (contrast_rows(options.runs), contrast_table),
        "nothing": (null_rows(fewer), null_table),
        "limits": (limit_rows(fewer // 4), limit_table),
    }
    path = options.out / "results" / "verdict_chances.json"
    facts: dict[str, Any] = json.loads(path.read_text()) if path.is_file() else {}
    facts |= {
        "command": "python -m studies.verdict_chances",
        "versions": versions(),
        "seeds": "0 to runs",
        "level": P_LARGEST,
    }
    for name, (rows, table) in parts.items():
        if options.part and name not in options.part:
            continue
        facts[name] = []
        for row in rows:
            facts[name].append(row)
            sys.stdout.write(f"{json.dumps(row)}\n")
            sys.stdout.flush()
        sys.stdout.write(table(facts[name]) + "\n")
    path.write_text(json.dumps(facts, indent=1) + "\n")


if __name__ == "__main__":
    main()
