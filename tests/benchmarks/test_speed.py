"""Measured speeds beside their goals."""

import json
from pathlib import Path

import pytest

from benchmarks.speed.__main__ import MODULES, RESULT, collect, main, merged
from benchmarks.speed.goals import GOALS, goals_table


def test_a_goal_that_is_missed_or_not_measured_says_so():
    lines = goals_table(
        {
            "i2n_step_10000_over_300": 1.7,
            "plop_help_s": 0.7,
            "ingest_128_images_per_s": 9.0,
            "engine_5k_2_threads_particle_steps_per_s": 4.2e6,
        }
    ).splitlines()
    shown = {line.split("|")[1].strip(): [cell.strip() for cell in line.split("|")[2:5]] for line in lines[2:]}
    assert shown["a whole step of the model, 10,000 particles over 300"] == ["1.7 times", "<= 1.6 times", "**no**"]
    assert shown["`plop --help`"] == ["0.7 s", "<= 0.7 s", "yes"]
    assert shown["ingest: images of 128x128 drawn"][2] == "**no**"
    engine = shown["engine, 5,000 particles, two threads, cut and contact included"]
    assert engine[0] == "4.2 million particle-steps a second" and engine[2] == "yes"
    assert shown["engine, a cut of 1 s, 5,000 particles"][0] == "not measured"


def test_every_goal_belongs_to_a_case():
    assert set(GOALS) <= set(collect([]))


def test_a_partial_run_leaves_the_other_figures_their_command_and_load():
    whole = merged({}, {"one": 1.0, "two": 2.0}, command="make bench", machine={"cores": 2}, load=0.1)
    part = merged(whole, {"two": 3.0}, command="python -m benchmarks.speed two", machine={"cores": 4}, load=5.0)
    assert (part["command"], part["machine"], part["cases"]) == ("make bench", {"cores": 2}, {"one": 1.0, "two": 3.0})
    assert part["measured"] == {
        "one": {"command": "make bench", "load_1min_before": 0.1},
        "two": {"command": "python -m benchmarks.speed two", "load_1min_before": 5.0, "cores": 4},
    }


def test_every_figure_of_the_file_says_how_it_was_measured():
    found = json.loads(Path(RESULT).read_text())
    assert set(found["measured"]) == set(found["cases"])


def test_words_choose_cases_and_a_wrong_word_is_an_error(tmp_path, monkeypatch, capsys):
    assert set(collect(["raster_128_5k"])) == {"raster_128_5k_fwd_bwd_ms", "raster_128_5k_speedup_over_torch"}
    assert set(collect(["ingest"])) < set(collect(list(MODULES))) == set(collect([]))
    monkeypatch.setattr("sys.argv", ["speed", "no-such-case", "--out", str(tmp_path / "bench.json")])
    with pytest.raises(SystemExit):
        main()
    assert "no case is called no-such-case" in capsys.readouterr().err and not list(tmp_path.iterdir())


def test_a_case_that_fails_leaves_the_others_their_figures(tmp_path, monkeypatch, capsys):
    def broken() -> float:
        raise ValueError("no such tool")

    monkeypatch.setattr("benchmarks.speed.__main__.collect", lambda words: {"a_ms": broken, "b_ms": lambda: 2.0})
    monkeypatch.setattr("sys.argv", ["speed", "--out", str(tmp_path / "bench.json")])
    assert main() == 1 and "a_ms: failed, ValueError: no such tool" in capsys.readouterr().err
    assert json.loads((tmp_path / "bench.json").read_text())["cases"] == {"b_ms": 2.0}
