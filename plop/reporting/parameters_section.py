"""Parameters with units and intervals; what the recordings do not determine is grey and says so."""

from __future__ import annotations

from dataclasses import dataclass

from plop.parameters import Estimate
from plop.physics.calibration.material_parameters import PARAMETERS
from plop.reporting.compared import Compared, ReportFacts

ENGINE = "engine"
"""What a parameter belongs to that is none of an effect."""


@dataclass(frozen=True)
class ParameterRow:
    """One parameter of one model."""

    model: str
    part: str
    """An effect, or ENGINE."""
    name: str
    estimate: Estimate


@dataclass(frozen=True)
class ParametersSection:
    """The parameters of every model."""

    fitted: list[ParameterRow]
    given: list[ParameterRow]


def parameters_section(facts: ReportFacts) -> ParametersSection:
    """List the parameters of every model: what was fitted, and what was given."""
    return ParametersSection(
        [row for compared in facts.compared for row in _fitted(compared)],
        [row for compared in facts.compared for row in _given(compared)],
    )


def _fitted(compared: Compared) -> list[ParameterRow]:
    parts = [(ENGINE, compared.model.estimates), *compared.model.effects]
    return [ParameterRow(compared.label, part, name, found) for part, own in parts for name, found in own.items()]


def _given(compared: Compared) -> list[ParameterRow]:
    units = {name: PARAMETERS[name].unit if name in PARAMETERS else "-" for name in compared.model.given}
    return [
        ParameterRow(compared.label, ENGINE, name, Estimate(value, unit=units[name], fitted=False))
        for name, value in compared.model.given.items()
    ]
