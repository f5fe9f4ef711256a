"""Plans, scored by carrying them out: does the planned motion settle what was confounded, and does a random one?

Each case hides a law of the library in recordings that repeat the motions of a reference, follows points of the surface
with noise, and diagnoses. Where that leaves laws undistinguished, `plan` chooses a motion and how often to record it;
that motion, and one drawn at random from the same family, are simulated with the hidden law and in the reference as
often, added, and diagnosed again. The world is the engine at another resolution and with another elastic law than the
diagnosing one, which is fitted to the reference.

`run` makes the cases that are lacking and can be stopped at any time; `score` counts the rows into
docs/results/plans.json.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.missing_physics.makers import NOISE_M
from benchmarks.missing_physics.rates import proportion
from plop.artifacts.atomic_file import write_json
from plop.diagnosis.decision.conclusion import Conclusion
from plop.diagnosis.diagnose import diagnose
from plop.diagnosis.responses.runs import Runs
from plop.diagnosis.responses.table import Measured
from plop.errors import PlopError
from plop.identification.identify import NAMES, identify
from plop.physics.adapters.base_io import base_from_dict, base_to_dict
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import library
from plop.physics.engine.material import ElasticLaw
from plop.physics.scenes import find_scene
from plop.physics.scenes.motions import tool_motion
from plop.physics.scenes.scene import Scene, simulate_motion
from plop.planning.motions import Motion
from plop.planning.plan import Planned, Wish, plan
from plop.tracking.episode import Episode, episode_from_sequence
from stages.diagnose.outcome import diagnosis_of
from stages.diagnose.stage import STAGE as DIAGNOSE
from stages.plan.stage import STAGE as PLAN

RESULT = Path(__file__).resolve().parents[2] / "docs" / "results" / "plans.json"
COMMAND = "python -m benchmarks.missing_physics.plans"
WORLD = replace(
    Scene.read(find_scene(Path("block.toml"))), spacing_m=0.0065, dx_m=0.013, motions=("hold", "push"), name="plans"
)
SPACING_M, EPISODES, POINTS = 0.010, 6, 200
"""Distance of the diagnosing engine's particles; recordings in each set; followed points."""
LAWS = ("viscosity", "relaxation", "plasticity", "softening", "stiffening")
"""Laws that are tried, beside stiffness, damping and density: few, to be quick, and alike in a press."""
CASES: tuple[tuple[str, dict[str, float]], ...] = (
    ("viscosity", {"viscosity_pa_s": 250.0}),
    ("relaxation", {"ratio": 0.8, "tau_s": 0.1}),
    ("softening", {"loss": 0.9, "strain": 0.02}),
    ("plasticity", {"softness_per_kpa": 4.0}),
    ("stiffening", {"growth": 300.0}),
    ("damping", {"d_per_s": 60.0}),
    ("density", {"d_ln_rho": 0.6}),
    ("relaxation", {"ratio": 0.8, "tau_s": 0.03}),
    ("viscosity", {"viscosity_pa_s": 120.0}),
    ("softening", {"loss": 0.9, "strain": 0.01}),
    ("plasticity", {"softness_per_kpa": 2.0}),
    ("stiffness", {"d_ln_e": 0.5}),
)
"""What is hidden; case k has motions, noise and draws of seed k // len(CASES)."""


@dataclass(frozen=True)
class Case:
    """One row to be made."""

    number: int

    @property
    def seed(self) -> int:
        """Of motions and noise."""
        return self.number // len(CASES)

    @property
    def hidden(self) -> Effect:
        """What is hidden."""
        law, values = CASES[self.number % len(CASES)]
        return library()[law](**values)


