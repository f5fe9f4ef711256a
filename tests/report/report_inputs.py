"""Inputs of a report made small: two models of a cut box, a diagnosis, and the text of a page."""

from __future__ import annotations

import json
import re
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plop.artifacts.manifest import Manifest
from plop.diagnosis.decision.limits import Limit
from plop.diagnosis.decision.result import Ranked
from plop.diagnosis.decision.verdict import Reason
from plop.parameters import Estimate
from plop.pipeline.stage import Input, Output
from stages.compare import stage as compare_stage
from stages.compare.stage import CompareConfig
from tests.support.compare_scene import make_inputs
from tests.support.diagnoses import diagnosis, ranked, verdict

NASTY = "<script>alert(1)</script>"


def parameter(value: float, unit: str) -> Estimate:
    return Estimate(value, 0.9 * value, 1.1 * value, unit)


def law(effect: str, gain: float, p: float, *reasons: Reason, **changes: Any) -> Ranked:
    parameters = {f"{effect}_pa_s": parameter(40.0, "Pa s")}
    return ranked(effect, parameters, help=NASTY, gain=gain, p=p, reasons=reasons, **changes)


DIAGNOSIS = diagnosis(
    verdict("EFFECT", "viscosity", text="Missing: viscosity."),
    law("viscosity", 0.7, 0.005),
    law("tilt", 0.01, 0.4, Reason.CHANCE, Reason.ONE_EPISODE),
    law("stiffness", 0.0, 0.9, Reason.CHANCE, kind="base"),
    limits={"adhesion": Limit(12.0, "Pa", "traction_pa", 2e-4)},
)


def with_manifest(path: Path, stage: str, mark: str, **sources: str) -> Input:
    made_from = {name: {"stage": "x", "fingerprint": source} for name, source in sources.items()}
    told = {"command": stage, "made": "2026-01-01", "versions": {"plop": "1"}}
    return Input(path, Manifest(stage, mark, 1, {"seed": 3}, made_from, provenance=told))


def report_inputs(folder: Path) -> dict[str, Input]:
    """Make everything that a report of two models takes."""
    measured = make_inputs(folder)
    found = {
        "recordings": with_manifest(measured["recordings"].path, "simulate", "rec"),
        "init": with_manifest(measured["init"].path, "fit-init", "ini", recordings="rec"),
    }
    with pytest.MonkeyPatch.context() as patch:
        for k, share in enumerate((1.0, 0.2)):

            def predict(model, recording, splat, episode, share=share):
                low = 0.004 * share * np.linspace(0, 1, len(episode.times))[:, None] * (episode.points[0, :, 0] > 0)
                return episode.points - np.stack([0 * low, 0 * low, low], -1)

            patch.setattr(compare_stage, "predict_episode", predict)
            out = folder / f"compare_{k}"
            out.mkdir()
            compare_stage.run(measured, CompareConfig(jobs=1, frames=1, pictures=False), Output(out))
            found[f"comparisons.{k}"] = with_manifest(out, "compare", f"cmp{k}", recordings="rec", model=f"model{k}")
            (folder / f"model_{k}").mkdir()
            effects = [{"effect": "viscosity", "parameters": {"viscosity_pa_s": parameter(40.0, "Pa s").to_json()}}] * k
            (folder / f"model_{k}" / "model.json").write_text(json.dumps({"kind": "augmented", "effects": effects}))
            found[f"models.{k}"] = with_manifest(folder / f"model_{k}", "augment", f"model{k}", diagnosis="diag")
    DIAGNOSIS.write(folder)
    found["diagnoses.0"] = with_manifest(folder, "diagnose", "diag", model="model0")
    return found


def visible(page: Path) -> str:
    """Text of the page without scripts, styles and tags."""
    body = re.sub(r"<(script|style).*?</\1>", " ", page.read_text(), flags=re.S)
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", body)))
