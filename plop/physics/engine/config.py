"""Settings of the particle-grid engine; their defaults are written only here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from plop.errors import PlopError


@dataclass(frozen=True)
class EngineConfig:
    """How finely and with what surroundings the engine computes."""

    dx_m: float = 0.008
    """Edge of a grid cell [m]; particles should lie about half of it apart."""
    gravity_m_s2: tuple[float, float, float] = (0.0, 0.0, -9.81)
    """Acceleration of free fall, world frame [m/s^2]."""
    table_z_m: float | None = 0.0
    """Height of the table [m]; None when there is none."""
    table_cone: Literal["round", "pyramid"] = "round"
    """Coulomb's cone at the table. Several simulators (dflex, ODE) limit the friction along x and y
    separately; "pyramid" does the same, so that their recordings can be followed."""
    courant: float = 0.4
    """Time step as a share of the time that a pressure wave needs for one cell [-]."""
    dt_s: float | None = None
    """Fixed time step [s]; None derives it from `courant`."""
    max_halvings: int = 3
    """How often an unstable frame is repeated with half the time step before the engine gives up."""
    chunks: int = 4
    """Number of particle groups that threads may take; part of the result's last digits, unlike the threads."""
    threads: int = 1
    """Threads of one run; several runs side by side use the cores better than several threads in one."""
    band_cells: float = 3.0
    """How far from the blade's middle plane its passage separates particles [cells]."""

    def __post_init__(self) -> None:
        checks = {
            "dx_m": self.dx_m > 0,
            "gravity_m_s2": len(self.gravity_m_s2) == 3,
            "table_cone": self.table_cone in ("round", "pyramid"),
            "courant": 0 < self.courant <= 1,
            "dt_s": self.dt_s is None or self.dt_s > 0,
            "max_halvings": self.max_halvings >= 0,
            "chunks": self.chunks >= 1,
            "threads": self.threads >= 1,
            "band_cells": 1 <= self.band_cells <= 8,
        }
        for name, good in checks.items():
            if not good:
                raise PlopError(
                    "An engine setting is out of range.",
                    where=name,
                    found=str(getattr(self, name)),
                    expected="a positive number; courant in (0, 1], band_cells in 1..8",
                    fix="Give a value in that range.",
                )
