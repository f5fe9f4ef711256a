"""What a description says of residuals that are made to show one thing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.diagnosis.evidence.description import describe, description_text
from plop.diagnosis.evidence.evidence import PATH_STEPS, Evidence

FRAMES, PATCHES, COUNT = 12, 20, 4


def evidence(k: int) -> Evidence:
    """A tool that goes one object's size along the table, in a direction of its own in each episode."""
    draw = np.random.default_rng(k)
    way = np.array([np.cos(k), np.sin(k), 0.0]) * np.linspace(0, 1, PATH_STEPS)[:, None]
    return Evidence(
        f"e{k}",
        0.06,
        np.arange(1, FRAMES + 1),
        np.zeros((FRAMES, PATCHES, 3)),
        np.zeros((FRAMES, PATCHES, 3)),
        np.full(PATCHES, 1e-4),
        np.zeros((FRAMES, PATCHES)),
        np.ones((FRAMES, PATCHES), bool),
        draw.uniform(-0.5, 0.5, (PATCHES, 3)),
        draw.uniform(-1, 1, (FRAMES, PATCHES, 3)),
        np.linspace(1 / FRAMES, 1, FRAMES),
        np.repeat(way[:, None], 8, 1),
        1.0,
    )


@pytest.fixture(scope="module")
def episodes() -> list[Evidence]:
    return [evidence(k) for k in range(2 * COUNT)]


KINDS, HERE = ["press", "push"] * COUNT, np.arange(2 * COUNT) < COUNT


def direction(k: int) -> np.ndarray:
    return np.array([np.cos(k), np.sin(k), 0.0])


def test_less_of_the_tools_way_late_and_in_pushes_only(episodes):
    left = [np.zeros((FRAMES, PATCHES, 3)) for _ in episodes]
    for k in (1, 3):
        left[k][2 * FRAMES // 3 :] = -1e-3 * direction(k)
    found = describe(left, episodes, KINDS, HERE)
    assert found.motions[0].what == "push" and found.motions[1].here_mm == 0
    assert found.along_mm == pytest.approx(-0.5 / 3, rel=0.15) and found.up_mm == 0
    text = description_text(found)
    assert "less far along the tool's way" in text


def test_one_side_in_all_motions_is_not_along_their_ways(episodes):
    left = [h * np.broadcast_to([1e-3, 0, 5e-4], (FRAMES, PATCHES, 3)) for h in HERE]
    found = describe(left, episodes, KINDS, HERE)
    ways = np.mean([np.cos(k) for k in range(COUNT)])
    assert found.fixed_mm == pytest.approx(1.0) and found.up_mm == pytest.approx(0.5)
    assert found.along_mm == pytest.approx(ways, abs=1e-6)
    assert found.times[0].excess == pytest.approx(found.times[2].excess)
    assert "third" not in description_text(found) and "higher" in description_text(found)


def test_place_is_told_where_it_stands_out(episodes):
    upper = [e.place[:, 2] > np.median(e.place[:, 2]) for e in episodes]
    left = [h * 1e-3 * np.ones((FRAMES, PATCHES, 3)) * u[:, None] for h, u in zip(HERE, upper, strict=True)]
    found = describe(left, episodes, KINDS, HERE)
    assert found.upper.here_mm == pytest.approx(3**0.5) and found.lower.here_mm == 0
    assert "in the upper half" in description_text(found)


def test_what_the_reference_shows_too_is_nothing(episodes):
    left = [1e-3 * np.ones((FRAMES, PATCHES, 3)) for _ in episodes]
    found = describe(left, episodes, KINDS, HERE)
    assert not any(s.excess for s in (*found.motions, *found.times, found.upper, found.lower))
    assert " It shows" not in description_text(found)


def test_one_kind_and_hidden_patches_make_no_trouble(episodes):
    blind = [replace(e, seen=np.zeros_like(e.seen)) for e in episodes[:1]] + episodes[1:]
    left = [np.zeros((FRAMES, PATCHES, 3)) for _ in episodes]
    left[1][:] = 1e-3
    found = describe(left, blind, ["push"] * 2 * COUNT, HERE)
    assert np.isfinite(found.up_mm) and found.along_mm is not None and np.isfinite(found.along_mm)
