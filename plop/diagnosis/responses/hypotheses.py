"""What may be missing: every law of the library, at settings of which each has one response.

A law's response over its amplitude is a curve: what sticks, yields or tears does nothing up to a threshold. It is
computed at a few amplitudes; near each of them it is taken to be in proportion, so that a hypothesis is one field of
displacements, and what is fitted is how many times the recordings show it. A law with two amplitudes, a pull along x
and y, is tried in directions around the circle.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from plop.physics.effects.effect import Effect
from plop.physics.effects.library import EffectType

LARGER = 5.0
"""A much larger amplitude, in typical ones."""
REFITTED = {"stiffness": 0.3, "damping": 1.0, "table_friction": 0.2, "blade_friction": 0.2}
"""The base's own parameters, and how far `plop identify` may be off: standard deviations in typical amplitudes."""
DIRECTIONS = 16
"""Directions in which a law with two amplitudes is tried: 11 degrees off is 2 % of the response."""


@dataclass(frozen=True)
class Column:
    """One amplitude of a law, with the settings of its shape."""

    effect: str
    amplitude: str
    unit: str
    shapes: tuple[tuple[str, float], ...]
    """Shape parameters that belong to it."""
    value: float
    """Typical amplitude."""
    low: float
    high: float
    tried: tuple[float, ...] = ()
    """Further amplitudes at which it is tried."""
    needs_blade: bool = False
    """The law does nothing where the tool is no blade."""

    @property
    def key(self) -> str:
        """Name of the column, e.g. "fibres(angle_deg=45).ratio"."""
        inner = ",".join(f"{name}={value:g}" for name, value in self.shapes)
        return f"{self.effect}({inner}).{self.amplitude}"

    @property
    def levels(self) -> tuple[float, ...]:
        """Amplitudes at which the response is computed: typical and further ones, the other way where there is one.

        Where a law says nothing of further ones, a much larger one: there its response may be another in shape.
        """
        other = max(-self.value, self.low) if self.value > 0 else min(-self.value, self.high)
        both = self.low < 0 < self.high
        larger = () if both or not self.low <= LARGER * self.value <= self.high else (LARGER * self.value,)
        return tuple(dict.fromkeys((self.value, *(self.tried or larger), *((other,) if both else ()))))

    def build(self, types: Mapping[str, EffectType], value: float | None = None) -> Effect:
        """Make the effect at an amplitude, `value` of the column when none is given; kept inside its range."""
        wanted = self.value if value is None else value
        return types[self.effect](**{self.amplitude: min(max(wanted, self.low), self.high)}, **dict(self.shapes))


Settings = tuple[tuple[Column, float], ...]
"""Amplitudes that act together in one run of the engine; none: no law."""


def run_key(settings: Settings) -> str:
    """Name a run by what is added to the engine, e.g. "viscosity().viscosity_pa_s=12"."""
    return " + ".join(f"{column.key}={value:.6g}" for column, value in settings)


@dataclass(frozen=True)
class Candidate:
    """A law with one setting of its shape parameters."""

    effect: str
    kind: str
    """physics, decoy or base."""
    columns: tuple[Column, ...]
    """One for each amplitude."""
    shape_units: tuple[tuple[str, str], ...] = ()
    """Name and unit of every shape parameter."""

    @property
    def key(self) -> str:
        """Name of the law and its shape, e.g. "fibres(angle_deg=45)"."""
        return self.columns[0].key.rsplit(".", 1)[0].removesuffix("()")


