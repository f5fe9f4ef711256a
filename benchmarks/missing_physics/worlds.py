"""The third edition: what `diagnose` says of recordings that other engines made, over many bases.

    python -m benchmarks.missing_physics.worlds run --minutes 60 --first-seed 5000
    python -m benchmarks.missing_physics.worlds score

Every base is a soft block of its own (stiffness, friction, damping, taper) in one of three worlds: plop's engine with
other particles and another elastic law, MuJoCo, Drake (`pip install -e '.[worlds]'`). The engine is fitted to six
reference episodes by `identify`, then sets of six episodes are judged, with unlike or with repeated motions; each of
them once more without reference, and by other methods. Points are followed ideally, with 0.2 mm of noise. A verdict is
written, with its SHA-256, before it is compared with what was hidden. Goes on where it stopped; run it with seeds that
nobody has looked at, and once for each version of `diagnose`.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from benchmarks.missing_physics.other_methods import other_methods
from benchmarks.missing_physics.rates import GOALS, rates_of, rivals_of
from benchmarks.worlds.scene import GRAVITY_M_S2, Motion, World
from plop.artifacts.atomic_file import write_json
from plop.diagnosis.diagnose import diagnose
from plop.diagnosis.rule import RULE
from plop.diagnosis.runs import Runs
from plop.diagnosis.search import Search
from plop.diagnosis.table import Measured
from plop.finite import json_ready
from plop.identification.identify import NAMES, identify, spacing_for
from plop.physics.adapters.base_io import base_from_dict, base_to_dict
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.library import effect_type, library
from plop.physics.engine.material import ElasticLaw, Material
from plop.physics.scenes.motions import MotionRanges
from plop.physics.scenes.scene import Scene, simulate_episode
from plop.physics.scenes.shapes import Shape
from plop.pipeline.execute import versions
from plop.tracking.episode import Episode, episode_from_sequence
from stages.diagnose.outcome import diagnosis_of
from stages.diagnose.stage import STAGE

RESULTS = Path(__file__).resolve().parents[2] / "docs" / "results"
EPISODES, NOISE_M, POINTS, PARTICLES = 6, 2e-4, 300, 400
DEALT = 20
"""Other ways of dealing the episodes of a null out that are judged as if each were the real one."""
LEAST_SNR = 2.0
"""Displacement by what is hidden over the noise of a point, from which on it counts for the goals."""
TRIES = 6
"""How often an amplitude is made 1.5 times larger to reach that."""
Values = dict[str, float]


class Maker(Protocol):
    """One object in one world."""

    def episode(self, number: int, hidden: Mapping[str, Values]) -> Episode:
        """Record a motion without noise's seed mattering to it; `number` draws the motion."""

    def drawn(self, law: str, random: np.random.Generator, times: float) -> tuple[Values, dict[str, Values]]:
        """Draw a change: what to hide, and what is to be found in terms of the library."""

    laws: tuple[str, ...]


