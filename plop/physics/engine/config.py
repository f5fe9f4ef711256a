"""Settings of the particle-grid engine; their defaults are written only here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from plop.setting_kinds import Range, Settings, Unit

TableCone = Literal["round", "pyramid"]


@dataclass(frozen=True)
class EngineConfig(Settings):
    """How finely and with what surroundings the engine computes."""

    dx_m: Annotated[float, Range(0, above=True), Unit("m")] = 0.008
    """Edge of a grid cell; particles should lie about half of it apart."""
    gravity_m_s2: Annotated[tuple[float, float, float], Unit("m/s^2")] = (0.0, 0.0, -9.81)
    """Acceleration of free fall, world frame."""
    table_z_m: Annotated[float | None, Unit("m")] = 0.0
    """Height of the table; None when there is none."""
    table_cone: TableCone = "round"
    """Coulomb's cone at the table. Several simulators (dflex, ODE) limit the friction along x and y
    separately; "pyramid" does the same, so that their recordings can be followed."""
    courant: Annotated[float, Range(0, 1, above=True)] = 0.4
    """Time step as a share of the time that a pressure wave needs for one cell."""
    dt_s: Annotated[float | None, Range(0, above=True), Unit("s")] = None
    """Fixed time step; None derives it from `courant`."""
    max_halvings: Annotated[int, Range(0)] = 3
    """How often an unstable frame is repeated with half the time step before the engine gives up."""
    chunks: Annotated[int, Range(1)] = 4
    """Number of particle groups that threads may take; part of the result's last digits, unlike the threads."""
    threads: Annotated[int, Range(1)] = 1
    """Threads of one run; several runs side by side use the cores better than several threads in one."""
    band_cells: Annotated[float, Range(1, 8), Unit("cells")] = 3.0
    """How far from the blade's middle plane its passage separates particles."""
