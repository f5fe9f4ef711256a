"""Missing physics on followed points, as an ideal tracker would give them: no cameras.

Each run hides something in episodes of the block scene, follows 400 surface points with noise, and diagnoses them with
an engine of another discretisation and another elastic law, fitted to other episodes in which nothing is hidden. Other
methods are given the same evidence.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from benchmarks.missing_physics.other_methods import other_methods
from benchmarks.missing_physics.plan import Run, points_plan
from benchmarks.missing_physics.response import response_error
from benchmarks.missing_physics.row import Group, Row, judged
from benchmarks.missing_physics.runner import unreachable
from benchmarks.missing_physics.sindy import sindy_ranking
from plop.comparison.discretisations import discretised, predicted_by_each
from plop.diagnosis.conclusion import Conclusion
from plop.diagnosis.diagnose import diagnose
from plop.diagnosis.responses import Job
from plop.diagnosis.runs import Runs
from plop.diagnosis.table import Measured
from plop.errors import PlopError, SignalTooWeakError
from plop.identification.identify import NAMES, identify, spacing_for
from plop.physics.adapters.base_io import base_from_dict, base_to_dict
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import EffectType, library
from plop.physics.engine.material import ElasticLaw
from plop.physics.hidden.choose import choose
from plop.physics.hidden.wish import Wish
from plop.physics.scenes import find_scene
from plop.physics.scenes.scene import Scene, simulate_episode
from plop.tracking.episode import Episode, episode_from_sequence
from stages.diagnose.outcome import diagnosis_of

NOISE_M = 2e-4
"""Standard deviation of one coordinate of a followed point [m]."""
FLOOR_M = NOISE_M * 3**0.5
"""Noise floor: RMS length of the noise of a followed point [m]."""
FITTED, REFERENCE, EPISODES, PARTICLES = 6, 12, 8, 1300
"""Episodes in which nothing is hidden that the engine is fitted to, and all of them (the others show how far it is off
in motions that it has not seen); episodes to explain; particles of the diagnosing engine."""
SCENE = replace(Scene.read(find_scene(Path("block.toml"))), name="bench")
_ADDED = {"EFFECT": None, "PARTLY": 1, "CONFOUNDED": 1, "BASE PARAMETER": 1}
"""Verdict -> how many of the named are added to the base (None: all; the others name alternatives)."""


class Points:
    """The benchmark on followed points."""

    def __init__(self, work: Path, *, particles: int = PARTICLES, jobs: int = -1) -> None:
        """Choose where runs are kept, the particles of the diagnosing engine, and the number of processes."""
        self.work, self.particles, self.jobs = work, particles, jobs
        self.plan: Sequence[Run] = points_plan()

    def prepare(self) -> None:
        """Fit the engine.

        Raises:
            PlopError: PySINDy, one of the other methods, is not installed.
        """
        if find_spec("pysindy") is None:
            raise PlopError("PySINDy is not installed.", fix="pip install -e '.[bench]' (make bench-physics does).")
        self.engine  # noqa: B018

    @cached_property
    def engine(self) -> EngineBase:
        """The engine that diagnoses."""
        return fitted_engine(self.work, self.jobs, self.particles)

    @cached_property
    def reference(self) -> Measured:
        """Episodes in which nothing is hidden."""
        return Measured(simulated(SCENE, 0, REFERENCE, [], self.jobs))

    def hidden(self, run: Run, earlier: Row | None) -> list[Effect]:
        """Build what a run hides, scaled to its signal where it has one.

        Raises:
            SignalTooWeakError: No amplitude in its range gives half the signal.
        """
        types = library()
        if earlier is not None:
            return [types[name](**values) for name, values in earlier.hidden.items()]
        if run.snr is None:
            return run.effects()
        wishes = [Wish(types[name], dict(values)) for name, values in run.hidden]
        scene = replace(SCENE, seed=run.seed)
        try:
            return choose(scene, wishes, snr=run.snr, noise_floor_m=FLOOR_M, effects=types, jobs=self.jobs)
        except SignalTooWeakError:
            return choose(scene, wishes, snr=run.snr / 2, noise_floor_m=FLOOR_M, effects=types, jobs=self.jobs)

    def carry_out(self, run: Run, earlier: Row | None) -> Row:
        """See `Benchmark`."""
        try:
            hidden = self.hidden(run, earlier)
        except SignalTooWeakError:
            return unreachable(run)
        episodes = simulated(SCENE, run.seed, EPISODES, hidden, self.jobs)
        plain = simulated(SCENE, run.seed, EPISODES, [], self.jobs) if hidden else episodes
        known = {name: kind for name, kind in library().items() if name != run.without}
        runs = Runs(self.work / "jobs", jobs=self.jobs)
        found = diagnose(Measured(episodes), self.engine, known, runs, reference=self.reference)
        rms = rms_m(episodes, plain)
        told = {effect.name: effect.values for effect in hidden}
        facts = diagnosis_of(found, known, (), {}, engine_runs=runs.done).to_json()
        methods = other_methods(found)
        if run.group in (Group.SINGLE, Group.NULL):
            methods["sindy"] = self.sindy(episodes, runs)
        response = later = None
        if run.group is Group.SINGLE:
            response = response_error(hidden[0], episodes, plain, discretised(self.engine), runs)
        if run.group is Group.PAIR:
            later = self.next_round(found, episodes, known, runs)
        return Row(
            run.name,
            run.group,
            run.seed,
            told,
            rms / FLOOR_M,
            wanted=run.snr,
            rms_mm=1000 * rms,
            baselines=methods,
            response=response,
            next_verdict=later.verdict.kind if later else None,
            next_named=(list(later.verdict.named) if later else []) if run.group is Group.PAIR else None,
            **judged(facts, told),
        )

    def sindy(self, episodes: list[Episode], runs: Runs) -> list[list[str]]:
        """Let PySINDy rank the effects by the accelerations that the base misses."""
        answers = runs([Job(episode, self.engine) for episode in episodes])
        pairs = [(e, a.points) for e, a in zip(episodes, answers, strict=True) if a.points is not None]
        return sindy_ranking([e for e, _ in pairs], [points for _, points in pairs])

    def next_round(
        self, found: Conclusion, episodes: list[Episode], types: Mapping[str, EffectType], runs: Runs
    ) -> Conclusion | None:
        """Diagnose again with what was named added to the base; None when nothing was named.

        Nothing is hidden in the reference, so that its episodes are predicted by the base alone.
        """
        added = named_effects(found, types)
        if not added:
            return None
        points = Parallel(n_jobs=self.jobs)(delayed(predicted_by_each)(self.engine, e, added) for e in episodes)
        predictions = {e.name: p for e, p in zip(episodes, points, strict=True)}
        return diagnose(Measured(episodes, predictions), self.engine, types, runs, reference=self.reference)


def simulated(scene: Scene, seed: int, count: int, effects: Sequence[Effect], jobs: int) -> list[Episode]:
    """Simulate episodes of a scene and follow points of their surface."""
    scene = replace(scene, seed=seed)

    def one(k: int) -> Episode:
        return episode_from_sequence(simulate_episode(scene, k, effects), noise_m=NOISE_M, seed=1000 * seed + k)

    return list(Parallel(n_jobs=jobs)(delayed(one)(k) for k in range(count)))


def rms_m(episodes: list[Episode], plain: list[Episode]) -> float:
    """Give the RMS displacement between two simulations of the same episodes [m]."""
    moved = [((a.points - a.points[:1]) - (b.points - b.points[:1])) for a, b in zip(episodes, plain, strict=True)]
    return float(np.sqrt(np.mean([(d**2).sum(-1).mean() for d in moved])))


def named_effects(found: Conclusion, types: Mapping[str, EffectType]) -> list[Effect]:
    """Build what the verdict names, with the fitted parameters; empty when it names nothing to add."""
    if found.verdict.kind not in _ADDED:
        return []
    effects = []
    for name in found.verdict.named[: _ADDED[found.verdict.kind]]:
        finding = next((f for f in found.findings if f.name == name), found.findings[-1])
        own = {
            p.name: finding.parameters[p.name].value for p in types[name].parameters() if p.name in finding.parameters
        }
        effects += [types[name](**own)] if own else []
    return effects


def fitted_engine(work: Path, jobs: int, particles: int = PARTICLES) -> EngineBase:
    """Fit the diagnosing engine to the first of the reference episodes, once.

    Raises:
        PlopError: The folder holds runs of an engine of another number of particles.
    """
    path = work / "base.json"
    if not path.is_file():
        episodes = simulated(SCENE, 0, REFERENCE, [], jobs)[:FITTED]
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
        facts = {"engine": base_to_dict(base), "rms_mm": 1000 * found.rms_after_m, "particles": particles}
        path.write_text(json.dumps(facts))
    kept: dict[str, Any] = json.loads(path.read_text())
    if kept.get("particles", particles) != particles:
        raise PlopError(
            "The folder holds runs of another engine.",
            where=path,
            expected=f"{particles} particles",
            found=f"{kept['particles']}",
            fix="Choose another --work.",
        )
    return base_from_dict(kept["engine"])
