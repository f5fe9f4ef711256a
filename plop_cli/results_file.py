"""Write the figures of `plop reproduce`: docs/results/disect.json, and a picture of each environment beside it.

Results of another profile than `cpu` go into files with its name. The documentation makes its tables from them
(docs/hooks). Part recordings (the halves are pushed apart) are the test; "plain" holds plain cuts, in which hardly
anything moves, and "all" both kinds together.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from plop.artifacts.atomic_file import write_text
from plop.metrics.table import ScoreFiles, collect

MAIN = "cpu"
"""The profile whose results have no profile in their name."""
MADE = ("date", "commit", "machine")
"""Provenance of a file: when and where its results were first written."""


def is_part(episode: str) -> bool:
    """Return whether a recording is one in which the halves are pushed apart."""
    return "_part_" in episode


def gathered(scores: ScoreFiles, *, command: str, versions: Mapping[str, str], seeds: Sequence[int]) -> dict[str, Any]:
    """Collect the scores: of the part recordings, and under "plain" and "all" those of plain cuts and of both kinds.

    Args:
        scores: Per environment the scores.json of every seed.
        command: Command that made them.
        versions: Versions of the software.
        seeds: Seeds of the training runs.
    """
    found = collect(scores, chosen=is_part, command=command, versions=versions, seeds=seeds)
    others = {"plain": collect(scores, chosen=lambda name: not is_part(name)), "all": collect(scores)}
    parts = {name: {key: other[key] for key in ("environments", "mean")} for name, other in others.items()}
    return _made() | found | parts


def _made() -> dict[str, Any]:
    """Return date, commit and machine."""
    asked = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"]
    try:
        commit = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        commit = ""
    machine = {"processor": platform.processor() or platform.machine(), "cores": len(os.sched_getaffinity(0))}
    return {"date": f"{datetime.now(UTC):%Y-%m-%d}", "commit": commit, "machine": machine}


def write_results(folder: Path, results: Mapping[str, Any], pictures: Mapping[str, Path], profile: str) -> list[Path]:
    """Write all results; a file with the same results keeps its date, commit and machine.

    Args:
        folder: Documentation or workspace; files are written to its results/.
        results: From `gathered`.
        pictures: Per environment the picture of one test episode.
        profile: Name of the profile that made them.

    Returns:
        The files that were written.
    """
    written = [_file(folder, profile)]
    there = _read(written[0])
    made = {key: there[key] for key in MADE if key in there} if _figures(there) == _figures(results) else {}
    write_text(written[0], json.dumps({**results, **made}, indent=1) + "\n")
    for name, source in pictures.items():
        target = folder / "results" / ("pictures" if profile == MAIN else f"pictures-{profile}") / f"{name}.png"
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)
        written.append(target)
    return written


def missing_in(results: Mapping[str, Any], folder: Path, profile: str) -> list[str]:
    """List the environments of existing results that are missing in the new ones."""
    return sorted(_read(_file(folder, profile)).get("environments", {}).keys() - results["environments"].keys())


def _read(path: Path) -> dict[str, Any]:
    """Return existing results; empty where none can be read."""
    try:
        there = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return there if isinstance(there, dict) else {}


def _figures(results: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in results.items() if key not in MADE}


def _file(folder: Path, profile: str) -> Path:
    return folder / "results" / ("disect.json" if profile == MAIN else f"disect-{profile}.json")
