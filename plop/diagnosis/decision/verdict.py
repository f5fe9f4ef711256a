"""What diagnosis says; never without what it rests on."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from plop.diagnosis.evidence.description import Description


class VerdictKind(StrEnum):
    """What a diagnosis ends with."""

    NOTHING_DETECTABLE = "NOTHING DETECTABLE"
    """The error holds no sign of a law of the library."""
    SENSOR = "SENSOR"
    """A camera, or what is known of the tool, is faulty; the tracks rest on it."""
    EFFECT = "EFFECT"
    """A law is missing, or two."""
    BASE_PARAMETER = "BASE PARAMETER"
    """No law is missing: a parameter that the base has is another one."""
    CONFOUNDED = "CONFOUNDED"
    """One of several, which these motions cannot distinguish."""
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

    CHANCE = "chance"
    """Too likely where nothing is hidden."""
    NO_HELP = "no_help"
    """Fitted to the other episodes, it does not make the held-out ones better."""
    ONE_EPISODE = "one_episode"
    """Only one episode shows it, so that it says nothing about the others."""
    AT_BOUND = "at_bound"
    """A fitted amplitude is at the end of its range: it is named only as a part."""


@dataclass(frozen=True)
class Grounds:
    """What a verdict rests on; errors are mean squared residuals in units of their expectation."""

    sensors: tuple[str, ...] = ()
    """Significant sensor faults, in words."""
    error: float | None = None
    """Of the base, its own parameters refitted to all episodes together."""
    floor: float | None = None
    """The same in the reference recordings."""
    left: float | None = None
    """With what is named, or else with the best law."""
    change_p: float | None = None
    """Chance that recordings and reference differ by as much, in whatever way, where nothing is hidden."""
    rest_p: float | None = None
    """The same for what is left with what is named."""
    closed: float | None = None
    """Share of that difference which goes away with what is named."""
    decoys: tuple[str, ...] = ()
    """The decoy that explains most, where one does."""
    resembles: str | None = None
    """Where the difference alone is no alarm: the law that is, but explains too little to be named."""
    alternatives: tuple[str, ...] = ()
    """What cannot be distinguished from the first that is named."""
    share: float | None = None
    """Share of the held-out squared error that goes away with what is named."""
    reference: bool = True
    """There are recordings in which nothing is missing."""
    description: Description | None = None
    """What the recordings show, where nothing of the library explains it and they may differ from the reference."""
    alone: tuple[str, ...] = ()
    """Where nothing is found: recordings that are explained far less well than the others of their motion."""
    physics: VerdictKind | None = None
    """With a sensor fault: what the tracks say as they are."""
    physics_named: tuple[str, ...] = ()
    """What they name."""


@dataclass(frozen=True)
class Verdict:
    """What diagnosis says."""

    kind: VerdictKind
    named: tuple[str, ...]
    """Effects, base parameters or sensor faults; the most likely first."""
    text: str
    """One sentence, made from the rest."""
    evidence: Grounds = field(default_factory=Grounds)
