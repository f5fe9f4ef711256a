"""The deals of the benchmark of bands, on episodes whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.bands import TRAIN, dealt_again
from plop.pipeline.settings import resolve
from plop.pipeline.settings_file import flat_values
from stages.train.settings import TrainConfig
from tests.uncertainty.test_bands import episode


def test_deals_calibrate_and_score_what_is_held_out():
    random = np.random.default_rng(0)
    made = [episode(f"e{k}", random, 0.001) for k in range(24)]
    few, enough = (dealt_again(made, count, deals=20) for count in (4, 12))
    assert (few["guaranteed"], enough["guaranteed"]) == (False, True)
    assert few["coverage"]["mean"] == pytest.approx(0.9, abs=0.02)
    assert enough["coverage"]["mean"] == pytest.approx(0.9 * 13 / 12, abs=0.02), "episodes are alike"
    assert enough["coverage"]["low"] <= enough["coverage"]["mean"] <= enough["coverage"]["high"]


def test_validation_episodes_select_nothing():
    config = resolve(TrainConfig, "train", ("bands", dict(flat_values(TRAIN))))
    assert config.validate_every >= config.steps and config.validation > 0
