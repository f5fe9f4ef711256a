"""What a foreign world's settings amount to: `python -m benchmarks.worlds.laws mujoco` (or drake).

Declared is not effective. A block on a tilted table tells the friction and whether it creeps; how a press spreads over
meshes tells how much stiffer and smoother a mesh of linear tetrahedra is than its material; motions on a finer mesh
show what depends on where the nodes happen to touch the tool.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.worlds.scene import CELLS_M, GRAVITY_M_S2, TIME_STEP_S, Motion, World
from plop.comparison.error_fields import rms
from plop.recordings.readers.mesh.sequence import MeshSequence

Recorder = Callable[[World, Motion], MeshSequence]
WATCHED_S = 0.4
_MEMORY_S = 0.05
"""Frames so soon after the start of the recording are not used."""


@dataclass(frozen=True)
class Slide:
    """A block on a tilted table."""

    speed_m_s: float
    """Mean speed downhill: creep, where it ought to stick."""
    friction: float
    """Coefficient that explains its acceleration [-]; at least this where it sticks."""


def slide(times: np.ndarray, downhill_m: np.ndarray, tilt_rad: float, damping_per_s: float) -> Slide:
    """Read friction off a way downhill, [T] [m].

    The equation of motion a + damping v = g (sin - mu cos) is integrated twice and fitted, so that nothing is
    differentiated.
    """
    since, way = times - times[0], downhill_m - downhill_m[0]
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (way[1:] + way[:-1]) * np.diff(since))])
    terms = np.stack([since, since**2 / 2], 1)
    _, pull = np.linalg.lstsq(terms, way + damping_per_s * summed, rcond=None)[0]
    friction = (GRAVITY_M_S2 * np.sin(tilt_rad) - pull) / (GRAVITY_M_S2 * np.cos(tilt_rad))
    return Slide(float(way[-1] / since[-1]), float(friction))


def on_a_tilt(record: Recorder, world: World, tilt_deg: float) -> Slide:
    """Let a world's object lie on a tilted table."""
    tilted = replace(world, tilt_deg=(tilt_deg, 0.0), damping_per_s=2.0)
    sequence = record(tilted, Motion("rest", aside_m=0.02))
    used = sequence.times >= _MEMORY_S
    return slide(sequence.times[used], sequence.vertices[used].mean(1)[:, 0], np.deg2rad(tilt_deg), 2.0)


def pressed(record: Recorder, world: World) -> tuple[float, float]:
    """Press, and give how far the far top sinks as a share of what lies under the tool [-], and the force [N]."""
    sequence = record(world, Motion("press", "cylinder", depth_m=0.004))
    away = np.linalg.norm(sequence.rest[:, :2], axis=1)
    top = sequence.rest[:, 2] > world.shape.height_m - 1e-6
    sunk = (sequence.vertices - sequence.vertices[0])[..., 2]
    deepest = sunk[:, top].sum(1).argmin()
    far, near = top & (away > 0.4 * min(world.shape.size_m[:2])), top & (away < 0.2 * min(world.shape.size_m[:2]))
    force_n = float(np.abs(np.array(sequence.facts["tool_force_n"])[:, 2]).max())
    return float(sunk[deepest, far].mean() / sunk[deepest, near].mean()), force_n


def refined(record: Recorder, world: World, motion: Motion, finer_m: float) -> tuple[float, float]:
    """Record a motion on the world's mesh and on a finer one.

    Returns:
        How far the surface is apart and how far it moves, RMS over its nodes and frames [m].
    """
    coarse, fine = (record(replace(world, cells_m=cells), motion) for cells in (world.cells_m, finer_m))
    nearest = cKDTree(fine.rest).query(coarse.rest)[1]
    moved, finer = (sequence.vertices - sequence.vertices[0] for sequence in (coarse, fine))
    apart, moves = (float(rms(np.linalg.norm(vectors, axis=-1))) for vectors in (moved - finer[:, nearest], moved))
    return apart, moves


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("simulator", choices=["drake", "mujoco"])
    simulator = parser.parse_args().simulator
    record = importlib.import_module(f"benchmarks.worlds.{simulator}").record
    out = sys.stdout.write
    for tilt_deg, friction in ((9.0, 0.5), (20.0, 0.2)):
        found = on_a_tilt(record, World(table_friction=friction, cells_m=0.010), tilt_deg)
        out(f"tilt {tilt_deg:g} deg, friction {friction}: {1000 * found.speed_m_s:.1f} mm/s, {found.friction:.3f}\n")
    world = World(cells_m=CELLS_M[simulator], time_step_s=TIME_STEP_S[simulator])
    for kind in ("press", "push", "drag"):
        apart, moved = refined(record, world, Motion(kind, "cylinder", depth_m=0.004), 0.005)
        out(f"{kind}, cells {1000 * world.cells_m:.1f} and 5 mm: apart {1000 * apart:.2f} of {1000 * moved:.2f} mm\n")
    for cells_m in (0.010, 0.0075, 0.0055, 0.005):
        share, force_n = pressed(record, replace(world, cells_m=cells_m))
        out(f"press, cells {1000 * cells_m:.1f} mm: far over near {share:.3f}, {force_n:.2f} N\n")


if __name__ == "__main__":
    main()
