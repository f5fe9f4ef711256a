"""Speed of the particle-grid engine."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from plop.physics.engine.solver import EngineTrajectory


def cases() -> dict[str, Callable[[], float]]:
    """Return each figure's name and the function that measures it."""
    return {
        "engine_5k_1_thread_particle_steps_per_s": lambda: rate(5_000, threads=1),
        "engine_5k_2_threads_particle_steps_per_s": lambda: rate(5_000, threads=2),
        "engine_5k_cpu_particle_steps_per_s": lambda: rate(5_000, threads=1, clock=time.process_time),
        "engine_time_per_particle_40k_over_5k": growth,
        "engine_5k_cut_of_1_s_s": cut_seconds,
        "engine_time_per_tracer_over_particle": tracer_share,
    }


def _box(count: int, spacing_m: float = 0.005) -> tuple[np.ndarray, np.ndarray]:
    edge = count ** (1 / 3)
    counts = [round(edge * 1.25), round(edge), round(edge * 0.8)]
    axes = [(np.arange(n) + 0.5) * spacing_m for n in counts]
    positions = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    positions[:, :2] -= positions[:, :2].mean(0)
    return positions, np.full(len(positions), spacing_m**3)


def _run(count: int, seconds: float, threads: int, *, cut: bool) -> tuple[EngineTrajectory, int]:
    from plop.physics.engine.config import EngineConfig
    from plop.physics.engine.material import Material
    from plop.physics.engine.particles import Particles
    from plop.physics.engine.solver import simulate
    from plop.physics.engine.tool_motion import ToolMotion
    from plop.physics.scenes.tools import blade_mesh

    positions, volumes = _box(count)
    top = positions[:, 2].max() + 0.004
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, 3] = [[0, 0, top], [0, 0, -0.004], [0.02, 0, -0.004]]
    blade = ToolMotion(*blade_mesh(height_m=0.08, length_m=0.3), np.array([0, 0.6, 1.0]) * seconds, poses)
    run = simulate(
        Particles(positions, volumes),
        Material(youngs_modulus_pa=1e4),
        blade if cut else None,
        np.linspace(0, seconds, 6),
        EngineConfig(dx_m=0.01, threads=threads),
    )
    return run, len(positions)


def rate(count: int, *, threads: int, clock: Callable[[], float] = time.perf_counter) -> float:
    """Particle-steps per second of a cut, median of three runs; `clock` process_time ignores other programs."""
    threads = min(threads, len(os.sched_getaffinity(0)))
    _run(200, 0.01, threads, cut=True)
    rates = []
    for _ in range(3):
        started = clock()
        run, particles = _run(count, 0.15, threads, cut=True)
        rates.append(run.steps * particles / (clock() - started))
    return float(np.median(rates))


def growth() -> float:
    """Processor time per particle-step with 40,000 particles over that with 5,000: 1 is linear."""
    return rate(5_000, threads=1, clock=time.process_time) / rate(40_000, threads=1, clock=time.process_time)


def cut_seconds() -> float:
    """Wall time of a cut and push of 1 s, 5,000 particles, one thread [s]."""
    _run(200, 0.01, 1, cut=True)
    started = time.perf_counter()
    _run(5_000, 1.0, 1, cut=True)
    return time.perf_counter() - started


def tracer_share() -> float:
    """Processor time per step of a tracer on the surface, over that of a particle, median of three."""
    shares = []
    for _ in range(3):
        (alone, few), (larger, many), (followed, _) = _step_ns(600), _step_ns(4600), _step_ns(600, tracers=4000)
        shares.append((followed - alone) / 4000 / ((larger - alone) / (many - few)))
    return float(np.median(shares))


def _step_ns(count: int, tracers: int = 0) -> tuple[float, int]:
    """Processor time of a step of a block at rest [ns], and its particles."""
    from plop.physics.engine.config import EngineConfig
    from plop.physics.engine.material import Material
    from plop.physics.engine.particles import Particles
    from plop.physics.engine.solver import simulate

    positions, volumes = _box(count, 0.0074)
    draw = np.random.default_rng(0)
    points = draw.uniform(positions.min(0), positions.max(0), (tracers, 3))
    points[:, 2] = positions[:, 2].max()
    particles = Particles(np.concatenate([positions, points]), np.concatenate([volumes, np.zeros(tracers)]))
    config = EngineConfig(dx_m=0.0148)
    simulate(particles, Material(), None, np.array([0, 0.01]), config)
    started = time.process_time()
    run = simulate(particles, Material(), None, np.array([0, 0.3]), config)
    return (time.process_time() - started) / run.steps * 1e9, len(positions)
