"""The missing-physics benchmark on followed points: `python -m benchmarks.physics_points --minutes 60` (it goes on).

Each run hides something in episodes of the block scene, follows 400 surface points with noise (what an ideal
tracker would give: no cameras), and diagnoses them with an engine of another discretisation and another elastic
law that was fitted to other episodes without anything hidden. Start one process a core, with `--jobs 1` and `--share
1/2` and `2/2`. `--summary` only rewrites the tables. A run that neither the folder nor the tables hold by this version
of `diagnose` is made (anew, with what was hidden before); the others stay as they were written.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType

import numpy as np
from joblib import Parallel, delayed

from benchmarks.measure import plain_json
from benchmarks.newest import Row, is_judged, newest_rows, shared, written_rows
from benchmarks.physics_baselines import baselines
from benchmarks.physics_plan import PLAN, Plan
from benchmarks.physics_response import response_error
from benchmarks.physics_rounds import next_round
from benchmarks.physics_signal import at_signal
from benchmarks.physics_sindy import sindy_ranking
from benchmarks.physics_tables import RESULT, write_results
from plop.artifacts.lock import locked
from plop.artifacts.result_file import to_json
from plop.comparison.discretisations import discretised
from plop.diagnosis.amplitudes import SLOWER
from plop.diagnosis.diagnose import diagnose
from plop.diagnosis.responses import Job
from plop.diagnosis.runs import Runs
from plop.diagnosis.table import Measured
from plop.errors import PlopError
from plop.identification.identify import NAMES, identify, spacing_for
from plop.physics.adapters.base_io import base_from_dict, base_to_dict
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import library
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import ElasticLaw
from plop.physics.hidden.response import slowdown
from plop.physics.scenes import find_scene
from plop.physics.scenes.scene import Scene, simulate_episode
from plop.tracking.episode import Episode, episode_from_sequence
from stages.diagnose.stage import STAGE

NOISE_M = 2e-4
"""Standard deviation of one coordinate of a followed point [m]."""
FLOOR_M = NOISE_M * 3**0.5
"""Noise floor: RMS length of the noise of a followed point [m]."""
FITTED, REFERENCE, EPISODES, SEARCHED, PARTICLES = 6, 12, 8, 4, 1300
"""Episodes without anything hidden that the engine is fitted to, and all of them (the others tell how far it is off
in motions that it has not seen); episodes to explain, and those of them in which a signal is measured; particles of
the diagnosing engine."""
SCENE = replace(Scene.read(find_scene(Path("block.toml"))), name="bench")


@dataclass(frozen=True)
class Setting:
    """What all runs share."""

    reference: Measured
    """Episodes without anything hidden."""
    engine: EngineBase
    """The engine that computes the responses."""
    measured: Callable[[list[Episode]], Measured] = Measured
    """Puts the base's predictions beside episodes, where the base is not the engine."""
    scene: Scene = SCENE
    """Where the episodes are simulated; the seed is each run's."""


