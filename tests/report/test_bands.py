"""The band in the report: its scores, its factor and its picture; nothing of it where rollouts have none."""

from __future__ import annotations

import re

import numpy as np

from plop.pipeline.stage import Input
from plop.reporting.compared import ReportFacts
from plop.reporting.page_file import render
from plop.uncertainty.band import calibrated
from plop.uncertainty.scores import score_bands
from stages.eval.plot import plot_bands
from stages.report.stage import _bands
from tests.uncertainty.test_bands import episode


def test_the_report_shows_coverage_factor_and_picture(tmp_path):
    random = np.random.default_rng(0)
    band = calibrated([episode(f"v{k}", random, 0.001) for k in range(12)], models=3)
    errors = [episode(f"t{k}", random, 0.001) for k in range(14)]
    scores = score_bands(errors, band, {})
    scores.write(tmp_path)
    plot_bands(tmp_path / "bands.png", errors, scores)
    (tmp_path / "none").mkdir()
    shown = _bands([Input(tmp_path), Input(tmp_path / "none")], ["mine", "other"])
    assert [each.label for each in shown] == ["mine"]
    page = render("bands.html", facts=ReportFacts("t", [], bands=shown))
    assert 'src="data:image/png;base64,iVBOR' in page
    text = " ".join(re.sub(r"<[^>]+>", " ", page).split())
    widened = scores.methods["widened"]
    assert f"{100 * widened['coverage'].mean:.0f} %" in text and f"{widened['crps_mm'].mean:.2f}" in text
    assert f"times {band.factor:.2f}" in text and "12 validation episodes." in text and "14 test episodes" in text
    assert render("bands.html", facts=ReportFacts("t", [])) == "", "other pages stay as they are"
