"""The missing-physics benchmark through cameras: `python -m benchmarks.physics_cameras --minutes 60` (it goes on).

Each run is what a user types: `plop simulate` hides something and films it with six noisy depth cameras, `plop
diagnose` fits Gaussians, follows them and judges, against an engine of another discretisation and another elastic law
that `plop identify` fitted to recordings without anything hidden. Settings are those of `make demo-physics` (six
episodes), but for the engine, which is as fine as `identify` makes it by itself. Start one process a core, with
`--share 1/2` and `--share 2/2`. `--summary` only rewrites the tables. A run that neither the workspace nor the tables
hold by this version of `diagnose` is made (anew); the others stay as they were written before: each stands there with
the newest verdict that it has had, and the version that gave it. `--again` makes all that the workspace lacks: after a
change outside `diagnose`, of the base's fit for one.
"""

from __future__ import annotations

import argparse
import importlib.resources
import json
import sys
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.newest import Row, is_judged, newest_rows, shared, written_rows
from benchmarks.physics_plan import DECOYS, MORE_BASE, TURNED
from benchmarks.physics_tables import GOALS, MEDIANS, median_shown, runs_table, shown, verdict_rates
from benchmarks.workspace import Typed
from plop.artifacts.lock import locked
from plop.errors import SignalTooWeakError
from plop.metrics.table import replace_between_markers
from plop.physics.effects.library import library
from plop.physics.scenes.sealed import open_answer
from plop.pipeline.execute import versions
from plop_cli.demo_physics import PROFILE
from stages.diagnose.stage import STAGE

SNRS = (4.0, 2.0)
"""Signals: displacement by the hidden effect over the noise of depth, 0.5 mm."""
PAIRS = (("adhesion", "tilt"), ("swelling", "table_friction"), ("plasticity", "swelling"))
OUTSIDE = ("plasticity", "table_friction", "tilt", "adhesion")
FAULTS = ("clock=0.02", "depth_scale=1.01", "pose_error.x_m=0.004")
NULLS = 6
FINER = ("--spacing-m", "0", "--iterations", "5")
"""The defaults of `identify`, which the demo's settings replace by half as many particles."""
_SHARES = (1.0, 0.5)
"""Of the wanted signal that are tried, one after the other: many laws cannot move the block by 2 mm."""
_JUDGED = 3
"""Laws of each ranking that are kept."""
_TESTS = ("p", "contrast", "contrast_p", "gain_error", "reasons")
"""What is kept of how each of them was tested."""


@dataclass(frozen=True)
class Run:
    """One line of the plan."""

    name: str
    set: str
    """single, null, base, decoy, pair, outside or sensor."""
    seed: int
    hide: tuple[str, ...] = ()
    """As typed after --hide."""
    snr: float = 0.0
    """Signal that each hidden effect is scaled to; 0: amplitudes as they are written."""
    without: str = ""
    """Effect taken out of the library of the diagnosis."""
    fault: str = ""
    """As typed after --fault."""


def planned() -> list[Run]:
    """List all runs in their order: a stop leaves all sets represented."""
    singles = [
        [
            Run(f"snr{snr:g}-{name}", "single", 3000 + 100 * level + k, _typed(name, values[1 - level]), snr)
            for k, (name, values) in enumerate(TURNED.items())
        ]
        for level, snr in enumerate(SNRS)
    ]
    others = [Run(f"null-{k}", "null", 3200 + k) for k in range(NULLS)]
    others += [
        Run(f"pair-{a}-{b}", "pair", 3300 + k, (*_typed(a, TURNED[a][1]), *_typed(b, TURNED[b][1])), SNRS[0])
        for k, (a, b) in enumerate(PAIRS)
    ]
    others += [
        Run(f"outside-{name}", "outside", 3400 + k, _typed(name, TURNED[name][1]), SNRS[0], name)
        for k, name in enumerate(OUTSIDE)
    ]
    others += [
        Run(f"sensor-{fault.partition('=')[0].partition('.')[0]}", "sensor", 3500 + k, fault=fault)
        for k, fault in enumerate(FAULTS)
    ]
    others += [
        Run(f"base-{name}", "base", 3600 + k, _typed(name, values), SNRS[1])
        for k, (name, values) in enumerate(MORE_BASE.items())
    ]
    others += [
        Run(f"decoy-{name}", "decoy", 3700 + k, _typed(name, values)) for k, (name, values) in enumerate(DECOYS.items())
    ]
    turn = sorted(range(len(others)), key=lambda k: (sum(o.set == others[k].set for o in others[:k]), k))
    first = [run for pair in zip(singles[0], [others[k] for k in turn], strict=False) for run in pair]
    return [*first, *(others[k] for k in turn[len(singles[0]) :]), *singles[1]]