@dataclass(frozen=True)
class Hypothesis:
    """A law at certain amplitudes: one response, a sum of runs with weights."""

    candidate: Candidate
    values: tuple[float, ...]
    """Amplitudes, one for each column."""
    runs: tuple[tuple[Settings, float], ...]
    """Runs of the engine and their weights in the response."""
    coarse: bool = False
    """The runs are those of a survey with few particles."""

    @property
    def effect(self) -> str:
        """Name of the law."""
        return self.candidate.effect

    @property
    def key(self) -> str:
        """Name of the hypothesis, e.g. "swelling().rate_per_s=-0.1"."""
        return run_key(tuple(zip(self.candidate.columns, self.values, strict=True)))

    @property
    def is_typical(self) -> bool:
        """Tell whether a law is at its typical amplitude; in any direction, where it has two amplitudes."""
        columns = self.candidate.columns
        return len(columns) > 1 or self.values[0] == columns[0].value

    def at(self, multiple: float) -> Hypothesis:
        """Give the same law at amplitudes so many times as large, see `with_values`."""
        return self.with_values([multiple * value for value in self.values])

    def with_values(self, values: Sequence[float]) -> Hypothesis:
        """Give the same law at other amplitudes, kept in their ranges, as one run of the engine."""
        columns = self.candidate.columns
        kept = tuple(float(np.clip(v, column.low, column.high)) for column, v in zip(columns, values, strict=True))
        settings = tuple((c, v) for c, v in zip(columns, kept, strict=True) if v != 0)
        return Hypothesis(self.candidate, kept, ((settings, 1.0),))

    def across(self, coarse: bool) -> Hypothesis | None:
        """Give a law with two amplitudes at right angles to its direction, as large; None of any other law.

        Args:
            coarse: From the runs of a survey.
        """
        if len(self.values) == 1:
            return None
        x, y = self.values
        return replace(_from_axes(self.candidate, (-y, x)), coarse=coarse)

    @property
    def most(self) -> float:
        """Largest multiple that keeps all amplitudes in their ranges."""
        return min(
            (column.high if value > 0 else column.low) / value
            for column, value in zip(self.candidate.columns, self.values, strict=True)
            if value != 0
        )


def candidates_of(types: Mapping[str, EffectType], names: Iterable[str] | None = None) -> list[Candidate]:
    """List the laws of a library with the settings of their shapes.

    Args:
        types: Effects by name, see `library`.
        names: Only these effects, and the base's own parameters; all when absent.
    """
    found = []
    for name, kind in types.items():
        if names is not None and name not in names and kind.kind != "base":
            continue
        units = tuple((p.name, p.unit) for p in kind.shapes)
        for variant in kind.variants:
            shapes = tuple(sorted({p.name: variant.get(p.name, p.default) for p in kind.shapes}.items()))
            columns = tuple(
                Column(name, p.name, p.unit, shapes, p.typical or p.step, p.low, p.high, p.tried, kind.needs_blade)
                for p in kind.amplitudes
            )
            found.append(Candidate(name, kind.kind, columns, units))
    return found


def hypotheses_of(candidates: Sequence[Candidate]) -> list[Hypothesis]:
    """List all hypotheses at the amplitudes at which laws are tried first."""
    found = []
    for candidate in candidates:
        if len(candidate.columns) == 1:
            (column,) = candidate.columns
            found += [Hypothesis(candidate, (value,), ((((column, value),), 1.0),)) for value in column.levels]
        else:
            found += _around(candidate)
    return found


def _around(candidate: Candidate) -> list[Hypothesis]:
    """Try two amplitudes in directions around the circle."""
    sizes = np.abs([column.value for column in candidate.columns])
    angles = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    return [_from_axes(candidate, [*(sizes * np.round((np.cos(a), np.sin(a)), 12))]) for a in angles]


def _from_axes(candidate: Candidate, values: Sequence[float]) -> Hypothesis:
    """Put a law with several amplitudes together from runs with one each."""
    runs = []
    for column, value in zip(candidate.columns, values, strict=True):
        way = abs(column.value) if value > 0 else max(-abs(column.value), column.low)
        if value != 0:
            runs.append((((column, way),), float(value / way)))
    return Hypothesis(candidate, tuple(map(float, values)), tuple(runs))


def base_hypotheses(candidates: Sequence[Candidate]) -> list[Hypothesis]:
    """Give the base's own parameters, each off by one standard deviation.

    Args:
        candidates: Of the whole library.
    """
    found = {}
    for candidate in candidates:
        if candidate.effect in REFITTED and candidate.effect not in found:
            (column,) = candidate.columns
            deviation = REFITTED[candidate.effect] * column.value
            run = min((v for v in column.levels if v * deviation > 0), key=lambda v: abs(np.log(v / deviation)))
            found[candidate.effect] = Hypothesis(candidate, (deviation,), ((((column, run),), deviation / run),))
    return list(found.values())
