"""Parameters of a `Material` that can be fitted: range, finite difference, and what is known of them beforehand."""

from __future__ import annotations

from typing import Any

from plop.parameters import Parameter
from plop.physics.engine.material import Material


def _of_material(
    name: str, unit: str, low: float, high: float, step: float, prior: float, source: str, **others: Any
) -> Parameter:
    return Parameter(name, unit, low, high, step, getattr(Material(), name), source=source, prior=prior, **others)


_COULOMB = "Coulomb 1785; Johnson, Contact Mechanics, 1985, ch. 7"
PARAMETERS = {
    p.name: p
    for p in (
        _of_material("youngs_modulus_pa", "Pa", 1e2, 1e8, 0.05, 2.0, "Hooke's law", logarithmic=True, model_error=0.35),
        _of_material("poisson", "-", 0.0, 0.49, -0.01, 0.1, "Hooke's law"),
        _of_material("density_kg_m3", "kg/m^3", 20.0, 2e4, 0.05, 0.4, "Newton's second law", logarithmic=True),
        _of_material(
            "damping_per_s", "1/s", 0.0, 200.0, 1.0, 5.0, "mass-proportional Rayleigh damping; Bathe 1996, ch. 9"
        ),
        _of_material("viscosity_pa_s", "Pa s", 0.0, 1e3, 2.0, 5.0, "Kelvin-Voigt solid; Larson 1999"),
        _of_material("table_friction", "-", 0.0, 2.0, 0.03, 0.2, _COULOMB, model_error=0.08),
        _of_material("tool_friction", "-", 0.0, 2.0, 0.03, 0.2, _COULOMB, model_error=0.08),
        _of_material("toughness_j_m2", "J/m^2", 0.0, 1e3, 2.0, 5.0, "Griffith 1921; Atkins 2009, ch. 2"),
        _of_material("table_slip_m_s", "m/s", 1e-5, 1.0, 0.1, 1.6, "regularised Coulomb friction", logarithmic=True),
    )
}
"""By name. Priors are weak: a factor of seven in the stiffness, since soft objects differ by orders of magnitude, of
five in the speed of slip, and 0.2 in a friction, which lies between 0.1 and 1 for nearly everything (Johnson 1985).
The others are of the order of the values themselves and matter only where recordings tell next to nothing.

Model errors are those of fits to blocks that Drake and MuJoCo simulated, beyond their intervals (maximum likelihood,
six fits, `python -m benchmarks.worlds.identified --bases 0`): declared values are not always effective ones, and the
engine bends and rubs a little differently. Those of the other parameters are not known."""
