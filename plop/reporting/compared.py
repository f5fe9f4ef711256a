"""What a report is made from: the comparisons of several models with the same recordings, and what was diagnosed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

from plop.comparison.result import Comparison
from plop.diagnosis.decision.result import Diagnosis
from plop.metrics.scores import Scores
from plop.parameters import Estimate
from plop.uncertainty.scores import BandScores


@dataclass(frozen=True)
class ModelNumbers:
    """What is known of a model's parameters."""

    estimates: Mapping[str, Estimate] = field(default_factory=dict)
    """Those of an engine that were fitted."""
    effects: tuple[tuple[str, Mapping[str, Estimate]], ...] = ()
    """Effects that were added, with their parameters."""
    given: Mapping[str, float] = field(default_factory=dict)
    """Those of an engine that were not fitted."""

    @classmethod
    def of(cls, model: Mapping[str, Any]) -> Self:
        """Take them from the content of model.json; raises KeyError or TypeError where it is damaged."""
        fitted = {name: Estimate.from_json(found) for name, found in model.get("estimates", {}).items()}
        material = model.get("engine", {}).get("material", {}) if model.get("kind") == "engine" else {}
        return cls(
            fitted,
            tuple(
                (added["effect"], {name: Estimate.from_json(found) for name, found in added["parameters"].items()})
                for added in model.get("effects", ())
            ),
            {k: v for k, v in material.items() if isinstance(v, (int, float)) and k not in fitted},
        )


@dataclass(frozen=True)
class Compared:
    """One model as it was compared."""

    label: str
    colour: str
    errors: Comparison
    model: ModelNumbers = ModelNumbers()

    @property
    def episodes(self) -> list[str]:
        """Episodes that it was compared on."""
        return [row.label for row in self.errors.tables.episode]


@dataclass(frozen=True)
class Made:
    """Where one artifact came from."""

    address: str
    role: str
    command: str
    config: dict[str, Any]
    sources: dict[str, str]
    """Input -> address, or name of the raw file."""
    versions: dict[str, str]
    made: str
    seconds: float | None
    fingerprint: str
    settings: dict[str, Any] = field(default_factory=dict)
    """Those that are not the stage's defaults."""


@dataclass(frozen=True)
class BandShown:
    """The band of one model's rollouts."""

    label: str
    scores: BandScores
    picture: str
    """Band and error over time: address of the picture inside the page."""


@dataclass(frozen=True)
class ReportFacts:
    """Everything that the sections of a report say."""

    title: str
    compared: list[Compared]
    diagnoses: list[tuple[str, Diagnosis]] = field(default_factory=list)
    """With the label of the model that each is of."""
    scores: list[tuple[str, Scores]] = field(default_factory=list)
    """Likewise."""
    bands: list[BandShown] = field(default_factory=list)
    """Of those whose rollouts have one."""
    held_out: list[str] = field(default_factory=list)
    """Test episodes that neither a model nor an effect was fitted to."""
    fitted: list[str] = field(default_factory=list)
    """Episodes that a model or an effect was fitted to."""
    provenance: list[Made] = field(default_factory=list)
    recordings: str = ""
    """Address of the recordings."""
    own: Made | None = None
    """How the report itself is made again."""
