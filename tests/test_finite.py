"""What is no number is neither kept nor printed: one guard for the summary of every stage."""

from __future__ import annotations

import json
from math import inf, nan

import numpy as np
import pytest

from plop.finite import json_ready, readable
from plop.parameters import Estimate, estimate_text, short_number
from plop.pipeline.stage import Summary
from plop_cli.console import format_figure


@pytest.mark.parametrize("value", [nan, inf, -inf, np.float32(nan), np.float64(-inf)])
def test_no_summary_keeps_or_prints_what_is_no_number(value):
    said = f"the views disagreed by 11.1 mm: {value} -> {value:.2f} mm, ({value}), {value:+.1f} mm"
    row = {"a": value, "b": [value, 1.0], "c": f"{value:.3g} s"}
    summary = Summary({"error_mm": value, "n": 3, "none": None}, [row], [said])
    assert summary.figures == {"error_mm": None, "n": 3, "none": None}
    assert summary.table == [{"a": None, "b": [None, 1.0], "c": "unknown s"}]
    assert summary.warnings[0] == ("the views disagreed by 11.1 mm: unknown -> unknown mm, (unknown), unknown mm")
    assert summary.warnings[1:] == ["error_mm: unknown, the result was not a finite number"]
    json.dumps([summary.figures, summary.table], allow_nan=False)


@pytest.mark.parametrize(
    "text",
    [
        "banana: 3 mm",
        "nan.h5 is skipped",
        "raw/nan/e1 holds nothing",
        "rollout@inf0",
        "info: fine",
        "camera nan-2",
        "NaN",
    ],
)
def test_names_that_look_like_none_stay(text):
    assert readable(text) == text


def test_numbers_of_numpy_become_pythons():
    ready = json_ready({"a": np.float32(0.5), "b": np.int64(2), "c": (np.bool_(True), None, True), 3: "x"})
    assert ready == {"a": 0.5, "b": 2, "c": [True, None, True], "3": "x"}
    assert [type(v) for v in (ready["a"], ready["b"], ready["c"][0])] == [float, int, bool]


def test_numbers_for_people():
    assert format_figure(nan) == format_figure(-inf) == short_number(nan) == short_number(None) == "unknown"
    assert estimate_text("k", Estimate(2.0, high=3.0, unit="Pa")) == "k = 2 Pa"