def main() -> None:
    """Run what is left of the plan and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=240, help="Stop starting runs after so many minutes.")
    parser.add_argument("--jobs", type=int, default=-1, help="Processes.")
    parser.add_argument("--work", type=Path, default=Path("artifacts/.bench-physics"), help="Where runs are kept.")
    parser.add_argument("--result", default=RESULT, help="Name of the file in results/ and of the tables' markers.")
    parser.add_argument("--particles", type=int, default=PARTICLES, help="Of the diagnosing engine.")
    parser.add_argument("--out", type=Path, default=Path("docs"), help="Folder with results-physics.md and results/.")
    parser.add_argument("--share", default="1/1", help="K/N: the K-th of N processes; each takes every N-th run.")
    parser.add_argument("--summary", action="store_true", help="Run nothing.")
    options = parser.parse_args()
    if not options.summary and find_spec("pysindy") is None:
        parser.error("PySINDy, a baseline, is not installed: pip install -e '.[bench]' (make bench-physics does).")
    options.work.mkdir(parents=True, exist_ok=True)
    deadline = time.monotonic() + (0 if options.summary else 60 * options.minutes)
    written = written_rows(options.out / "results" / f"{options.result}.json")
    if time.monotonic() < deadline:
        with locked(options.work / "base.lock"):
            engine = fitted_engine(options.work, options.jobs, options.particles)
        setting = Setting(Measured(reference(options.jobs)), engine)
        for plan in shared(PLAN, options.share):
            run_missing([plan], setting, options.work, options.jobs, deadline, written)
            if plan.set in ("single", "null") and time.monotonic() < deadline:
                _add_sindy(plan, setting.engine, options.work, options.jobs)
    kept = options.work / "base.json"
    engine = json.loads(kept.read_text()) if kept.is_file() else {}
    command = "python -m benchmarks.physics_points"
    if options.result != RESULT:
        command += f" --particles {options.particles} --work W --result {options.result}"
    rows = newest_rows([plan.name for plan in PLAN], options.work, written)
    write_results(rows, options.out, command=command, engine=engine, result=options.result)


def run_missing(
    plans: list[Plan],
    setting: Setting,
    work: Path,
    jobs: int,
    deadline: float,
    written: Mapping[str, Row] = MappingProxyType({}),
) -> None:
    """Carry out the runs that this version has not judged yet; none is started after the deadline (time.monotonic).

    What an older version's row says is hidden is hidden again: the amplitude is not searched for anew, and what could
    not be given a signal is left out.
    """
    for plan in plans:
        earlier = written.get(plan.name)
        reachable = earlier is None or earlier["set"] != "unreachable"
        if reachable and not is_judged(plan.name, work, written) and time.monotonic() < deadline:
            row = run_plan(plan, setting, work, jobs, earlier)
            (work / f"{plan.name}.json").write_text(json.dumps(row, indent=1))
            sys.stdout.write(f"{plan.name}: {row['verdict']} {row['named']} (SNR {row['snr']:.2f})\n")
            sys.stdout.flush()


def simulated(scene: Scene, seed: int, count: int, effects: list[Effect], jobs: int) -> list[Episode]:
    """Simulate episodes of a scene and follow points of their surface."""
    scene = replace(scene, seed=seed)

    def one(k: int) -> Episode:
        return episode_from_sequence(simulate_episode(scene, k, effects), noise_m=NOISE_M, seed=1000 * seed + k)

    return list(Parallel(n_jobs=jobs)(delayed(one)(k) for k in range(count)))


def reference(jobs: int, scene: Scene = SCENE) -> list[Episode]:
    """Simulate episodes without anything hidden."""
    return simulated(scene, 0, REFERENCE, [], jobs)


def fitted_engine(work: Path, jobs: int, particles: int = PARTICLES) -> EngineBase:
    """Fit the diagnosing engine to the first of the reference episodes, once.

    Raises:
        PlopError: The folder holds runs of an engine of another number of particles.
    """
    path = work / "base.json"
    if not path.is_file():
        episodes = reference(jobs)[:FITTED]
        material = replace(
            SCENE.material,
            law=ElasticLaw.NEO_HOOKEAN,
            youngs_modulus_pa=1.2e4,
            damping_per_s=5.0,
            density_kg_m3=1000.0,
            table_friction=0.4,
            tool_friction=0.2,
            toughness_j_m2=0.0,
        )
        start = EngineBase(material, spacing_for(episodes, particles))
        base, found = identify(episodes, start, (*NAMES, "toughness_j_m2"), iterations=5, jobs=jobs)
        path.write_text(
            json.dumps({"engine": base_to_dict(base), "rms_mm": 1000 * found.rms_after_m, "particles": particles})
        )
    kept = json.loads(path.read_text())
    if kept.get("particles", particles) != particles:
        raise PlopError(
            "The folder holds runs of another engine.",
            where=path,
            expected=f"{particles} particles",
            found=f"{kept['particles']}",
            fix="Choose another --work.",
        )
    return base_from_dict(kept["engine"])


def _add_sindy(plan: Plan, base: EngineBase, work: Path, jobs: int) -> None:
    """Let PySINDy rank the effects of a run that is there, once."""
    path = work / f"{plan.name}.json"
    row = json.loads(path.read_text()) if path.is_file() else {}
    if "sindy" in row.get("baselines", {"sindy": ()}):  # or not diagnosed
        return
    hidden, _ = _hidden(plan, SCENE, jobs, row)  # as the run hid it: scaled to its signal
    episodes = simulated(SCENE, plan.seed, EPISODES, hidden, jobs)
    answers = Runs(work / "jobs", jobs=jobs)([Job(episode, base) for episode in episodes])
    pairs = [(e, a.points) for e, a in zip(episodes, answers, strict=True) if a.points is not None]
    row["baselines"]["sindy"] = sindy_ranking([e for e, _ in pairs], [points for _, points in pairs])
    path.write_text(json.dumps(row, indent=1))
    sys.stdout.write(f"{plan.name}: PySINDy {row['baselines']['sindy'][:3]}\n")
    sys.stdout.flush()


def _rms(episodes: list[Episode], plain: list[Episode]) -> float:
    """Give the RMS displacement between two simulations of the same episodes [m]."""
    moved = [((a.points - a.points[:1]) - (b.points - b.points[:1])) for a, b in zip(episodes, plain, strict=True)]
    return float(np.sqrt(np.mean([(d**2).sum(-1).mean() for d in moved])))


def _hidden(plan: Plan, scene: Scene, jobs: int, earlier: Row | None) -> tuple[list[Effect], float | None]:
    """Build what a run hides; scaled to the plan's signal where it has one, with the weakest of the signals found."""
    types = library()
    if earlier is not None:
        return [types[name](**values) for name, values in earlier["hidden"].items()], None
    if plan.snr is None:
        return plan.effects(types), None
    plain = simulated(scene, plan.seed, SEARCHED, [], jobs)

    def signal(effect: Effect) -> float:
        if slowdown(effect, scene.material, EngineConfig(dx_m=scene.dx_m)) > SLOWER:
            raise PlopError("The amplitude takes too many time steps.", where=effect.name)
        return _rms(simulated(scene, plan.seed, SEARCHED, [effect], jobs), plain) / FLOOR_M

    found = [at_signal(types[name], dict(values), plan.snr, signal) for name, values in plan.hidden]
    return [effect for effect, _ in found], min(reached for _, reached in found)


