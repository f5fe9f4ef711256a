"""One thing that may be named, with its evidence, and the conditions under which it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from plop.diagnosis.contrast import P_LARGEST, Contrast
from plop.diagnosis.verdict import Reason
from plop.parameters import Estimate

GAIN_LEAST = 0.05
"""Least share of the held-out error that a named effect takes away."""
STEADY_LEAST = GAIN_LEAST / 2
"""Least share that it takes away of the error of the episodes but for the one that it helps most."""
ERRORS_LEAST = 2.0
"""Least gain in standard errors over episodes."""
PARTLY_SHARE = 0.6
"""Share of the explainable gap below which an effect is named only as a part: most of what a law that is not in the
library does, a neighbour can do as well."""
LONE_SHARE = 0.8
"""Share of what a law explains from which on one episode alone is said to show it."""


NO_HELP = "does not help"
"""What is said of a law that takes nothing of the held-out error away.

A gain is a share of the error without the law, and has no least value: fitted to some episodes, a law (or the stiffness
that is fitted along) may make the others many times worse. By how much says nothing about the law, only that it is not
what is missing."""


def explained_text(gain: float, error: float) -> str:
    """Write the share of the held-out error that a law takes away with its standard error; never less than nothing."""
    if gain <= 0:
        return NO_HELP
    return f"{100 * gain:.1f} ± {100 * error:.1f} %" if error <= 1 else f"{100 * gain:.1f} % (± more than 100 %)"


@dataclass(frozen=True)
class Finding:
    """One named thing with its evidence."""

    name: str
    kind: str
    """physics, decoy, base or sensor."""
    parameters: Mapping[str, Estimate]
    gain: float
    gain_error: float
    p: float | None
    contrast: Contrast | None
    """Its amplitude against that in the reference recordings; None without reference."""
    steady: float | None = None
    """Its gain over the episodes without the one that it helps most [-]; None when that is not known."""
    alone: float = 0.0
    """Share of the held-out error that it takes away with the base's own parameters left as they are [-]."""
    alone_error: float = 0.0
    """Standard error of the difference between `alone` and what the base's own parameters take away [-]."""
    helps: str = ""
    """The episode that it helps most."""
    shown: float = 0.0
    """Share of the error that it takes away where no episode is held out [-]: all that can be known of a law that
    acts in one motion only."""
    shown_by: str = ""
    """The episode that shows nearly all of it; "" where there are several."""

    @property
    def at_bound(self) -> bool:
        """Tell whether a parameter ran into its range."""
        return any(p.at_bound for p in self.parameters.values())

    @property
    def differs(self) -> bool:
        """Tell whether its amplitude is another than in the reference."""
        return self.contrast is None or self.contrast.p <= P_LARGEST

    @property
    def carried(self) -> bool:
        """Tell whether one episode alone carries it."""
        return self.steady is not None and self.steady <= STEADY_LEAST

    def passes(self) -> bool:
        """Tell whether all conditions for being named hold."""
        return not self.reasons()

    def hardly_differs(self) -> bool:
        """Tell whether only the reference is against it: its amplitude is not surely another than there."""
        return not self.differs and len(self.reasons()) == 1

    def ends(self) -> bool:
        """Tell whether only the end of its range is against it."""
        return self.reasons() == [Reason.AT_BOUND]

    def reasons(self) -> list[Reason]:
        """Say which conditions fail."""
        failed = {
            Reason.NO_SHAMS: self.p is None,
            Reason.CHANCE: self.p is not None and self.p > P_LARGEST,
            Reason.NO_HELP: self.gain <= 0,
            Reason.SMALL_GAIN: 0 < self.gain <= GAIN_LEAST,
            Reason.UNSURE_GAIN: self.gain <= ERRORS_LEAST * self.gain_error,
            Reason.AT_BOUND: self.at_bound,
            Reason.ONE_EPISODE: self.carried,
            Reason.SAME_IN_REFERENCE: not self.differs,
        }
        return [reason for reason, holds in failed.items() if holds]
