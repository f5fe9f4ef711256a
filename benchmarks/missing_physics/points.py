"""Missing physics on followed points: the method without cameras, in worlds of other engines.

The engine is fitted to reference episodes by `identify`; sets of as many episodes are judged with that reference, once
more without one, and by other methods. A verdict is written, with its SHA-256, before it is compared with what was
hidden.
"""

from __future__ import annotations

import hashlib
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.missing_physics.makers import NOISE_M, WORLDS, Values
from benchmarks.missing_physics.other_methods import other_methods
from benchmarks.missing_physics.plan import Set
from plop.artifacts.atomic_file import write_json
from plop.comparison.discretisations import spacing_for
from plop.diagnosis.diagnose import diagnose
from plop.diagnosis.responses.runs import Runs
from plop.diagnosis.responses.table import Measured
from plop.diagnosis.rule import RULE
from plop.diagnosis.scores.search import Search
from plop.finite import json_ready
from plop.identification.identify import NAMES, PARTICLES, identify
from plop.physics.adapters.base_io import base_from_dict, base_to_dict
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.library import library
from plop.physics.engine.material import Material
from plop.tracking.episode import Episode
from stages.diagnose.outcome import diagnosis_of
from stages.diagnose.stage import STAGE

START = Material(1.2e4, 0.4, damping_per_s=3.0, table_friction=0.4, tool_friction=0.4, table_slip_m_s=0.003)
"""From which the engine is fitted."""
EPISODES = 6
"""To explain, and as many of the reference."""
DEALT = 20
"""Other ways of dealing the episodes of a null out that are judged as if each were the real one."""
LEAST_SNR = 2.0
"""Displacement by what is hidden over the noise of a point, from which on it counts for the goals."""
TRIES = 6
"""How often an amplitude is made 1.5 times larger to reach that."""


