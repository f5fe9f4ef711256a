"""The table of docs/results.md that sets networks and engines side by side."""

from __future__ import annotations

from benchmarks.made_up import METRICS, table


def scores(value: float) -> dict:
    return {"plop": {**{key: {"mean": value} for key in METRICS}, "end": {key: {"mean": 3 * value} for key in METRICS}}}


def test_every_environment_has_three_lines_and_the_mean_stands_below():
    both = {"a": scores(1.0), "b": scores(2.0)}
    lines = table({**both, "c": scores(9.0)}, both, {"a": scores(0.5), "b": scores(1.0)}).splitlines()
    assert len(lines) == 2 + 3 * 3 and not any("| c |" in line for line in lines), "only what all three have"
    assert lines[2] == "| a | without | 1.00, 3.00 | 1.00, 3.00 | 1.00, 3.00 | 1.0, 3.0 | 1.000, 3.000 |"
    assert lines[-1].startswith("| **mean** | the engine itself | 0.75, 2.25 |")


def test_one_environment_has_no_mean():
    one = {"a": scores(1.0)}
    assert len(table(one, one, one).splitlines()) == 2 + 3
