"""Where everything came from, and the commands that make it again."""

from __future__ import annotations

import json
import shlex

from plop.artifacts.lineage import LEFT_OUT
from plop.reporting.compared import Made, ReportFacts
from plop.reporting.html import table, text


def provenance_section(facts: ReportFacts) -> str:
    """List artifacts, versions, seeds and settings, and the commands to repeat the report."""
    rows = []
    for made in facts.provenance:
        seed = made.config.get("seed")
        sources = ", ".join(f"{text(name)}: {text(source)}" for name, source in made.sources.items())
        rows.append(
            [
                text(made.address),
                text(made.role),
                sources or "–",
                "–" if seed is None else text(seed),
                text(made.made),
                text(made.versions.get("plop", "–")),
            ]
        )
    versions = sorted({f"{name} {v}" for made in facts.provenance for name, v in made.versions.items()})
    settings = "".join(
        f"<details><summary><code>{text(made.address)}</code>: settings</summary>"
        f"<pre>fingerprint {text(made.fingerprint)}\n{text(json.dumps(made.config, indent=1, sort_keys=True))}</pre>"
        "</details>"
        for made in facts.provenance
    )
    commands = "\n".join(_command(made) for made in [*facts.provenance, *([facts.own] if facts.own else [])])
    return (
        "<h2>To repeat it</h2><p class='soft'>In the workspace that holds these artifacts; addresses name "
        "contents, so the same command gives the same result. Settings are those that differ from the defaults."
        f"</p><pre>{text(commands)}</pre><h2>Provenance</h2>"
        + table(["artifact", "what", "made from", "seed", "made", "plop"], rows, cards=True)
        + f"<p class='soft'>{text(', '.join(versions))}</p>{settings}"
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