class Own:
    """plop's engine with coarser or finer particles and the fixed corotated law."""

    laws = (
        *("swelling", "tilt", "table_friction", "viscosity", "plasticity", "relaxation", "fibres", "softening"),
        *("stiffening", "adhesion", "blade_friction", "stiffness", "damping"),
    )

    def __init__(self, seed: int) -> None:
        r = np.random.default_rng([seed, 1])
        material = Material(
            youngs_modulus_pa=float(np.exp(r.uniform(np.log(8e3), np.log(3e4)))),
            damping_per_s=float(r.uniform(3, 10)),
            table_friction=float(r.uniform(0.3, 0.7)),
            tool_friction=float(r.uniform(0.3, 0.7)),
            law=ElasticLaw.FIXED_COROTATED,
        )
        self.scene = Scene(
            name="block",
            motions=("hold", "push"),
            frame_rate_hz=20,
            spacing_m=0.006,
            dx_m=0.012,
            shape=Shape("block", (0.060, 0.050, 0.040)),
            material=material,
            seed=seed,
            motion=MotionRanges(press_speed_m_s=(0.08, 0.12), hold_s=(0.1, 0.1), aside_speed_m_s=(0.1, 0.1)),
        )

    def episode(self, number: int, hidden: Mapping[str, Values]) -> Episode:
        """See `Maker`."""
        effects = [effect_type(name)(**values) for name, values in hidden.items()]
        return _followed(simulate_episode(self.scene, number, effects), number)

    def drawn(self, law: str, random: np.random.Generator, times: float) -> tuple[Values, dict[str, Values]]:
        """See `Maker`."""
        kind, values, scale = effect_type(law), {}, times * float(np.exp(random.uniform(-0.3, 0.3)))
        for p in kind.amplitudes:
            sign = -1 if p.low < 0 and random.random() < 0.5 else 1
            values[p.name] = float(np.clip(sign * (p.typical or p.step) * scale, p.low, p.high))
        found = dict(values)
        for p in kind.shapes:
            free = random.uniform(0, 180) if p.unit == "deg" else p.default * np.exp(random.uniform(-0.3, 0.3))
            values[p.name] = float(np.clip(free, p.low, p.high))
        return values, {law: found}


class Foreign:
    """MuJoCo or Drake: presses, pushes and drags of a tapered block."""

    laws = ("tilt", "table_friction", "stiffness", "damping", "blade_friction")
    outside = "stiffness_damping"

    def __init__(self, simulator: str, seed: int) -> None:
        self.record: Callable[..., Any] = importlib.import_module(f"benchmarks.worlds.{simulator}").record
        r = np.random.default_rng([seed, 3])
        self.seed = seed
        self.world = World(
            youngs_modulus_pa=float(np.exp(r.uniform(np.log(1e4), np.log(3e4)))),
            table_friction=float(r.uniform(0.3, 0.7)),
            tool_friction=float(r.uniform(0.3, 0.7)),
            damping_per_s=float(r.uniform(1, 6)),
            taper=float(r.uniform(0, 0.2)),
            cells_m=0.0075,
            time_step_s={"drake": 0.005, "mujoco": 0.002}[simulator],
        )

    def episode(self, number: int, hidden: Mapping[str, Values]) -> Episode:
        """See `Maker`; hidden are changes of the world's own numbers."""
        changes: dict[str, Any] = {k: v for values in hidden.values() for k, v in values.items()}
        if "tilt_x_deg" in changes:
            changes["tilt_deg"] = (changes.pop("tilt_x_deg"), changes.pop("tilt_y_deg"))
        return _followed(self.record(replace(self.world, **changes), self._motion(number)), number)

    def _motion(self, number: int) -> Motion:
        r = np.random.default_rng([self.seed, 9, number])
        kind = ("press", "push", "drag")[number % 3]
        return Motion(
            kind,
            tool="box" if r.random() < 0.5 else "cylinder",
            x_m=float(r.uniform(-0.006, 0.006)),
            y_m=float(r.uniform(-0.004, 0.004)),
            yaw_rad=float(r.uniform(-0.4, 0.4)),
            depth_m=float(r.uniform(0.005, 0.008)) if kind == "press" else 0.004,
            aside_m=float(r.uniform(0.01, 0.016)),
            speed_m_s=float(r.uniform(0.04, 0.08)),
        )

    def drawn(self, law: str, random: np.random.Generator, times: float) -> tuple[Values, dict[str, Values]]:
        """See `Maker`."""
        world, up = self.world, random.random() < 0.5
        if law == "tilt":
            x, y = (float(times * sign * random.uniform(1.0, 3.0)) for sign in random.choice([-1, 1], 2))
            found = {"gx_m_s2": GRAVITY_M_S2 * np.sin(np.deg2rad(x)), "gy_m_s2": GRAVITY_M_S2 * np.sin(np.deg2rad(y))}
            return {"tilt_x_deg": x, "tilt_y_deg": y}, {law: found}
        if law in ("table_friction", "blade_friction"):
            name = {"blade_friction": "tool_friction"}.get(law, law)
            was = getattr(world, name)
            now = float(np.clip(was * (1 + times * (0.5 if up else -0.4)), 0.03, 2.0))
            return {name: now}, {law: {"d_mu": now - was}}
        if law == "stiffness":
            ratio = float(np.exp(times * (0.4 if up else -0.4)))
            return {"youngs_modulus_pa": ratio * world.youngs_modulus_pa}, {law: {"d_ln_e": np.log(ratio)}}
        if law == "damping":
            more = 30.0 * times
            return {"damping_per_s": world.damping_per_s + more}, {law: {"d_per_s": more}}
        # the library's viscosity is the nearest to it, and is left out where this is hidden
        return {"stiffness_damping_s": 0.01 * times}, {law: {}, "viscosity": {}}


