"""The material points that the engine moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plop.errors import PlopError


@dataclass(frozen=True)
class Particles:
    """Where the material is and how it moves; N particles."""

    positions: np.ndarray
    """[N, 3] [m]."""
    volumes: np.ndarray
    """Rest volume, [N] [m^3]; 0 makes a tracer that follows and does not act."""
    velocities: np.ndarray | None = None
    """[N, 3] [m/s]; at rest when absent."""
    F: np.ndarray | None = None
    """Deformation gradient, [N, 3, 3]; the identity when absent."""
    sides: np.ndarray | None = None
    """Side of the cut each particle will be on, [N]: +1 where the blade's normal points, -1 behind it, 0 when
    the blade itself decides as it passes; all 0 when absent."""
    radii: np.ndarray | None = None
    """Distance from a particle to the end of its material, [N] [m]: 0 for particles on the surface;
    half the cube root of the volume when absent."""
    affine: np.ndarray | None = None
    """Local velocity gradient, [N, 3, 3] [1/s]; zero when absent."""
    passed: np.ndarray | None = None
    """Whether a blade has passed, [N] bool; none when absent."""

    memory: dict[str, np.ndarray] | None = None
    """What effects remember of each particle, arrays [N, ...] by "<effect>.<name>"; their first values when absent."""

    held: np.ndarray | None = None
    """Way along the tool's surface since it touched a particle, as far as its friction holds, [N, 3] [m]; zero when
    absent."""
    outward: np.ndarray | None = None
    """Outward normal of the undeformed surface, 0 within the material, [N, 3]; `outward_normals` when absent."""

    def __post_init__(self) -> None:
        positions, volumes = np.asarray(self.positions), np.asarray(self.volumes)
        if positions.ndim != 2 or positions.shape[1] != 3 or volumes.shape != (len(positions),) or not len(positions):
            raise PlopError(
                "The particles cannot be used.",
                where="particles",
                expected="shapes [N, 3] and [N]",
                found=f"{positions.shape}, {volumes.shape}",
                fix="Give one place and volume each.",
            )
        usable = np.isfinite(volumes).all() and (volumes >= 0).all() and volumes.any()
        if not np.isfinite(positions).all() or not usable:
            raise PlopError(
                "The particles cannot be used.",
                where="particles",
                found="others",
                expected="finite positions and volumes, none negative, not all 0",
                fix="Look for NaN in what they were made from.",
            )
        if np.ptp(positions, axis=0).max() > 10:
            raise PlopError(
                "The object is too large.",
                where="particles",
                expected="metres, at most 10 m across",
                found=f"{np.ptp(positions, axis=0).max():g}",
                fix="Are these millimetres?",
            )
        for name in ("velocities", "F", "sides", "radii", "affine", "passed", "held", "outward"):
            value = getattr(self, name)
            if value is not None and (len(value) != len(positions) or not np.isfinite(value).all()):
                raise PlopError(
                    "The particles cannot be used.",
                    where=f"particles.{name}",
                    expected=f"{len(positions)} finite rows",
                    found=f"{len(value)} rows",
                    fix="Give one row for each particle, or leave it out.",
                )

    def __len__(self) -> int:
        return len(self.positions)

    def select(self, index: np.ndarray) -> Particles:
        """Take a subset of the particles with everything that belongs to them."""

        def taken(values: np.ndarray | None) -> np.ndarray | None:
            return None if values is None else np.asarray(values)[index]

        memory = None if self.memory is None else {name: values[index] for name, values in self.memory.items()}
        return Particles(
            self.positions[index],
            self.volumes[index],
            taken(self.velocities),
            taken(self.F),
            taken(self.sides),
            taken(self.radii),
            taken(self.affine),
            taken(self.passed),
            memory,
            taken(self.held),
        )
