"""What is kept of a diagnosis: diagnosis.json of `plop diagnose`, which every page, command and benchmark reads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from plop.artifacts.result_file import ResultFile
from plop.diagnosis.decision.finding import NO_HELP
from plop.diagnosis.decision.limits import Limit
from plop.diagnosis.decision.verdict import Reason, Verdict
from plop.diagnosis.rule import RULE
from plop.parameters import Estimate
from plop.sensors.faults.library import TOOL


@dataclass(frozen=True)
class Ranked:
    """One law of the ranking."""

    effect: str
    kind: str
    """physics, decoy or base."""
    help: str
    law: str
    source: str
    gain: float
    """Share of the held-out squared error that it takes away; negative where it makes the error larger."""
    gain_error: float
    strength: float
    """Sum over episodes of the root of the gain of log density, held out [nats^0.5]: what ranks."""
    gains: tuple[float, ...]
    """Gain of log density in each episode, then in each of the reference, given all others [nats]: compares laws."""
    p: float
    """Chance that the whole search finds as much where nothing is hidden."""
    size_mm: float
    """RMS displacement that it makes [mm]."""
    parameters: Mapping[str, Estimate]
    passes: bool
    """It may be named."""
    reasons: tuple[Reason, ...]
    """Why not."""

    def why_not(self) -> list[str]:
        """Write why it is not named, one text a reason."""
        return [self._text(reason) for reason in self.reasons]

    def _text(self, reason: Reason) -> str:
        return {
            Reason.CHANCE: f"p = {self.p:.3f} > {RULE.alarm:g}",
            Reason.NO_HELP: f"{NO_HELP}: fitted to the other episodes, it does not make the held-out ones better",
            Reason.ONE_EPISODE: "only one episode shows it",
            Reason.AT_BOUND: "a parameter is at its bound",
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

    def typed(self) -> list[str]:
        """Write its values as `plop repair --fault` and `plop simulate --fault` take them."""
        camera = "" if self.camera == TOOL else f"@{self.camera}"
        return [f"{self.fault}.{key}={found.value:.4g}{camera}" for key, found in self.values.items()]


@dataclass(frozen=True)
class Diagnosis(ResultFile):
    """All that a diagnosis says; errors are mean squared residuals in units of their expectation."""

    FILE: ClassVar[str] = "diagnosis.json"
    COMMAND: ClassVar[str] = "diagnose"
    SCHEMA: ClassVar[int] = 9

    verdict: Verdict
    ranking: tuple[Ranked, ...]
    """One for each law, what is named first, then best first."""
    limits: Mapping[str, Limit]
    """By law."""
    sensors: tuple[SensorFault, ...] | None
    """None where they were not looked for."""
    searches: int
    """Ways of dealing the episodes out by which chances are counted; 1 without reference."""
    error: float
    floor: float | None
    """In the reference recordings."""
    next_step: str
    episodes: tuple[str, ...]
    repeats: Mapping[str, str]
    """Episode -> one of the reference with the same motion, where there is one."""
    reference_episodes: tuple[str, ...]
    dropped: Mapping[str, str]
    """Episodes and laws that were left out, with the reason."""
    environment: str

    def row(self, effect: str) -> Ranked | None:
        """Find a law, or a parameter of the base's own, by name."""
        return next((row for row in self.ranking if row.effect == effect), None)

    @property
    def named(self) -> list[Ranked]:
        """Rows of what the verdict names, in its order."""
        return [row for row in map(self.row, self.verdict.named) if row is not None]