def _typed(name: str, values: dict[str, float]) -> tuple[str, ...]:
    ends = {p.name: (p.low, p.high) for p in library()[name].parameters()}
    return tuple(f"{name}.{key}={min(max(value, ends[key][0]), ends[key][1]):g}" for key, value in values.items())


class Loop(Typed):
    """Makes the runs of the plan in one workspace."""

    def __init__(self, workspace: Path, recorded: tuple[str, ...] = ()) -> None:
        """Choose the workspace, and how recordings are made besides what a run says, as typed after `simulate`."""
        super().__init__(workspace, (importlib.resources.files("plop.pipeline") / "profiles" / PROFILE).read_text())
        self.recorded = recorded

    def base(self) -> None:
        """Film recordings without anything hidden and fit the engine to them, once."""
        self.plop("simulate", "block.toml", "--seed", "100", "--name", "plain", *self.recorded)
        self.plop("identify", "--recordings", "plain", "--split", "all", "--name", "base", *FINER)

    def carry_out(self, run: Run) -> dict[str, Any]:
        """Hide, diagnose and score; the answer is opened only after the verdict."""
        started = time.perf_counter()
        if not any(self.filmed(run, share * run.snr) for share in _SHARES):
            hidden: dict[str, dict[str, float]] = {run.hide[0].split(".")[0]: {}}
            return {
                "name": run.name,
                "set": "unreachable",
                "seed": run.seed,
                "hidden": hidden,
                "snr": 0.0,
                "wanted": run.snr,
                "verdict": "-",
                "named": [],
                "judged_by": STAGE.version,
            }
        found = self.diagnosed(run, "base", run.name)
        row = self.row(run, found)
        if run.set == "pair":
            row |= self.next_round(run, found)
        return {**row, "seconds": round(time.perf_counter() - started, 1)}

    def filmed(self, run: Run, snr: float) -> bool:
        """Make the recordings; False where no amplitude in its range gives the signal."""
        words = ["simulate", "block.toml", "--seed", str(run.seed), "--name", run.name, *self.recorded]
        words += [word for text in run.hide for word in ("--hide", text)]
        words += ["--snr", f"{snr:g}"] if snr else []
        words += ["--fault", run.fault] if run.fault else []
        try:
            self.plop(*words)
        except SignalTooWeakError:
            return False
        return True

    def diagnosed(self, run: Run, model: str, name: str) -> dict[str, Any]:
        """Give what `plop diagnose` wrote."""
        kept = [word for law in library() if run.without and law != run.without for word in ("--effects", law)]
        self.plop("diagnose", "--model", model, "--recordings", run.name, "--name", f"verdict-{name}", *kept)
        return dict(json.loads((self.store.find(f"verdict-{name}").path / "diagnosis.json").read_text()))

    def next_round(self, run: Run, found: dict[str, Any]) -> dict[str, Any]:
        """Add what was named, and diagnose again."""
        if not found["verdict"]["named"]:
            return {"next_verdict": None, "next_named": []}
        name, model = found["verdict"]["named"][0], f"better-{run.name}"
        self.plop("augment", "--model", "base", "--effect", name, "--diagnosis", f"verdict-{run.name}", "--name", model)
        verdict = self.diagnosed(run, model, model)["verdict"]
        return {"next_verdict": verdict["kind"], "next_named": verdict["named"]}

    def row(self, run: Run, found: dict[str, Any]) -> dict[str, Any]:
        """Put the verdict beside the answer."""
        answer = open_answer(self.store.find(run.name).path)
        version = self.store.find(f"verdict-{run.name}").manifest.stage_version
        base = json.loads((self.store.find("base").path / "model.json").read_text())["estimates"]
        verdict, ranking = found["verdict"], [law["effect"] for law in found["ranking"]]
        judged = {law["effect"]: law for law in (*found["ranking"][:_JUDGED], found["base"])}
        return {
            "name": run.name,
            "set": run.set,
            "seed": run.seed,
            "hidden": answer["effects"],
            "fault": run.fault,
            "judged_by": version,
            "base": {name: entry["value"] for name, entry in base.items()},
            "wanted": run.snr,
            "rms_mm": 1000 * answer["rms_m"],
            "snr": answer["snr"],
            "verdict": verdict["kind"],
            "named": verdict["named"],
            "text": verdict["text"],
            "ranking": ranking,
            "ranks": [ranking.index(name) + 1 for name in answer["effects"] if name in ranking],
            "error": found["error"],
            "floor": found["floor"],
            "left": verdict["evidence"].get("left"),
            "parameters": {name: law["parameters"] for name, law in judged.items()},
            "gains": {name: law["gain"] for name, law in judged.items()},
            "tests": {name: {key: law[key] for key in _TESTS} for name, law in judged.items()},
            "dropped": found["dropped"],
            "engine_runs": found["engine_runs"],
        }