def _followed(sequence: Any, number: int) -> Episode:
    episode = episode_from_sequence(sequence, noise_m=NOISE_M, seed=number, points=POINTS)
    return replace(episode, name=f"e{number:04d}")


WORLDS: dict[str, Callable[[int], Any]] = {
    "own": Own,
    "mujoco": lambda seed: Foreign("mujoco", seed),
    "drake": lambda seed: Foreign("drake", seed),
}


def plan(first_seed: int, bases: int, worlds: Sequence[str]) -> Iterator[tuple[str, int, str, str, bool]]:
    """List the sets in the order in which they are made: world, seed of the base, group, law, repeated motions."""
    for k in range(bases):
        for world in worlds:
            seed = first_seed + k
            random = np.random.default_rng([seed, 7])
            maker_laws = (Own if world == "own" else Foreign).laws
            first, second, third = random.permutation(maker_laws)[:3]
            for repeated in (False, True):
                yield world, seed, "null", "", repeated
            yield world, seed, "single", str(first), bool(k % 2)
            yield world, seed, "single", str(second), not k % 2
            if world == "own":
                yield world, seed, "outside", str(third), bool(k % 2)
                yield world, seed, "pair", f"{first}+{third}", not k % 2
            else:
                yield world, seed, "outside", Foreign.outside, bool(k % 2)


class Bench:
    """What is kept of the bases, and the rows."""

    def __init__(self, work: Path, jobs: int) -> None:
        self.work, self.jobs = work, jobs
        (work / "rows").mkdir(parents=True, exist_ok=True)

    def base(self, world: str, seed: int, maker: Any) -> tuple[EngineBase, list[Episode]]:
        """Fit the engine to six episodes in which nothing is hidden, once."""
        path = self.work / f"base-{world}-{seed}.json"
        reference = [maker.episode(k, {}) for k in range(EPISODES)]
        if not path.is_file():
            start = EngineBase(
                Material(1.2e4, 0.4, damping_per_s=3.0, table_friction=0.4, tool_friction=0.4, table_slip_m_s=0.003),
                spacing_for(reference, PARTICLES),
                True,
            )
            base, found = identify(reference, start, NAMES, iterations=12, jobs=self.jobs)
            write_json(path, {"engine": base_to_dict(base), "rms_mm": 1000 * found.rms_after_m})
        return base_from_dict(json.loads(path.read_text())["engine"]), reference

    def row(self, world: str, seed: int, group: str, law: str, repeated: bool) -> dict[str, Any]:
        """Hide, judge, and only then compare."""
        started, maker = time.process_time(), WORLDS[world](seed)
        base, reference = self.base(world, seed, maker)
        first = 0 if repeated else 60 + 6 * len(law)
        hidden, truth, episodes, snr = self._hidden(maker, [seed, len(law), repeated], law, first)
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
            "base_rms_mm": json.loads((self.work / f"base-{world}-{seed}.json").read_text())["rms_mm"],
            "judged_by": STAGE.version,
            "cpu_s": round(time.process_time() - started, 1),
        }

    def _hidden(
        self, maker: Any, seeds: Sequence[int], law: str, first: int
    ) -> tuple[dict[str, Values], dict[str, Values], list[Episode], float]:
        """Make the episodes, with amplitudes that can be seen if that can be had."""
        if not law:
            return {}, {}, [_renoised(maker.episode(first + k, {}), k) for k in range(EPISODES)], 0.0
        plain = [maker.episode(first + k, {}) for k in range(EPISODES)]
        hidden, truth, episodes, snr = {}, {}, plain, 0.0
        for number in range(TRIES):
            hidden, truth = {}, {}
            for each in law.split("+"):
                random = np.random.default_rng([*map(int, seeds), 5])
                hidden[each], found = maker.drawn(each, random, 1.5**number)
                truth |= found
            try:
                trial = [maker.episode(first + k, hidden) for k in range(EPISODES)]
            except Exception as error:
                sys.stdout.write(f"  {law} x {1.5**number:.2f}: {error}\n")
                break
            episodes, snr = trial, _rms_m(trial, plain) / (NOISE_M * 3**0.5)
            if snr >= LEAST_SNR:
                break
        return hidden, truth, [_renoised(e, k) for k, e in enumerate(episodes)], snr


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


