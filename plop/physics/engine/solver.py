"""Run the particle-grid engine: particles, material and tool motion in, trajectory out.

By hand, since `diagnose` needs effects that are added by name, a user's own among them, cuts whose two sides touch, and
thousands of short runs of about a thousand particles on a CPU; public engines are made for few large runs on a GPU.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from plop.compute.numba_threads import numba_threads
from plop.errors import PlopError
from plop.physics.engine.config import EngineConfig
from plop.physics.engine.engine import Engine, UnstableStepError
from plop.physics.engine.law import Law
from plop.physics.engine.material import Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.tool_motion import ToolMotion


@dataclass(frozen=True)
class EngineTrajectory:
    """What a run gives, at the times asked for."""

    times: np.ndarray
    """[T] [s]."""
    positions: np.ndarray
    """[T, N, 3] [m]."""
    F: np.ndarray
    """[T, N, 3, 3]."""
    sides: np.ndarray
    """[T, N] int8: 0 where no blade has passed, else the side, +1 where the blade's normal points."""
    table_force: np.ndarray
    """Mean force of the table on the object since the frame before, [T, 3] [N]; 0 at the first."""
    tool_force: np.ndarray
    """Mean force of the tool on the object since the frame before, [T, 3] [N]; 0 at the first."""
    final: Particles = field(repr=False)
    """The state at the last time, ready to go on from."""
    steps: int
    """Time steps taken, repeated ones included."""
    dt_s: float
    """Longest time step at the end [s]."""
    halvings: int
    """How often the time step had to be halved."""


def simulate(
    particles: Particles,
    material: Material,
    tool_motion: ToolMotion | None,
    times: np.ndarray,
    config: EngineConfig | None = None,
    *,
    effects: Sequence[Law] = (),
    most_step_s: float = np.inf,
    step_ratio: float = 1.0,
    on_frame: Callable[[Engine, int], None] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> EngineTrajectory:
    """Advance particles through the given times.

    Args:
        particles: State at `times[0]`; not changed.
        material: What they are made of.
        tool_motion: The tool, or None.
        times: Strictly increasing, shape [T] [s]; the first is the start.
        config: Grid, gravity, table, time step.
        effects: Laws that act besides the material's own.
        most_step_s: Longest time step [s], where it is less than the stable one: of a run to compare another one with,
            since more steps dissipate more.
        step_ratio: Where the longest is not stable, it is divided by a power of this; 1 takes any stable one.
        on_frame: Called with the engine and the frame's number when a frame has been reached and stored; may
            move the particles (an observer).
        progress: Called after each time with (done, total).

    Raises:
        PlopError: The run is unstable even with the time step halved `max_halvings` times, or would take far too many
            time steps.
    """
    times, config = np.asarray(times, np.float64), config or EngineConfig()
    if times.ndim != 1 or len(times) < 1 or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise PlopError(
            "The times cannot be used.",
            where="times",
            expected="strictly increasing seconds",
            found=f"shape {times.shape}",
            fix="Sort them and leave out what is there twice.",
        )
    with numba_threads(config.threads):
        engine = Engine(particles, material, tool_motion, config, effects, most_step_s, step_ratio)
        return _simulate(engine, times, on_frame, progress)


def _simulate(
    engine: Engine,
    times: np.ndarray,
    on_frame: Callable[[Engine, int], None] | None,
    progress: Callable[[int, int], None] | None,
) -> EngineTrajectory:
    frames, forces = [engine.snapshot()], [np.zeros((2, 3))]
    for k, (start, end) in enumerate(zip(times[:-1], times[1:], strict=True)):
        forces.append(advance_safely(engine, float(start), float(end)))
        frames.append(engine.snapshot())
        if on_frame is not None:
            on_frame(engine, k + 1)
        if progress is not None:
            progress(k + 1, len(times) - 1)
    positions, gradients, sides = (np.stack(part) for part in zip(*frames, strict=True))
    force = np.stack(forces)
    return EngineTrajectory(
        times,
        positions,
        gradients,
        sides,
        force[:, 0],
        force[:, 1],
        engine.state(),
        engine.steps,
        engine.longest_step_s,
        engine.halvings,
    )


def advance_safely(engine: Engine, start_s: float, end_s: float) -> np.ndarray:
    """Advance from one time to the next; go back and halve the time step where a particle runs away.

    Returns:
        Mean force on the object from table and tool, shape [2, 3] [N].

    Raises:
        PlopError: It still runs away after the last halving; names the effects that act, or else the parameter that
            sets the time step.
    """
    saved = engine.save()
    while True:
        try:
            return engine.advance(start_s, end_s)
        except UnstableStepError as reason:
            if engine.halvings >= engine.config.max_halvings or engine.config.dt_s is not None:
                raise _unstable(engine, start_s, reason) from None
            engine.restore(saved)
            engine.halvings += 1


def _unstable(engine: Engine, time_s: float, reason: UnstableStepError) -> PlopError:
    material, parameter = engine.material, "youngs_modulus_pa"
    fix = "Give a smaller dt_s or courant; check that stiffness, density and tool speed are in Pa, kg/m^3 and m/s."
    effects = " or ".join(effect.name for effect in engine.effects)
    blamed = reason.effect if reason.effect is not None else effects if engine.config.dt_s is None else ""
    if blamed:
        parameter = f"effect {blamed}"
    elif engine.config.dt_s is not None:
        parameter = "dt_s"
    elif material.viscosity_pa_s > material.youngs_modulus_pa * engine.longest_step_s:
        parameter = "viscosity_pa_s"
    if blamed:
        fix = (
            "Choose a smaller amplitude; in an effect of your own, look at its hooks: `slowest_step_s` tells the "
            "engine to take shorter steps."
        )
    return PlopError(
        "The engine's run is unstable.",
        where=f"{parameter}, t = {time_s:.4f} s",
        expected="particles that move less than half a cell in a step and keep their volume",
        found=f"{reason}; the time step was {engine.longest_step_s:.2g} s" + _acting(engine),
        fix=fix,
    )


def _acting(engine: Engine) -> str:
    """Name the effects: any of them may be what made the run unstable."""
    return f"; effects: {', '.join(map(repr, engine.effects))}" if engine.effects else ""