def main() -> None:
    """Run what is left of the plan and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=240, help="Stop starting runs after so many minutes.")
    parser.add_argument("--work", type=Path, default=Path("artifacts/.bench-physics-cameras"), help="Workspace.")
    parser.add_argument("--out", type=Path, default=Path("docs"), help="Folder with results-physics.md and results/.")
    parser.add_argument("--share", default="1/1", help="K/N: the K-th of N processes; each takes every N-th run.")
    parser.add_argument("--again", action="store_true", help="Also make runs that the tables hold by this version.")
    parser.add_argument("--summary", action="store_true", help="Run nothing.")
    options = parser.parse_args()
    rows = options.work / "rows"
    rows.mkdir(parents=True, exist_ok=True)
    kept = written_rows(options.out / "results" / "physics_cameras.json")
    if not options.summary:
        runs = shared(planned(), options.share)
        go_on(Loop(options.work), runs, rows, {} if options.again else kept, options.minutes)
    write(newest_rows([run.name for run in planned()], rows, kept), options.out)


def go_on(loop: Loop, runs: Iterable[Run], rows: Path, kept: Mapping[str, Row], minutes: float) -> None:
    """Make the base and, for so many minutes, runs that this version has not judged; leave their rows in a folder."""
    deadline = time.monotonic() + 60 * minutes
    with locked(rows.parent / "base.lock"):
        loop.base()
    for run in runs:
        if not is_judged(run.name, rows, kept) and time.monotonic() < deadline:
            row = loop.carry_out(run)
            (rows / f"{run.name}.json").write_text(json.dumps(row, indent=1))
            sys.stdout.write(f"{run.name}: {row['verdict']} {row['named']} (SNR {row['snr']:.2f})\n")
            sys.stdout.flush()


def write(rows: list[dict[str, Any]], out: Path) -> None:
    """Write results/physics_cameras.json and the two tables of results-physics.md."""
    sets = verdict_rates(rows)
    facts = {
        "command": "python -m benchmarks.physics_cameras",
        "versions": versions(),
        "seeds": sorted({row["seed"] for row in rows}),
        "planned": len(planned()),
        "sets": sets,
        "runs": [{key: value for key, value in row.items() if key != "ranking"} for row in rows],
    }
    (out / "results").mkdir(parents=True, exist_ok=True)
    (out / "results" / "physics_cameras.json").write_text(json.dumps(facts, indent=1) + "\n")
    page = out / "results-physics.md"
    text = replace_between_markers(page.read_text(), "cameras-rates", rates_table(sets))
    page.write_text(replace_between_markers(text, "cameras-runs", runs_table(rows)))


def rates_table(sets: dict[str, Any]) -> str:
    """Set the rates beside their goals."""
    rows = [
        ("one effect, SNR >= 2: named first", ("single", "top1")),
        ("one effect, SNR >= 2: in the named set", ("single", "in_set")),
        ("one effect, SNR 1 to 2: named first", ("recovery", "snr_1_to_2")),
        ("one effect: ranked first", ("single", "ranked_first")),
        ("one effect: a wrong name", ("single", "wrong_name")),
        ("nothing hidden: false alarm", ("null", "false_alarm")),
        ("nothing hidden: NONE OF THESE", ("null", "none_of_these")),
        ("a sensor fault only: called physics", ("sensor", "called_physics")),
        ("a sensor fault only: SENSOR", ("sensor", "stopped")),
        ("base parameter changed: in the named set", ("base", "named")),
        ("outside the library: NONE or PARTLY", ("outside", "none_or_partly")),
        ("two effects: both, one after the other", ("pairs", "both_in_turn")),
        ("two effects: at least one", ("pairs", "one")),
        ("decoys chosen, over all runs", ("decoys", "chosen")),
        ("95 % interval covers the parameter", ("parameter_error", "covered")),
    ]
    lines = ["| what | runs | goal |", "|---|---|---|"]
    lines += [f"| {name} | {shown(sets[group][key])} | {GOALS.get((group, key), '')} |" for name, (group, key) in rows]
    for name, key, goal in MEDIANS:
        lines.append(f"| {name} | {median_shown(sets[key])} | {goal} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
