"""Objects in several worlds, and what can be hidden in them; points of the surface are followed, with 0.2 mm of noise.

Worlds are plop's engine with other particles and another elastic law, MuJoCo and Drake. Every seed is a soft block of
its own: stiffness, friction, damping, taper.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from benchmarks.worlds.scene import CELLS_M, GRAVITY_M_S2, TIME_STEP_S, Motion, World
from plop.physics.effects.library import effect_type
from plop.physics.engine.material import ElasticLaw, Material
from plop.physics.scenes.motions import MotionRanges
from plop.physics.scenes.scene import Scene, simulate_episode
from plop.physics.scenes.shapes import Shape
from plop.recordings.readers.mesh.sequence import MeshSequence
from plop.tracking.episode import Episode, episode_from_sequence

NOISE_M, POINTS = 2e-4, 300
Values = dict[str, float]
DECLARED = ("youngs_modulus_pa", "table_friction", "tool_friction")
"""Parameters that `identify` fits and every world is given."""


class Maker(Protocol):
    """One object in one world."""

    def episode(self, number: int, hidden: Mapping[str, Values]) -> Episode:
        """Record a motion without noise's seed mattering to it; `number` draws the motion."""

    def drawn(self, law: str, random: np.random.Generator, times: float) -> tuple[Values, dict[str, Values]]:
        """Draw a change: what to hide, and what is to be found in terms of the library."""

    laws: tuple[str, ...]

    @property
    def declared(self) -> Values:
        """Parameters of the object that `identify` estimates, as the world was given them."""


class Own:
    """plop's engine with coarser or finer particles and the fixed corotated law."""

    laws = (
        *("swelling", "tilt", "table_friction", "viscosity", "plasticity", "relaxation", "fibres", "softening"),
        *("stiffening", "adhesion", "blade_friction", "stiffness", "damping"),
        *("graded", "layered", "crust"),
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

    @property
    def declared(self) -> Values:
        """See `Maker`."""
        return {name: getattr(self.scene.material, name) for name in DECLARED}

    def episode(self, number: int, hidden: Mapping[str, Values]) -> Episode:
        """See `Maker`."""
        effects = [effect_type(name)(**values) for name, values in hidden.items()]
        return followed(simulate_episode(self.scene, number, effects), number)

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

    laws: tuple[str, ...] = ("tilt", "table_friction", "stiffness", "damping", "blade_friction")

    def __init__(self, simulator: str, seed: int) -> None:
        self.record: Callable[[World, Motion], MeshSequence] = importlib.import_module(
            f"benchmarks.worlds.{simulator}"
        ).record
        r = np.random.default_rng([seed, 3])
        self.seed = seed
        self.world: Any = World(
            youngs_modulus_pa=float(np.exp(r.uniform(np.log(1e4), np.log(3e4)))),
            table_friction=float(r.uniform(0.3, 0.7)),
            tool_friction=float(r.uniform(0.3, 0.7)),
            damping_per_s=float(r.uniform(1, 6)),
            taper=float(r.uniform(0, 0.2)),
            cells_m=CELLS_M[simulator],
            time_step_s=TIME_STEP_S[simulator],
        )

    @property
    def declared(self) -> Values:
        """See `Maker`."""
        return {name: getattr(self.world, name) for name in DECLARED}

    def episode(self, number: int, hidden: Mapping[str, Values]) -> Episode:
        """See `Maker`."""
        return followed(self.sequence(number, hidden), number)

    def sequence(self, number: int, hidden: Mapping[str, Values]) -> MeshSequence:
        """Simulate a motion; hidden are changes of the world's own numbers."""
        changes: dict[str, Any] = {k: v for values in hidden.values() for k, v in values.items()}
        if "tilt_x_deg" in changes:
            changes["tilt_deg"] = (changes.pop("tilt_x_deg"), changes.pop("tilt_y_deg"))
        return self.record(replace(self.world, **changes), self._motion(number))

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
        more = 30.0 * times
        return {"damping_per_s": world.damping_per_s + more}, {law: {"d_per_s": more}}


def followed(sequence: Any, number: int) -> Episode:
    episode = episode_from_sequence(sequence, noise_m=NOISE_M, seed=number, points=POINTS)
    return replace(episode, name=f"e{number:04d}")


WORLDS: dict[str, Callable[[int], Any]] = {
    "own": Own,
    "mujoco": lambda seed: Foreign("mujoco", seed),
    "drake": lambda seed: Foreign("drake", seed),
}
