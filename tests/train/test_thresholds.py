"""Thresholds that are measured on the fitted Gaussians are exceeded by the stated share of them."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import torch

from plop.dynamics.interface import at_rest
from plop.dynamics.resampling import ResamplingConfig, resample
from stages.train.form import thresholds
from tests.dynamics.conftest import block_of


def test_a_share_of_the_fitted_gaussians_splits_and_merges_at_once():
    fitted = [SimpleNamespace(initial=block_of(500, seed)) for seed in (0, 1)]
    measured = thresholds(ResamplingConfig(split_share=0.04, merge_share=0.02), fitted)
    done = [
        resample(at_rest(one.initial), measured, generator=torch.Generator().manual_seed(0)).resampling
        for one in fitted
    ]
    assert sum(d.merges for d in done) == 20
    assert sum(d.splits for d in done) == pytest.approx(40, abs=2), "merging changes a few shapes before"


def test_thresholds_that_are_given_stay():
    given = ResamplingConfig(split_above=7.0, merge_below=0.3)
    assert thresholds(given, []) is given
