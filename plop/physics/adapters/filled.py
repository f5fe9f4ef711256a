"""The engine's settings for one object, and the object filled with particles, under its own weight if required."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from plop.physics.effects.effect import Effect, at_rest
from plop.physics.engine.config import EngineConfig, TableCone
from plop.physics.engine.fill import fill_surface
from plop.physics.engine.material import Material
from plop.physics.engine.particles import Particles
from plop.physics.engine.solver import simulate

SPACING_M = 0.006
"""Distance of the particles [m]."""
CELLS = 2.0
"""Edge of a grid cell, in distances of the particles."""
_SETTLE_DAMPING = 1.4
"""Damping while an object settles, in units of its slowest oscillation's angular frequency (2 is critical) [-]."""
_SETTLE_ROUNDS = 12.0, 3.0, 3.0
"""Duration of each settling round, in units of 1 / damping; the first finds the stress, the others correct it. The
remaining motion is 0.001 mm in a block 40 mm high."""
_MORE_ROUNDS, _AT_REST = 4, 5e-4
"""Largest number of full rounds, while the last one deforms the object by more than this share of its height: a
material that flows under its own weight takes three; one that relaxes by 95 % still sags by 0.3 mm in the last."""


@dataclass(frozen=True)
class EngineBase:
    """The engine's settings for one object, the same in all its episodes."""

    material: Material
    spacing_m: float = SPACING_M
    settled: bool = True
    """Whether the object is loaded by its own weight before the first frame; otherwise it is stress-free there."""
    table_cone: TableCone = "round"
    """See EngineConfig."""

    @property
    def config(self) -> EngineConfig:
        """Grid and surroundings; the table's height is the recording's."""
        return EngineConfig(dx_m=CELLS * self.spacing_m, table_cone=self.table_cone)


@lru_cache(maxsize=64)
def _filling(vertices: bytes, faces: bytes, spacing_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cached `fill_surface`: a diagnosis fills the same few objects hundreds of times."""
    places = np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(faces, np.int64).reshape(-1, 3)
    found = fill_surface(*places, spacing_m)
    for values in found:
        values.flags.writeable = False
    return found


def filled_particles(
    base: EngineBase,
    surface: tuple[np.ndarray, np.ndarray],
    points: np.ndarray,
    table_z_m: float | None,
    effects: Sequence[Effect] = (),
) -> Particles:
    """Fill a closed surface with particles; one tracer for each given point comes last.

    A settled object is already under stress. The stress is found by letting it sag, moving it back to its measured
    position with the resulting deformation, and letting it sag again, by far less (prestressing in an
    updated Lagrangian frame: Gee, Foerster & Wall 2010). The memory of laws is kept: a material that flowed
    under its own weight has hardened.

    Args:
        base: The engine's settings.
        surface: Vertices [V, 3] [m] and triangles [F, 3].
        points: Positions of the tracers, [M, 3] [m].
        table_z_m: Height of the table [m]; None when there is none.
        effects: Laws that also act before the first frame.
    """
    vertices, triangles = (np.ascontiguousarray(p, kind) for p, kind in zip(surface, (float, np.int64), strict=True))
    places = vertices.tobytes(), triangles.tobytes(), np.ascontiguousarray(points, float).tobytes(), table_z_m
    resting = [effect for effect in at_rest(effects) if not effect.absent]
    # laws that do not act at rest share one state
    return _settle(base, *places, resting) if resting else _at_rest(base, *places)


def _settle(
    base: EngineBase, vertices: bytes, faces: bytes, points: bytes, table_z_m: float | None, resting: Sequence[Effect]
) -> Particles:
    filled, volumes, radii = _filling(vertices, faces, base.spacing_m)
    traced = np.frombuffer(points).reshape(-1, 3)
    wanted = np.concatenate([filled, traced])
    none = np.zeros(len(traced))
    particles = Particles(wanted, np.concatenate([volumes, none]), radii=np.concatenate([radii, none]))
    if not base.settled:
        return particles
    height_m = float(np.ptp(np.frombuffer(vertices)[2::3]))
    damping = _SETTLE_DAMPING * _slowest_per_s(base.material, height_m)
    calm = replace(base.material, damping_per_s=damping)
    config = replace(base.config, table_z_m=table_z_m)
    for k, lasting in enumerate((*_SETTLE_ROUNDS, *(_SETTLE_ROUNDS[:1] * _MORE_ROUNDS)), 1):
        start = replace(particles, positions=wanted, velocities=None, affine=None)
        particles = simulate(start, calm, None, np.array([0, lasting / damping]), config, effects=resting).final
        moved = particles.positions - wanted
        # on a tilted table the stress reaches equilibrium, the object does not come to rest
        slid = np.append(moved[:, :2].mean(0), 0.0)
        if k >= len(_SETTLE_ROUNDS) and np.sqrt(((moved - slid) ** 2).sum(1).mean()) < _AT_REST * height_m:
            break
    return replace(particles, positions=particles.positions - slid, velocities=None, affine=None)


@lru_cache(maxsize=16)
def _at_rest(base: EngineBase, vertices: bytes, faces: bytes, points: bytes, table_z_m: float | None) -> Particles:
    """Cached `_settle` without laws: in a diagnosis a third of the laws act on motion or through the tool only."""
    particles = _settle(base, vertices, faces, points, table_z_m, ())
    for values in vars(particles).values():
        if isinstance(values, np.ndarray):
            values.flags.writeable = False
    return particles


def _slowest_per_s(material: Material, height_m: float) -> float:
    """Angular frequency of a layer on a table that swings sideways: a quarter of a shear wave over its height [1/s]."""
    return float(0.5 * np.pi * np.sqrt(material.shear_pa / material.density_kg_m3) / height_m)
