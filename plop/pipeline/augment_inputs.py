"""Where the amplitude of an added effect comes from: the diagnosis of the recordings that it is fitted to."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from plop.artifacts.layouts import DiagnosisFiles
from plop.artifacts.lineage import parents
from plop.artifacts.store import Artifact
from plop.errors import PlopError
from plop.pipeline.preparation import MODELS, Preparation

FIT = "fit"
"""Not an input of the stage: recordings whose diagnosis by the model is one."""


def augment_inputs(
    preparation: Preparation, given: Mapping[str, str | Path], config: Any, environment: str | None
) -> dict[str, str | Path]:
    """Find the diagnosis of the model, of the recordings named with `--fit` where there are such, or make it.

    Args:
        preparation: Makes what is missing.
        given: What the user named: inputs of the stage, and "fit".
        config: Settings of `augment`: which effect is wanted, and whether its values are given.
        environment: Take a model of this environment where none is named.

    Raises:
        PlopError: Both `--fit` and `--diagnosis` are named, or what is named is not there.
    """
    found = {name: address for name, address in given.items() if name != FIT}
    if FIT in given and "diagnosis" in given:
        raise PlopError(
            "Both --fit and --diagnosis are named.",
            found=f"{given[FIT]}, {given['diagnosis']}",
            fix="Name the recordings to fit to, or the diagnosis that has done it.",
        )
    if config.remove or "diagnosis" in given or (config.value and FIT not in given):
        return found
    store = preparation.store
    model = store.find(str(given["model"])) if "model" in given else preparation.only(MODELS, environment, "model")
    found["model"] = model.address
    recordings = store.find(str(given[FIT])) if FIT in given else None
    wanted = {"model": model.key} | ({} if recordings is None else {"recordings": recordings.key})
    fitting = [
        a for a in store.artifacts("diagnose") if wanted.items() <= parents(a).items() and _has_fitted(a, config.effect)
    ]
    if fitting:
        found["diagnosis"] = fitting[-1].address
    elif recordings is not None and not preparation.may_run:
        preparation.would_run["diagnosis"] = "diagnose"
    elif recordings is not None:
        files = {"effect_file": given["effect_file"]} if "effect_file" in given else {}
        found["diagnosis"] = preparation.diagnosed(model, recordings, config.effect, files).address
    return found


def _has_fitted(diagnosis: Artifact, effect: str) -> bool:
    facts = json.loads(DiagnosisFiles(diagnosis.path).facts.read_text())
    fitted = {row.get("effect") for row in [*facts.get("ranking", []), facts.get("base", {})]}
    return not effect or effect in fitted
