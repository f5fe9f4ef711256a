"""What diagnosis says; never without what it rests on."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum


class VerdictKind(StrEnum):
    """What a diagnosis ends with."""

    NOTHING_DETECTABLE = "NOTHING DETECTABLE"
    """The error holds no sign of a law of the library."""
    SENSOR = "SENSOR"
    """A camera is faulty, so that physics cannot be judged."""
    EFFECT = "EFFECT"
    """A law is missing, or two."""
    BASE_PARAMETER = "BASE PARAMETER"
    """No law is missing: a parameter that the base has is another one."""
    CONFOUNDED = "CONFOUNDED"
    """One of several, which these motions cannot tell apart."""
    PARTLY = "PARTLY"
    """What is named explains a part only."""
    NONE_OF_THESE = "NONE OF THESE"
    """Something is missing that the library does not hold, or that cannot be named."""

    @property
    def can_be_added(self) -> bool:
        """Tell whether the first name is something that `plop augment` can add to the model."""
        return self in (self.EFFECT, self.BASE_PARAMETER, self.CONFOUNDED, self.PARTLY)


class Reason(StrEnum):
    """Why a law is not named."""

    NO_SHAMS = "no_shams"
    CHANCE = "chance"
    """Too likely by chance."""
    NO_HELP = "no_help"
    """Fitted to the other episodes, it does not make the held-out ones better."""
    SMALL_GAIN = "small_gain"
    UNSURE_GAIN = "unsure_gain"
    """The gain is within its standard errors."""
    AT_BOUND = "at_bound"
    """A fitted amplitude is at the end of its range: it is named only as a part."""
    ONE_EPISODE = "one_episode"
    """One episode alone shows it, so that it says nothing about the others."""
    SAME_IN_REFERENCE = "same_in_reference"
    """Its amplitude is that in the reference recordings."""


@dataclass(frozen=True)
class Lone:
    """A law that one episode alone shows."""

    effect: str
    episode: str


@dataclass(frozen=True)
class Earlier:
    """The verdict before two laws were fitted together."""

    kind: VerdictKind
    named: tuple[str, ...]


@dataclass(frozen=True)
class Grounds:
    """What a verdict rests on; errors are mean squared residuals in units of their expectation."""

    sensors: tuple[str, ...] = ()
    """Significant sensor faults, in words."""
    error: float | None = None
    """Of the base."""
    floor: float | None = None
    """In the reference recordings."""
    left: float | None = None
    """With what is named, or else with the best law."""
    excess: float | None = None
    """How much larger the error is than in the reference, in standard errors."""
    excess_p: float | None = None
    """The same as a chance."""
    decoys: tuple[str, ...] = ()
    """The decoy that explains most, where one does."""
    alternatives: tuple[str, ...] = ()
    """What cannot be told from the first that is named."""
    share: float | None = None
    """Share of the held-out error that goes away with what is named."""
    rest: bool | None = None
    """Of a base parameter: whether what it leaves is still beyond the reference's error."""
    lone: Lone | None = None
    """Would have been named had another episode shown it."""
    unsure: str | None = None
    """Explains most, but too few episodes tell whether its amplitude is another than in the reference."""
    alone: Earlier | None = None


@dataclass(frozen=True)
class Verdict:
    """What diagnosis says."""

    kind: VerdictKind
    named: tuple[str, ...]
    """Effects, base parameters or sensor faults; the most likely first."""
    text: str
    """One sentence, made from the rest."""
    evidence: Grounds = field(default_factory=Grounds)
