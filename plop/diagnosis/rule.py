"""The numbers by which a verdict is decided, each with its principle."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.stats import norm


@dataclass(frozen=True)
class DecisionRule:
    """Target error rates and margins."""

    alarm: float = 0.01
    """Chance of a false alarm by each of the two ways to raise one: a law that is found, and a difference to the
    reference whatever it is."""
    alike: float = 0.05
    """Chance with which a law that does as well as the best one is called worse, and below which the strongest law is
    taken for what it is where something is there for certain."""
    most: float = 0.6
    """Share of the difference to the reference that a law must take away, with nothing left that stands out, to be
    taken for what it is where something is there for certain and the law alone might be chance."""
    nothing: float = 0.3
    """The share below which it is not named at all: what explains so little is not what is missing. Nor is a field that
    predicts so little of what recordings show the measure of it."""
    response_error: float = 0.25
    """Standard deviation of how much too strongly or too weakly the engine responds to a law [-]: the same in all
    episodes, so that no scatter between them shows it, and as much again from motion to motion, by which laws are
    ranked (from runs where the truth is known, docs/results/parts.md). It widens intervals; a second law must do more
    than what is wrong with the response to the first; and what a law leaves beyond that, where it stands out, is the
    work of another law."""
    seen: float = 0.9
    """How often an effect as large as a detection limit would have been named."""

    @property
    def whole(self) -> float:
        """Share of the difference to the reference that a law takes away if only its response is wrong."""
        return 1 - self.response_error**2

    @property
    def response_width(self) -> float:
        """Half width of an amplitude's 95 % interval that comes from the response alone [-]."""
        return float(norm.ppf(0.975)) * self.response_error


RULE = DecisionRule()