def run_plan(plan: Plan, setting: Setting, work: Path, jobs: int, earlier: Row | None = None) -> Row:
    """Hide, diagnose and score; the hidden effects are compared with the verdict only afterwards.

    A run whose effect cannot give half the signal that the plan wants, at any amplitude of its range, is not
    diagnosed: it is kept as "unreachable".
    """
    types = library()
    scene, engine = setting.scene, setting.engine
    hidden, reached = _hidden(plan, scene, jobs, earlier)
    facts = {"name": plan.name, "seed": plan.seed, "hidden": {e.name: e.values for e in hidden}, "wanted": plan.snr}
    if plan.snr is not None and reached is not None and reached < plan.snr / 2:
        return {**facts, "set": "unreachable", "snr": reached, "verdict": "-", "named": []}
    episodes = simulated(scene, plan.seed, EPISODES, hidden, jobs)
    plain = simulated(scene, plan.seed, EPISODES, [], jobs) if hidden else episodes
    started = time.perf_counter()
    runs = Runs(work / "jobs", jobs=jobs)
    known = {name: kind for name, kind in types.items() if name not in plan.without}
    found = diagnose(setting.measured(episodes), engine, known, runs, reference=setting.reference)
    rms = _rms(episodes, plain)
    order = [f.name for f in found.findings[:-1]]
    row = {
        **facts,
        "set": plan.set,
        "judged_by": STAGE.version,
        "rms_mm": 1000 * rms,
        "snr": rms / FLOOR_M,
        "verdict": found.verdict.kind,
        "named": found.verdict.named,
        "text": found.verdict.text,
        "ranking": order,
        "ranks": [order.index(e.name) + 1 for e in hidden if e.name in order],
        "error": found.size.error,
        "floor": found.size.floor,
        "left": found.verdict.evidence.left,
        "parameters": {f.name: to_json(f.parameters) for f in found.findings[:3]},
        "gains": {f.name: f.gain for f in found.findings[:3]},
        "judged": [
            asdict(f) | {"parameters": to_json(f.parameters)} for f in (*found.findings[:4], found.findings[-1])
        ],
        "excess": found.size.excess,
        "limits_mm": {k: v.displacement_m and 1000 * v.displacement_m for k, v in found.limits.items()},
        "baselines": baselines(found),
        "seconds": time.perf_counter() - started,
    }
    if plan.set == "single":
        row["response"] = response_error(hidden[0], episodes, plain, discretised(engine), runs)
    if plan.set == "pair":
        later = next_round(found, episodes, setting.reference.episodes, engine, known, runs)
        row |= {"next_verdict": later and later.verdict.kind, "next_named": later.verdict.named if later else []}
    return dict(plain_json(row | {"engine_runs": runs.done}))


if __name__ == "__main__":
    main()
