"""Progress for people: no remaining time before there is something to tell it from."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from plop_cli import console as module
from plop_cli.console import LINE_EVERY_S, Console

SLOW_S = 60.0


@pytest.fixture
def lines(monkeypatch, capsys):
    """Give what is written of reports, each (time [s], done, total), where there is no terminal."""

    def written(*reports: tuple[float, float, float]) -> list[str]:
        clock = iter([0.0, *(now for now, _, _ in reports)])
        monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: next(clock)))
        with Console().progress("diagnose") as progress:
            for _, done, total in reports:
                progress(done, total)
        return capsys.readouterr().err.splitlines()

    return written


def test_the_first_piece_which_is_unlike_the_others_tells_no_remaining_time(lines):
    assert lines((SLOW_S, 1, 300)) == ["diagnose  0 %"]
    assert lines((SLOW_S, 1, 300), (SLOW_S + LINE_EVERY_S, 31, 300))[-1] == "diagnose  10 %, 2 min 14 s left"


def test_one_slow_piece_more_tells_it_after_five_seconds(lines):
    assert lines((1.0, 1, 4), (4.0, 2, 4), (SLOW_S, 2, 4))[-1] == "diagnose  50 %, 1 min 58 s left"


def test_what_comes_before_the_first_piece_and_a_small_part_of_it_tell_nothing(lines):
    """Looking for an amplitude is no part of the episodes, and an episode is simulated before it is rendered."""
    searched = [(float(now), 0.0, 6.0) for now in range(0, 100, 10)]
    assert lines(*searched, (120.0, 0.02, 6))[-1] == "diagnose  0 %"
    assert lines(*searched, (120.0, 1.0, 6))[-1] == "diagnose  17 %, 2 min 30 s left"


def test_another_batch_is_measured_by_itself(lines):
    first = [(float(k), float(k), 60.0) for k in range(1, 61)]
    told = lines(*first, (61.0, 1, 300), (76.0, 2, 300), (91.0, 16, 300))
    assert told[-1] == "diagnose  5 %, 9 min 28 s left"
    assert lines(*first, (90.0, 1, 300))[-1] == "diagnose  0 %"


def test_what_was_there_already_is_not_taken_for_pace(lines):
    """A diagnosis that goes on remembers most runs: they took no time."""
    assert lines((1.0, 201, 300), (16.0, 204, 300))[-1] == "diagnose  68 %, 8 min 00 s left"
