"""A scene: object, resolution and episodes of a simulation; read from a TOML file."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from plop.errors import PlopError
from plop.physics.effects.effect import Effect, at_rest
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.material import Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.solver import simulate
from plop.physics.engine.tool_motion import ToolMotion
from plop.physics.scenes import shipped_scenes
from plop.physics.scenes.as_sequence import as_sequence
from plop.physics.scenes.motions import CUTS, MOTIONS, MotionPlan, MotionRanges, draw_motion, tool_motion
from plop.physics.scenes.names import one_of
from plop.physics.scenes.scene_values import MATERIAL, built, known_keys, material_of, numbers, shape_of, table_of
from plop.physics.scenes.shapes import Shape, halved_body, whole_body
from plop.recordings.readers.mesh.sequence import MeshSequence

_SETTLE_DAMPING_PER_S, _SETTLE_S, _SETTLE_ROUNDS, _AT_REST_M_S = 100.0, 0.06, 6, 5e-4
"""Damping, about critical for a hand-sized soft object; a round lasts until most of its sagging is over."""
_TOUCH = 0.01
"""Force of a contact as a share of the object's weight; the grid gives a near miss a smaller force."""
_STANDS = 0.6
"""Share of its height below which an object without contact has collapsed; one that sinks by more than the depth of a
press has, too."""


@dataclass(frozen=True)
class Scene:
    """A simulation; every field is a key of the TOML file, nested ones keys of a table."""

    name: str = "block"
    """Name of the object; it becomes the recordings' environment."""
    episodes: int = 8
    """Number of episodes."""
    motions: tuple[str, ...] = ("push", "hold", "cut-push", "cycles")
    """Kinds of motion, used in turn."""
    frame_rate_hz: float = 30.0
    """Frames per second."""
    spacing_m: float = 0.004
    """Distance of the particles [m]."""
    dx_m: float = 0.008
    """Edge of a grid cell [m]."""
    settle: bool = True
    """Let the object come to rest under its own weight before the first frame."""
    seed: int = 0
    """Draws positions, speeds and directions."""
    shape: Shape = field(default_factory=Shape)
    """Texture of the object."""
    material: Material = MATERIAL
    """Material of the object."""
    motion: MotionRanges = field(default_factory=MotionRanges)
    """Ranges of the motions."""

    def __post_init__(self) -> None:
        for kind in self.motions:
            one_of(kind, MOTIONS, "motion", where="motions")
        thinnest = min(self.shape.size_m)
        checks = {
            "name": (
                bool(self.name) and self.name.replace("-", "").replace("_", "").isalnum(),
                "letters, digits, - and _",
            ),
            "episodes": (1 <= self.episodes <= 999, "1 to 999"),
            "motions": (len(self.motions) > 0, "at least one"),
            "frame_rate_hz": (1 <= self.frame_rate_hz <= 500, "1 to 500 Hz"),
            "spacing_m": (
                thinnest / 60 <= self.spacing_m <= thinnest / 3,
                f"{thinnest / 60:.2g} to {thinnest / 3:.2g} m for this object",
            ),
            "dx_m": (1.2 <= self.dx_m / self.spacing_m <= 4, "1.2 to 4 times spacing_m"),
        }
        for name, (good, expected) in checks.items():
            if not good:
                raise PlopError(
                    "The scene cannot be simulated.",
                    where=name,
                    expected=expected,
                    found=str(getattr(self, name)),
                    fix="Lengths are metres, times seconds.",
                )

    @classmethod
    def read(cls, path: str | Path) -> Scene:
        """Read a scene from a TOML file.

        Raises:
            PlopError: No such file, not TOML, an unknown key, or an invalid value.
        """
        path = Path(path)
        try:
            table = tomllib.loads(path.read_text(encoding="utf-8-sig"))
        except (OSError, ValueError) as error:
            raise PlopError(
                "The scene cannot be read.",
                where=path,
                expected="a TOML file",
                found=str(error),
                fix=f"Shipped scenes: {', '.join(shipped_scenes())}.",
            ) from error
        try:
            return cls.from_dict(table)
        except PlopError as error:
            raise PlopError(
                error.problem, where=f"{path}: {error.where}", expected=error.expected, found=error.found, fix=error.fix
            ) from error

    @classmethod
    def from_dict(cls, table: Mapping[str, Any]) -> Scene:
        """Build a scene from the content of a TOML file.

        Raises:
            PlopError: An unknown key, or an invalid value.
        """
        values = known_keys(table, cls, "")
        if "shape" in values:
            values["shape"] = shape_of(table_of(values["shape"], "shape"))
        if "material" in values:
            material = known_keys(table_of(values["material"], "material"), Material, "material.")
            values["material"] = material_of(material)
        if "motion" in values:
            ranges = known_keys(table_of(values["motion"], "motion"), MotionRanges, "motion.")
            values["motion"] = built(MotionRanges, {key: numbers(v, key) for key, v in ranges.items()}, "motion")
        if "motions" in values:
            given = values["motions"]
            values["motions"] = tuple(given) if isinstance(given, list) else (given,)
        if "spacing_m" in values and "dx_m" not in values:
            values["dx_m"] = 2 * values["spacing_m"]
        return built(cls, values, "scene")

    def motion_plan(self, k: int) -> MotionPlan:
        """Draw the motion of episode k; the same for the same seed and k."""
        kind = self.motions[k % len(self.motions)]
        return draw_motion(kind, self.motion, np.random.default_rng([self.seed, k]))

    def episode_name(self, k: int) -> str:
        """Name of episode k."""
        return f"{self.name}_{k:03d}"


