"""The ablation pairs what differs in one thing only."""

from __future__ import annotations

import pytest

from benchmarks.ablation import METRICS, TARGETS, effects, training
from plop.pipeline.settings import resolve
from plop.pipeline.settings_file import flat_values
from stages.train.settings import TrainConfig


def row(targets: str, resampling: bool, cd_mm: float, seed: int = 0) -> dict:
    episodes = {"a": dict.fromkeys(METRICS, cd_mm), "b": dict.fromkeys(METRICS, cd_mm + 1)}
    return {"environment": "block", "seed": seed, "targets": targets, "resampling": resampling, "episodes": episodes}


def test_effects_are_paired_differences():
    rows = [
        row("tracks", False, 1.0),
        row("tracks", True, 1.5),
        row("both", False, 0.8),
        row("both", True, 9.0, seed=1),
    ]
    found = {(e["of"], e["targets"], e["resampling"]): e for e in effects(rows)}
    assert set(found) == {("resampling", "tracks", True), ("images", "both", False)}, "only pairs of one seed"
    assert found["resampling", "tracks", True]["cd_mm"]["mean"] == pytest.approx(0.5)
    assert found["images", "both", False]["cd_mm"]["mean"] == pytest.approx(-0.2)
    assert found["images", "both", False]["n"] == 2


@pytest.mark.parametrize("targets", TARGETS)
def test_variants_differ_in_targets_and_resampling_alone(targets):
    on, off = (
        resolve(TrainConfig, "train", ("ablation", dict(flat_values(training(targets, on, 100, 7, 3)))))
        for on in (True, False)
    )
    assert on.follows_tracks == (targets != "images") and bool(on.epochs) == (targets != "tracks")
    assert on.resampling.enabled and not off.resampling.enabled
    assert (on.network, on.frame, on.seed, on.cohesion) == (off.network, TrainConfig().frame, 3, False)
