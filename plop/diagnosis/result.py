"""What is kept of a diagnosis: diagnosis.json of `plop diagnose`, which every page, command and benchmark reads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from plop.artifacts.result_file import ResultFile
from plop.diagnosis.contrast import P_LARGEST
from plop.diagnosis.finding import ERRORS_LEAST, GAIN_LEAST, NO_HELP
from plop.diagnosis.limits import Limit
from plop.diagnosis.next_motion import NextMotion
from plop.diagnosis.verdict import Reason, Verdict
from plop.parameters import Estimate


@dataclass(frozen=True)
class Ranked:
    """One law of the ranking, or the base's own parameters; shares are of the held-out squared error."""

    effect: str
    kind: str
    """physics, decoy or base."""
    help: str
    law: str
    source: str
    gain: float
    """Share that it takes away; negative where it makes the error larger."""
    gain_error: float
    p: float | None
    contrast: float | None
    """Distance of its amplitude from that in the reference, in standard errors; None without reference."""
    contrast_p: float | None
    size_mm: float | None
    """RMS displacement that it makes [mm]."""
    shown: float
    """Share that it takes away where no episode is held out."""
    shown_by: str
    """The episode that shows nearly all of it; "" where there are several."""
    alone: float
    """Share that it takes away with the base's own parameters left as they are."""
    parameters: Mapping[str, Estimate]
    passes: bool
    """It may be named."""
    reasons: tuple[Reason, ...]
    """Why not."""

    def why_not(self) -> list[str]:
        """Write why it is not named, one text a reason."""
        return [self._text(reason) for reason in self.reasons]

    def _text(self, reason: Reason) -> str:
        if reason == Reason.CHANCE:
            return f"p = {self.p:.3f} > {P_LARGEST}"
        if reason == Reason.SAME_IN_REFERENCE:
            distance = f"{self.contrast:.1f} standard errors, p = {self.contrast_p:.2f}"
            return f"the same amplitude as in the reference recordings ({distance})"
        return {
            Reason.NO_SHAMS: "no permutation test",
            Reason.NO_HELP: f"{NO_HELP}: fitted to the other episodes, it does not make the held-out ones better",
            Reason.SMALL_GAIN: f"gain {100 * self.gain:.1f} % <= {100 * GAIN_LEAST:g} %",
            Reason.UNSURE_GAIN: f"gain within {ERRORS_LEAST:g} standard errors ({100 * self.gain_error:.1f} %)",
            Reason.AT_BOUND: "a parameter is at its bound",
            Reason.ONE_EPISODE: "only one episode shows it",
        }[reason]


@dataclass(frozen=True)
class SensorFault:
    """A significant fault of one camera."""

    camera: str
    fault: str
    text: str
    z: float
    """Significance of all its parameters together, as standard errors of a normal."""
    values: Mapping[str, Estimate]
    alternatives: tuple[str, ...]
    """Faults that would explain it as well."""


@dataclass(frozen=True)
class Shams:
    """The best gains over the library on evidence that is wrong on purpose."""

    count: int
    quantile_98: float


@dataclass(frozen=True)
class Diagnosis(ResultFile):
    """All that a diagnosis says; errors are mean squared residuals in units of their expectation."""

    FILE: ClassVar[str] = "diagnosis.json"
    COMMAND: ClassVar[str] = "diagnose"
    SCHEMA: ClassVar[int] = 2

    verdict: Verdict
    ranking: tuple[Ranked, ...]
    """Best first, one for each effect."""
    base: Ranked
    """The base's own parameters."""
    limits: Mapping[str, Limit]
    """By effect."""
    sensors: tuple[SensorFault, ...] | None
    """None where they were not looked for."""
    shams: Shams
    error: float
    floor: float | None
    """In the reference recordings."""
    excess: float | None
    """How much larger the error is than there, in standard errors."""
    closed_share: float | None
    """Share of the explainable gap that the best law closes."""
    next_step: str
    next_motion: NextMotion | None
    episodes: tuple[str, ...]
    reference_episodes: tuple[str, ...]
    dropped: Mapping[str, str]
    """Episodes and laws that were left out, with the reason."""
    environment: str
    seconds: float
    seconds_screen: float
    engine_runs: int

    def row(self, effect: str) -> Ranked | None:
        """Find a law, or the base's own parameters, by name."""
        return next((row for row in (*self.ranking, self.base) if row.effect == effect), None)

    @property
    def named(self) -> list[Ranked]:
        """Rows of what the verdict names, in its order."""
        return [row for row in map(self.row, self.verdict.named) if row is not None]
