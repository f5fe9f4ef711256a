"""What the object is made of."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from plop.errors import PlopError


class ElasticLaw(IntEnum):
    """Which hyperelastic energy the object obeys; the values are what the kernels switch on."""

    NEO_HOOKEAN = 0
    """Compressible neo-Hookean, W = mu/2 (I1 - 3) - mu ln J + lambda/2 (ln J)^2."""
    FIXED_COROTATED = 1
    """Fixed corotated, W = mu |F - R|^2 + lambda/2 (J - 1)^2 (Stomakhin et al. 2012)."""
    STABLE_NEO_HOOKEAN = 2
    """Stable neo-Hookean with the coefficients used as they are (Smith et al. 2018, Eq. 14)."""


_RANGES: dict[str, tuple[float, float, str]] = {
    "youngs_modulus_pa": (50.0, 1e10, "Pa"),
    "poisson": (-0.9, 0.495, "-"),
    "density_kg_m3": (1.0, 3e4, "kg/m^3"),
    "damping_per_s": (0.0, 1e4, "1/s"),
    "viscosity_pa_s": (0.0, 1e5, "Pa s"),
    "table_friction": (0.0, 10.0, "-"),
    "tool_friction": (0.0, 10.0, "-"),
    "cut_friction": (0.0, 10.0, "-"),
    "toughness_j_m2": (0.0, 1e5, "J/m^2"),
    "table_slip_m_s": (0.0, 10.0, "m/s"),
}


@dataclass(frozen=True)
class Material:
    """Parameters of a homogeneous soft object and of its contacts."""

    youngs_modulus_pa: float = 1.0e4
    """Young's modulus [Pa]."""
    poisson: float = 0.4
    """Poisson's ratio [-]."""
    density_kg_m3: float = 1000.0
    """Density at rest [kg/m^3]."""
    damping_per_s: float = 0.0
    """Velocity damping: a free velocity falls as exp(-damping t) [1/s]."""
    viscosity_pa_s: float = 0.0
    """Kelvin-Voigt viscosity of the deviatoric rate of deformation [Pa s]."""
    table_friction: float = 0.5
    """Coulomb friction between object and table [-]."""
    tool_friction: float = 0.5
    """Coulomb friction between object and tool [-]."""
    cut_friction: float = 0.5
    """Coulomb friction between the two faces of a cut [-]."""
    toughness_j_m2: float = 0.0
    """Energy that the tool's edge spends on each square metre of new cut [J/m^2]."""
    table_slip_m_s: float = 0.0
    """Sliding slower than `table_friction` times this, the table rubs in proportion to the speed, as a wet or creeping
    contact does: its coefficient is min(table_friction, speed / table_slip) [m/s]. 0: Coulomb's law down to rest."""
    law: ElasticLaw = ElasticLaw.NEO_HOOKEAN
    """The elastic energy."""

    def __post_init__(self) -> None:
        for name, (low, high, unit) in _RANGES.items():
            value = getattr(self, name)
            if not (np.isfinite(value) and low <= value <= high):
                raise PlopError(
                    "A material parameter is out of range.",
                    where=name,
                    expected=f"{low:g} to {high:g} {unit}",
                    found=f"{value:g}",
                    fix="Check the unit: lengths are metres, stresses pascals.",
                )

    @property
    def shear_pa(self) -> float:
        """Lame's second parameter mu [Pa]."""
        return self.youngs_modulus_pa / (2 * (1 + self.poisson))

    @property
    def lame_pa(self) -> float:
        """Lame's first parameter lambda [Pa]."""
        return self.youngs_modulus_pa * self.poisson / ((1 + self.poisson) * (1 - 2 * self.poisson))

    @property
    def wave_speed_m_s(self) -> float:
        """Speed of a pressure wave at rest, sqrt((lambda + 2 mu) / density) [m/s]."""
        return float(np.sqrt((self.lame_pa + 2 * self.shear_pa) / self.density_kg_m3))
