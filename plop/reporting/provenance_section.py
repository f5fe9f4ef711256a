"""Where everything came from, and the commands that make it again."""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass

from plop.artifacts.lineage import LEFT_OUT
from plop.reporting.compared import Made, ReportFacts


@dataclass(frozen=True)
class ProvenanceSection:
    """Artifacts with their versions, seeds and settings, and how to repeat the report."""

    made: list[Made]
    commands: list[str]
    versions: list[str]


def provenance_section(facts: ReportFacts) -> ProvenanceSection:
    """List the artifacts, and the commands to repeat the report."""
    return ProvenanceSection(
        facts.provenance,
        [_command(made) for made in [*facts.provenance, *([facts.own] if facts.own else [])]],
        sorted({f"{name} {v}" for made in facts.provenance for name, v in made.versions.items()}),
    )


def _command(made: Made) -> str:
    parts = []
    for name, source in made.sources.items():
        raw = "@" not in source and source != LEFT_OUT
        parts.append(source if raw else f"--{name.partition('.')[0].replace('_', '-')} {source}")
    parts += [f"--set {shlex.quote(f'{key}={_toml(value)}')}" for key, value in made.settings.items()]
    return " ".join(["plop", made.command, *parts]) + f"    # {made.address}"


def _toml(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value)