def simulate_episode(scene: Scene, k: int, effects: Sequence[Effect] = (), most_step_s: float = np.inf) -> MeshSequence:
    """Simulate one episode; the same scene, k and effects give the same numbers.

    Effects also act while the object settles: it starts in equilibrium with them. The sequence's facts contain
    the motion and the material of the scene, but not the effects.

    Args:
        scene: The scene.
        k: Number of the episode, from 0.
        effects: Laws in addition to the base material.
        most_step_s: Longest time step, see `simulate` [s].

    Raises:
        PlopError: The tool never touches the object, the cut is outside it, or the run is unstable.
    """
    plan = scene.motion_plan(k)
    motion = tool_motion(plan, scene.shape, scene.frame_rate_hz)
    return simulate_motion(scene, scene.episode_name(k), plan, motion, effects, most_step_s)


def simulate_motion(
    scene: Scene,
    name: str,
    plan: MotionPlan,
    motion: ToolMotion,
    effects: Sequence[Effect] = (),
    most_step_s: float = np.inf,
) -> MeshSequence:
    """Simulate any motion of a tool; see `simulate_episode`.

    Args:
        scene: The scene.
        name: Name of the episode.
        plan: What kind of motion it is; a cut is where it says.
        motion: The tool's path.
        effects: Laws in addition to the base material.
        most_step_s: Longest time step, see `simulate` [s].
    """
    body = (
        halved_body(scene.shape, scene.spacing_m, plan.x_m, plan.yaw_rad)
        if plan.kind in CUTS
        else whole_body(scene.shape, scene.spacing_m)
    )
    config = EngineConfig(dx_m=scene.dx_m)
    try:
        start = settled(body.particles, scene.material, config, effects) if scene.settle else body.particles
        run = simulate(start, scene.material, motion, motion.times, config, effects=effects, most_step_s=most_step_s)
    except PlopError as error:
        raise PlopError(
            error.problem,
            where=f"{name} ({plan.kind}): {error.where}",
            expected=error.expected,
            found=error.found,
            fix=error.fix,
        ) from error
    weight_n = 9.81 * scene.material.density_kg_m3 * float(body.particles.volumes.sum())
    if np.abs(run.tool_force).max() < _TOUCH * weight_n:
        heights = np.ptp(body.particles.positions[:, 2]), np.ptp(run.positions[..., 2], axis=1).min()
        raise _untouched(scene, plan, *map(float, heights), where=f"{name} ({plan.kind})")
    return as_sequence(name, scene.name, body, motion, run, _facts(scene, plan))


def _untouched(scene: Scene, plan: MotionPlan, height_m: float, left_m: float, *, where: str) -> PlopError:
    """Return why no tool has touched the object: it has sunk below the tool's path, or the path misses it.

    Args:
        scene: The scene.
        plan: The motion.
        height_m: The object's initial height [m].
        left_m: Its smallest height in the episode [m].
        where: Episode and kind of motion.
    """
    if left_m < _STANDS * height_m or 0 < plan.depth_m < height_m - left_m:
        material = scene.material
        return PlopError(
            "The object collapses under its own weight, so that the tool never touches it.",
            where=where,
            expected=f"an object that stays about {1000 * height_m:.0f} mm high",
            found=f"{1000 * left_m:.0f} mm high, with youngs_modulus_pa = {material.youngs_modulus_pa:g} and "
            f"density_kg_m3 = {material.density_kg_m3:g}",
            fix="Set a stiffer or lighter material in the scene's [material]; stiffness is in Pa, density in kg/m^3.",
        )
    return PlopError(
        "The tool never touches the object.",
        where=where,
        expected="a motion that reaches the object",
        found=_moved(plan),
        fix="Change the ranges in the scene's [motion], or the kind of motion.",
    )


def settled(particles: Particles, material: Material, config: EngineConfig, effects: Sequence[Effect]) -> Particles:
    """Let an object settle on the table, strongly damped; return its state at zero velocity."""
    resting = at_rest(effects)
    damped = replace(material, damping_per_s=max(material.damping_per_s, _SETTLE_DAMPING_PER_S))
    for _ in range(_SETTLE_ROUNDS):
        particles = simulate(particles, damped, None, np.array([0.0, _SETTLE_S]), config, effects=resting).final
        assert particles.velocities is not None
        if np.sqrt((particles.velocities**2).sum(1).mean()) < _AT_REST_M_S:
            break
    return replace(particles, velocities=None, affine=None)


def _moved(plan: MotionPlan) -> str:
    values = {"x": plan.x_m, "y": plan.y_m, "depth": plan.depth_m, "aside": plan.aside_m}
    return ", ".join(f"{name} {1000 * value:.1f} mm" for name, value in values.items())


def _facts(scene: Scene, plan: MotionPlan) -> dict[str, Any]:
    stated = {key: float(value) for key, value in vars(scene.material).items() if key != "law"}
    return {
        "plan": dict(vars(plan)),
        "material": {**stated, "law": scene.material.law.name.lower()},
        "spacing_m": scene.spacing_m,
        "dx_m": scene.dx_m,
    }