class Points:
    """What is kept of the bases, and the rows."""

    def __init__(self, work: Path, jobs: int, particles: int = PARTICLES, episodes: int = EPISODES) -> None:
        self.work, self.jobs, self.particles, self.episodes = work, jobs, particles, episodes
        (work / "rows").mkdir(parents=True, exist_ok=True)

    def base(self, world: str, seed: int, maker: Any) -> tuple[EngineBase, list[Episode]]:
        """Fit the engine to episodes in which nothing is hidden, once."""
        path = self.work / f"base-{world}-{seed}.json"
        reference = [maker.episode(k, {}) for k in range(self.episodes)]
        if not path.is_file():
            start = EngineBase(START, spacing_for(reference, self.particles), True)
            base, found = identify(reference, start, NAMES, iterations=12, jobs=self.jobs)
            estimates = {name: estimate.to_json() for name, estimate in found.estimates.items()}
            facts = {"rms_mm": 1000 * found.rms_after_m, "declared": maker.declared, "estimates": estimates}
            write_json(path, {"engine": base_to_dict(base), "facts": json_ready(facts)})
        return base_from_dict(json.loads(path.read_text())["engine"]), reference

    def row(self, one: Set) -> dict[str, Any]:
        """Hide, judge, and only then compare."""
        world, seed, group, law, repeated = one
        started, maker = time.process_time(), WORLDS[world](seed)
        base, reference = self.base(world, seed, maker)
        hidden, truth, episodes, snr = self.hidden(maker, one)
        types = {n: t for n, t in library().items() if not (group == "outside" and n in truth)}
        known, judged, dealt = {}, None, list[bool]()
        for scenario, other in (("reference", Measured(reference)), ("none", None)):
            runs = Runs(self.work / "jobs", jobs=self.jobs)
            found = diagnose(Measured(episodes), base, types, runs, reference=other)
            kept = diagnosis_of(found, types, (), {}).to_json()
            known[scenario] = {key: kept[key] for key in ("verdict", "searches", "error", "floor")}
            known[scenario]["ranking"] = kept["ranking"][:3]
            if judged is None:
                judged = other_methods(found)
                dealt = alarms(found.search) if group == "null" else []
            runs.forget()
        text = json.dumps(json_ready(known), sort_keys=True)
        return {
            "world": world,
            "seed": seed,
            "group": group if snr >= LEAST_SNR or group == "null" else f"{group} below",
            "law": law,
            "repeated": repeated,
            "digest": hashlib.sha256(text.encode()).hexdigest(),
            "said": json.loads(text),
            "rivals": judged,
            "dealt": dealt,
            "hidden": hidden,
            "truth": truth,
            "snr": snr,
            "base": json.loads((self.work / f"base-{world}-{seed}.json").read_text())["facts"],
            "judged_by": STAGE.version,
            "particles": self.particles,
            "episodes": self.episodes,
            "cpu_s": round(time.process_time() - started, 1),
        }

    def hidden(self, maker: Any, one: Set) -> tuple[dict[str, Values], dict[str, Values], list[Episode], float]:
        """Make the episodes of a set, with amplitudes that can be seen if that can be had.

        Returns:
            What is hidden, in numbers of the world and in those of the library, the episodes, and the SNR.
        """
        law, first = one.law, one.first
        seeds = [one.seed, len(law), one.repeated]
        if not law:
            return {}, {}, [_renoised(maker.episode(first + k, {}), k) for k in range(self.episodes)], 0.0
        plain = [maker.episode(first + k, {}) for k in range(self.episodes)]
        hidden, truth = dict[str, Values](), dict[str, Values]()
        episodes, snr = plain, np.inf
        for each in law.split("+"):  # each law of a pair must be seen by itself
            values, found, alone, own = self._seen(maker, seeds, each, first, plain)
            hidden[each], truth, episodes, snr = values, truth | found, alone, min(snr, own)
        if len(hidden) > 1:
            both = _recorded(maker, first, hidden, self.episodes)
            episodes, snr = (plain, 0.0) if both is None else (both, snr)
        return hidden, truth, [_renoised(e, k) for k, e in enumerate(episodes)], snr

    def _seen(
        self, maker: Any, seeds: Sequence[int], law: str, first: int, plain: Sequence[Episode]
    ) -> tuple[Values, dict[str, Values], list[Episode], float]:
        """Make one law large enough: give its values, what is to be found, the episodes, and its SNR."""
        values, truth, episodes, snr = dict[str, float](), dict[str, Values](), list(plain), 0.0
        for number in range(TRIES):
            larger, found = maker.drawn(law, np.random.default_rng([*map(int, seeds), 5]), 1.5**number)
            trial = _recorded(maker, first, {law: larger}, self.episodes)
            if trial is None:
                break
            values, truth, episodes, snr = larger, found, trial, _rms_m(trial, plain) / (NOISE_M * 3**0.5)
            if snr >= LEAST_SNR:
                break
        return values, truth, episodes, snr


def _recorded(maker: Any, first: int, hidden: dict[str, Values], count: int) -> list[Episode] | None:
    """Make the episodes; None where the world cannot run so."""
    try:
        return [maker.episode(first + k, hidden) for k in range(count)]
    except Exception as error:
        sys.stdout.write(f"  {hidden}: {error}\n")
        return None


def alarms(search: Search) -> list[bool]:
    """Tell for some ways of dealing the episodes of a null out whether they raise an alarm, a false one."""
    others = np.random.default_rng(0).permutation(np.arange(1, len(search.ways)))[:DEALT]
    return [dealt.alarmed(RULE.alarm) for dealt in map(search.dealt, others)]


def _renoised(episode: Episode, number: int) -> Episode:
    """Follow the same motion with noise of its own: a repeated motion is not the same recording."""
    noise = np.random.default_rng([number, 77]).normal(0, NOISE_M, episode.points.shape)
    points = episode.points + noise
    return replace(episode, points=points, noise_m=NOISE_M * 2**0.5, name=f"{episode.name}b")


def _rms_m(episodes: Sequence[Episode], plain: Sequence[Episode]) -> float:
    moved = [(a.points - a.points[:1]) - (b.points - b.points[:1]) for a, b in zip(episodes, plain, strict=True)]
    return float(np.sqrt(np.mean([(m**2).sum(-1).mean() for m in moved])))