class Plans:
    """The benchmark; everything that it makes is kept in a folder."""

    def __init__(self, work: Path, jobs: int) -> None:
        self.work, self.jobs, self.types = work, jobs, library()

    @cached_property
    def runs(self) -> Runs:
        """Engine runs, remembered."""
        return Runs(self.work / "jobs", jobs=self.jobs)

    @cached_property
    def engine(self) -> EngineBase:
        """The diagnosing engine, fitted to the reference of seed 0, once."""
        path = self.work / "base.json"
        if not path.is_file():
            material = replace(WORLD.material, law=ElasticLaw.NEO_HOOKEAN, youngs_modulus_pa=1.2e4, damping_per_s=5.0)
            start = EngineBase(material, SPACING_M)
            base, _ = identify(self.recorded(0, [], 0), start, NAMES, iterations=5, jobs=self.jobs)
            write_json(path, base_to_dict(base))
        return base_from_dict(json.loads(path.read_text()))

    def recorded(self, seed: int, hidden: Sequence[Effect], noise: int) -> list[Episode]:
        """Simulate the motions of a seed, and follow points with the noise of another."""
        scene = replace(WORLD, seed=seed)
        plans = [scene.motion_plan(k) for k in range(EPISODES)]
        motions = [tool_motion(each, scene.shape, scene.frame_rate_hz) for each in plans]
        return [
            self._followed(seed, k, plans[k].kind, motion, hidden, noise, scene.episode_name(k))
            for k, motion in enumerate(motions)
        ]

    def again(self, seed: int, motion: Motion, count: int, hidden: Sequence[Effect], noise: int) -> list[Episode]:
        """Simulate a motion that is like a recorded one so many times; only the noise differs."""
        k = int(motion.like[-3:])
        kind = replace(WORLD, seed=seed).motion_plan(k).kind
        return [
            self._followed(seed, k, kind, motion.tool, hidden, noise + j, f"{motion.name} {j}") for j in range(count)
        ]

    def _followed(
        self, seed: int, k: int, kind: str, motion: Any, hidden: Sequence[Effect], noise: int, name: str
    ) -> Episode:
        scene = replace(WORLD, seed=seed)
        sequence = simulate_motion(scene, scene.episode_name(k), scene.motion_plan(k), motion, hidden)
        return episode_from_sequence(
            sequence, noise_m=NOISE_M, seed=10_000 * seed + 100 * noise + k, points=POINTS, name=name
        )

    def diagnosed(self, here: list[Episode], reference: list[Episode]) -> Conclusion:
        """Diagnose with the short library."""
        measured, others = Measured(here), Measured(reference)
        return diagnose(measured, self.engine, self.types, self.runs, reference=others, effects=LAWS)

    def carry_out(self, case: Case) -> dict[str, Any]:
        """Hide, diagnose, plan, record what is planned and what is drawn, and diagnose again."""
        hidden, seed = case.hidden, case.seed
        started, here, reference = time.perf_counter(), self.recorded(seed, [hidden], 1), self.recorded(seed, [], 0)
        found = self.diagnosed(here, reference)
        row: dict[str, Any] = {
            "case": case.number,
            "seed": seed,
            "hidden": {hidden.name: hidden.values},
            "verdict": found.verdict.kind,
            "named": list(found.verdict.named),
        }
        if found.verdict.evidence.alternatives:
            kept = diagnosis_of(found, self.types, None, {})
            made = plan(Measured(reference), self.engine, self.types, self.runs, Wish(diagnosis=kept), effects=LAWS)
            row |= self._settled(case, here, reference, made)
        return row | {"seconds": round(time.perf_counter() - started, 1)}

    def _settled(self, case: Case, here: list[Episode], reference: list[Episode], made: Planned) -> dict[str, Any]:
        assert made.separation is not None and made.best is not None
        separation, seed = made.separation, case.seed
        drawn = made.choices[int(np.random.default_rng([77, case.number]).integers(len(made.choices)))]
        row: dict[str, Any] = {
            "laws": list(separation.laws),
            "chance": separation.settled,
            "chance_without": separation.chance,
            "repeats": separation.repeats,
            "family": len(made.choices),
        }
        for label, motion in (("planned", made.best), ("random", drawn)):
            more = self.again(seed, motion, separation.repeats, [case.hidden], 20)
            plain = self.again(seed, motion, separation.repeats, [], 40)
            found = self.diagnosed([*here, *more], [*reference, *plain])
            named = list(found.verdict.named)
            row[label] = {
                "motion": motion.name,
                "change": motion.change,
                "verdict": found.verdict.kind,
                "named": named,
                "unique": not found.verdict.evidence.alternatives and len(named) == 1,
                "right": named == [case.hidden.name],
            }
        return row


def run(options: argparse.Namespace) -> None:
    """Make the cases that are lacking, until so many minutes are over."""
    deadline, bench = time.monotonic() + 60 * options.minutes, Plans(options.work, options.jobs)
    (options.work / "rows").mkdir(parents=True, exist_ok=True)
    for number in range(options.cases):
        path = options.work / "rows" / f"{number:03d}.json"
        if path.is_file():
            continue
        if time.monotonic() >= deadline:
            break
        try:
            row = bench.carry_out(Case(number))
        except PlopError as error:  # it stays in the denominator
            row = {"case": number, "verdict": "failed", "named": [], "why": str(error)[:300]}
        write_json(path, {**row, "diagnose": DIAGNOSE.version, "plan": PLAN.version}, sort_keys=False)
        sys.stdout.write(json.dumps(row) + "\n")
        sys.stdout.flush()


def score(options: argparse.Namespace) -> None:
    """Count the rows."""
    rows = [json.loads(path.read_text()) for path in sorted((options.work / "rows").glob("*.json"))]
    write_json(options.result, counted(rows, f"{COMMAND} run && {COMMAND} score"), sort_keys=False)


def counted(rows: Sequence[dict[str, Any]], command: str) -> dict[str, Any]:
    """Give the rates with their 95 % intervals, and the rows."""
    confounded = [row for row in rows if "planned" in row]
    return {
        "command": command,
        "version": version("plop"),
        "stages": {stage.name: stage.version for stage in (DIAGNOSE, PLAN)},
        "cases": len(rows),
        "confounded": len(confounded),
        "rates": {
            f"{arm}_{what}": proportion(sum(row[arm][what] for row in confounded), len(confounded))
            for arm in ("planned", "random")
            for what in ("unique", "right")
        },
        "laws": list(LAWS),
        "rows": list(rows),
    }


def parsed(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(prog=COMMAND, description=__doc__)
    commands = parser.add_subparsers(required=True)
    for work in (run, score):
        command = commands.add_parser(work.__name__, help=work.__doc__)
        command.set_defaults(command=work)
        command.add_argument("--work", type=Path, default=Path("artifacts") / ".bench-plans")
        command.add_argument("--result", type=Path, default=RESULT)
        command.add_argument("--minutes", type=float, default=240)
        command.add_argument("--cases", type=int, default=3 * len(CASES))
        command.add_argument("--jobs", type=int, default=-1)
    return parser.parse_args(words)


if __name__ == "__main__":
    options = parsed()
    options.command(options)
