"""How often the verdict's tests are wrong: `python -m benchmarks.verdict_chances` (half an hour of one core).

Sets of episodes drawn at random, without any engine, so that there can be many. *Contrast*: amplitudes of two sets are
compared that are of one kind, where episodes tell alike of a law, or some hold nearly all that is known of it.
*Nothing hidden*: bases that err smoothly over the object, or at each point in another way; how many sets pass the
shams, and how many the whole verdict. *Limits*: how often an effect is named that is as large as the detection limit
says, or half so large, in other takes of the same motions. Writes docs/results/verdict_chances.json and the tables
of docs/results-physics.md.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.physics_tables import shown, wilson
from benchmarks.synthetic_evidence import episodes, state
from plop.diagnosis.conclusion import Conclusion, conclusion
from plop.diagnosis.contrast import P_LARGEST, contrast_of
from plop.diagnosis.regression import Grams
from plop.metrics.table import replace_between_markers
from plop.pipeline.execute import versions

KINDS = {"one kind": (["a"] * 8, ["a"] * 12), "four kinds": (list("abcd") * 2, list("abcd") * 3)}
"""Kind of motion of every episode, and of every one of the reference."""
_LITTLE = 0.01
"""What an episode holds of a law that hardly shows in it, as a share of what others hold."""
Draw = Callable[[np.random.Generator, int], np.ndarray]


def _two(generator: np.random.Generator, count: int) -> np.ndarray:
    held = np.full(count, _LITTLE)
    held[generator.choice(count, 2, replace=False)] = 1
    return held


HELD: dict[str, Draw] = {
    "alike": lambda generator, count: np.ones(count),
    "0.3 to 3 times": lambda generator, count: generator.uniform(0.3, 3, count),
    "spread widely": lambda generator, count: np.exp(1.5 * generator.normal(size=count)),
    "nearly all in two episodes": _two,
    "nearly all in every fourth": lambda generator, count: np.where(np.arange(count) % 4, _LITTLE, 1.0),
}
"""What each episode holds of a law."""
SCATTERS = ("by what they hold", "between both", "all alike")
"""How amplitudes of episodes scatter: as noise makes them (less where much is held), the same everywhere, or between:
their squared residuals grow as the root of what is held."""
MISFIT_M: dict[str, dict[str, Any]] = {
    "smoothly": {"misfit_m": 3e-4},
    "at each point in another way": {"rough_m": 3e-4},
}
LAWS = ("tilt", "viscosity", "swelling")


def drawn_grams(
    generator: np.random.Generator, held: np.ndarray, amplitudes: list[np.ndarray], scatter: str = SCATTERS[0]
) -> Grams:
    """Draw episodes that hold so much [E] of a law with some amplitudes [own] in each; one base column comes first."""
    hessians, gradients = [], []
    for share, amplitude in zip(held, amplitudes, strict=True):
        columns = generator.normal(size=(1 + len(amplitude), 6))
        columns[1:] *= np.sqrt(share)
        hessian = columns @ columns.T
        noise = columns @ generator.normal(size=6)
        if scatter == SCATTERS[1]:
            noise *= share**0.25
        if scatter == SCATTERS[2]:
            noise = hessian @ np.concatenate([[0], generator.normal(size=len(amplitude))])
        hessians.append(hessian)
        gradients.append(hessian @ np.concatenate([[0.3 * generator.normal()], amplitude]) + noise)
    return Grams(np.array(hessians), np.array(gradients), np.ones(len(held)))


def contrast_chances(
    kinds: tuple[list[str], list[str]],
    held: Draw,
    scatter: str,
    own: int,
    runs: int,
    *,
    change: float = 0.0,
    apart: float = 1.0,
    told: bool = True,
) -> np.ndarray:
    """Compare many pairs of sets; give p of each.

    Args:
        kinds: Kind of motion of every episode, here and in the reference.
        held: What each holds.
        scatter: See `SCATTERS`.
        own: Amplitudes of the law.
        runs: Pairs.
        change: By how much the amplitude differs here.
        apart: How much what the base alone resembles differs between kinds.
        told: Whether kinds are told; all episodes are taken for one kind otherwise.
    """
    generator, found = np.random.default_rng(own), np.empty(runs)
    names = kinds if told else (["any"] * len(kinds[0]), ["any"] * len(kinds[1]))
    for k in range(runs):
        alone = {kind: apart * generator.normal(size=own) for kind in sorted({*kinds[0], *kinds[1]})}
        sets = [
            drawn_grams(generator, held(generator, len(labels)), [alone[kind] + more for kind in labels], scatter)
            for labels, more in zip(kinds, (change, 0.0), strict=True)
        ]
        found[k] = contrast_of(sets[0], sets[1], np.arange(1 + own), own, 1, names).p
    return found


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
    parser.add_argument("--out", type=Path, default=Path("docs"), help="Folder with results-physics.md and results/.")
    parser.add_argument("--part", choices=("contrast", "nothing", "limits"), action="append", help="Only this one.")
    options = parser.parse_args()
    fewer = options.runs // 3
    parts = {
        "contrast": (contrast_rows(options.runs), contrast_table),
        "nothing": (null_rows(fewer), null_table),
        "limits": (limit_rows(fewer // 4), limit_table),
    }
    path, page = options.out / "results" / "verdict_chances.json", options.out / "results-physics.md"
    facts: dict[str, Any] = json.loads(path.read_text()) if path.is_file() else {}
    facts |= {
        "command": "python -m benchmarks.verdict_chances",
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
        page.write_text(replace_between_markers(page.read_text(), f"chances-{name}", table(facts[name])))
    path.write_text(json.dumps(facts, indent=1) + "\n")


if __name__ == "__main__":
    main()