def score(work: Path, out: Path, command: str) -> None:
    """Write the result file."""
    rows = [json.loads(path.read_text()) for path in sorted((work / "rows").glob("*.json"))]
    repeated = {"repeated motions": True, "unlike motions": False}
    facts = {
        "command": command,
        "versions": versions(),
        "judged_by": sorted({row["judged_by"] for row in rows}),
        "seeds": sorted({row["seed"] for row in rows}),
        "bases": len({(row["world"], row["seed"]) for row in rows}),
        "rates": rates_of(rows, "reference"),
        "by_scenario": {
            **{
                name: rates_of([r for r in rows if r["repeated"] == flag], "reference")
                for name, flag in repeated.items()
            },
            "no reference": rates_of(rows, "none"),
        },
        "by_world": {w: rates_of([r for r in rows if r["world"] == w], "reference") for w in WORLDS},
        "rivals": rivals_of(rows),
        "goals": {name: f"{sign} {value:g}" for name, (sign, value) in GOALS.items()},
        "cpu_s": {"median": float(np.median([row["cpu_s"] for row in rows])) if rows else None, "n": len(rows)},
        "runs": rows,
    }
    write_json(out, json_ready(facts), sort_keys=False)


def main() -> None:
    """Do what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["run", "score"])
    parser.add_argument("--work", type=Path, default=Path("artifacts/.bench-worlds"))
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--first-seed", type=int, default=5000)
    parser.add_argument("--bases", type=int, default=15, help="bases in each world")
    parser.add_argument("--worlds", default="own,mujoco,drake")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=RESULTS / "missing_physics_0.2.0.json")
    options = parser.parse_args()
    bench, deadline = Bench(options.work, options.jobs), time.monotonic() + 60 * options.minutes
    if options.what == "run":
        for world, seed, group, law, repeated in plan(options.first_seed, options.bases, options.worlds.split(",")):
            path = options.work / "rows" / f"{world}-{seed}-{group}-{law or 'none'}-{int(repeated)}.json"
            if time.monotonic() > deadline:
                break
            if not path.is_file():
                row = bench.row(world, seed, group, law, repeated)
                write_json(path, json_ready(row), sort_keys=False)
                verdict = row["said"]["reference"]["verdict"]
                sys.stdout.write(f"{path.stem}: {verdict['kind']} {verdict['named']} (SNR {row['snr']:.1f})\n")
                sys.stdout.flush()
        return
    score(options.work, options.out, "python -m benchmarks.missing_physics.worlds run, then score")


if __name__ == "__main__":
    main()
