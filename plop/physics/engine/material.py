"""What the object is made of."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated

import numpy as np

from plop.setting_kinds import COMMON, Range, Settings, Unit


class ElasticLaw(IntEnum):
    """Which hyperelastic energy the object obeys; the values are what the kernels switch on."""

    NEO_HOOKEAN = 0
    """Compressible neo-Hookean, W = mu/2 (I1 - 3) - mu ln J + lambda/2 (ln J)^2."""
    FIXED_COROTATED = 1
    """Fixed corotated, W = mu |F - R|^2 + lambda/2 (J - 1)^2 (Stomakhin et al. 2012)."""
    STABLE_NEO_HOOKEAN = 2
    """Stable neo-Hookean with the coefficients used as they are (Smith et al. 2018, Eq. 14)."""


Friction = Annotated[float, Range(0, 10)]
"""A coefficient of Coulomb's law."""


@dataclass(frozen=True)
class Material(Settings):
    """Parameters of a homogeneous soft object and of its contacts."""

    youngs_modulus_pa: Annotated[float, Range(50, 1e10), Unit("Pa"), COMMON] = 1.0e4
    """Young's modulus."""
    poisson: Annotated[float, Range(-0.9, 0.495)] = 0.4
    """Poisson's ratio."""
    density_kg_m3: Annotated[float, Range(1, 3e4), Unit("kg/m^3")] = 1000.0
    """Density at rest; with imposed motions only stiffness over density matters."""
    damping_per_s: Annotated[float, Range(0, 1e4), Unit("1/s")] = 0.0
    """Velocity damping: a free velocity falls as exp(-damping t)."""
    viscosity_pa_s: Annotated[float, Range(0, 1e5), Unit("Pa s")] = 0.0
    """Kelvin-Voigt viscosity of the deviatoric rate of deformation."""
    table_friction: Friction = 0.5
    """Coulomb friction between object and table."""
    tool_friction: Friction = 0.5
    """Coulomb friction between object and tool."""
    cut_friction: Friction = 0.5
    """Coulomb friction between the two faces of a cut."""
    toughness_j_m2: Annotated[float, Range(0, 1e5), Unit("J/m^2")] = 0.0
    """Energy that the tool's edge spends on each square metre of new cut."""
    table_slip_m_s: Annotated[float, Range(0, 10), Unit("m/s")] = 0.0
    """Sliding slower than `table_friction` times this, the table rubs in proportion to the speed, as a wet or creeping
    contact does: its coefficient is min(table_friction, speed / table_slip). 0: Coulomb's law down to rest."""
    law: ElasticLaw = ElasticLaw.NEO_HOOKEAN
    """The elastic energy."""

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
