"""What a report is made from: the comparisons of several models with the same recordings, and what was diagnosed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Compared:
    """One model as it was compared."""

    label: str
    colour: str
    facts: dict[str, Any]
    """Content of compare.json."""
    model: dict[str, Any] | None = None
    """Content of model.json, where it is known."""

    def row(self, table: str, **wanted: str) -> dict[str, Any] | None:
        """Find a row of a table; None when there is none."""
        rows: list[dict[str, Any]] = self.facts["tables"].get(table, [])
        return next((r for r in rows if all(r.get(k) == v for k, v in wanted.items())), None)


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
class ReportFacts:
    """Everything that the sections of a report say."""

    title: str
    compared: list[Compared]
    diagnoses: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    """(label, content of diagnosis.json); its "sensors" are None where they were not looked for."""
    scores: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    """(label, content of scores.json)."""
    held_out: list[str] = field(default_factory=list)
    """Test episodes that neither a model nor an effect was fitted to."""
    fitted: list[str] = field(default_factory=list)
    """Episodes that a model or an effect was fitted to."""
    provenance: list[Made] = field(default_factory=list)
    recordings: str = ""
    """Address of the recordings."""
    own: Made | None = None
    """How the report itself is made again."""
