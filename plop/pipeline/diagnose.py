"""The verdict of a diagnosis, as an object instead of a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from plop.artifacts.store import Store
from plop.diagnosis.decision.result import Diagnosis
from plop.diagnosis.decision.verdict import Verdict
from plop.pipeline.run import run


def diagnose(store: Store | str | Path, /, **options: Any) -> Verdict:
    """Run `plop diagnose`, unless its artifact exists already, and return its verdict.

    Args:
        store: The workspace.
        options: See `plop.pipeline.run.run`: inputs (model, recordings, ...), settings, name.

    Raises:
        PlopError: See `plop.pipeline.run.run`.
    """
    return Diagnosis.load(run("diagnose", store, **options).path).verdict
