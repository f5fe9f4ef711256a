"""What may be missing: every effect of the library, with the settings at which it is tried."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from plop.physics.effects.effect import Effect
from plop.physics.effects.library import EffectType

BASE_COLUMNS = ("stiffness",)
"""Base parameters that are always fitted along, so that no effect is credited with what they can explain. Damping
is not among them: it would take the place of viscosity, which it resembles; the two compete instead."""


@dataclass(frozen=True)
class Column:
    """One direction in which predictions may be changed: one amplitude of one effect, the rest as given."""

    effect: str
    amplitude: str
    unit: str
    shapes: tuple[tuple[str, float], ...]
    """Shape parameters that belong to it."""
    value: float
    """Amplitude at which the response is computed."""
    low: float
    high: float
    tried: tuple[float, ...] = ()
    """Further amplitudes at which the search for it may begin."""

    @property
    def key(self) -> str:
        """Name of the column, e.g. "fibres(angle_deg=45).ratio"."""
        inner = ",".join(f"{name}={value:g}" for name, value in self.shapes)
        return f"{self.effect}({inner}).{self.amplitude}"

    def build(self, types: Mapping[str, EffectType], value: float | None = None) -> Effect:
        """Make the effect at an amplitude, `value` of the column when none is given; kept inside its range."""
        wanted = self.value if value is None else value
        return types[self.effect](**{self.amplitude: min(max(wanted, self.low), self.high)}, **dict(self.shapes))


@dataclass(frozen=True)
class Candidate:
    """One hypothesis: an effect with one setting of its shape parameters."""

    effect: str
    kind: str
    """physics, decoy or base."""
    columns: tuple[Column, ...]
    """One for each amplitude."""
    shape_units: tuple[tuple[str, str], ...] = ()
    """Name and unit of every shape parameter."""

    @property
    def key(self) -> str:
        """Name of the hypothesis, e.g. "fibres(angle_deg=45)"."""
        return self.columns[0].key.rsplit(".", 1)[0].removesuffix("()")


def candidates_of(types: Mapping[str, EffectType], names: Iterable[str] | None = None) -> list[Candidate]:
    """List the hypotheses of a library.

    Args:
        types: Effects by name, see `library`.
        names: Only these effects; all when absent.
    """
    found = []
    for name, kind in types.items():
        if names is not None and name not in names and kind.kind != "base":
            continue
        units = tuple((p.name, p.unit) for p in kind.shapes)
        for variant in kind.variants:
            shapes = tuple(sorted({p.name: variant.get(p.name, p.default) for p in kind.shapes}.items()))
            columns = tuple(
                Column(name, p.name, p.unit, shapes, p.typical or p.step, p.low, p.high, p.tried)
                for p in kind.amplitudes
            )
            found.append(Candidate(name, kind.kind, columns, units))
    return found
