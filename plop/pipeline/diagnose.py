"""The verdict of a diagnosis, as an object instead of a file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from plop.artifacts.layouts import DiagnosisFiles
from plop.artifacts.store import Store
from plop.diagnosis.verdict import Verdict
from plop.pipeline.run import run


def diagnose(store: Store | str | Path, /, **options: Any) -> Verdict:
    """Run `plop diagnose`, unless its artifact is there already, and give its verdict.

    Args:
        store: The workspace.
        options: See `plop.pipeline.run.run`: inputs (model, recordings, ...), settings, name.

    Raises:
        PlopError: See `plop.pipeline.run.run`.
    """
    facts = json.loads(DiagnosisFiles(run("diagnose", store, **options).path).facts.read_text())
    return Verdict(**facts["verdict"])
