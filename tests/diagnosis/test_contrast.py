"""The contrast with the reference: calibrated when nothing has changed, and not blinded by kinds of motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.diagnosis.contrast import P_LARGEST, contrast_of
from plop.physics.scenes.scene import simulate_episode
from plop.tracking.episode import episode_from_sequence
from plop.tracking.phases import motion_kind
from tests.support.coarse_episodes import SCENE
from tests.support.drawn_contrasts import HELD, KINDS, SCATTERS, contrast_chances, drawn_grams

TOLD, ALL_ONE, ALL_LONE = KINDS["four kinds"], (["a"] * 6, ["a"] * 5), (list("abcdefgh"), list("abcdefghijkl"))
MILD = HELD["0.3 to 3 times"]
RUNS = 200


@pytest.mark.parametrize("own", [1, 2])
@pytest.mark.parametrize("kinds", [TOLD, ALL_ONE, ALL_LONE])
def test_nothing_changed_is_rarely_called_a_change(own, kinds):
    p = contrast_chances(kinds, MILD, SCATTERS[0], own, RUNS, apart=3.0)
    assert (p < 0.05).mean() < 0.1 and (p < 0.005).mean() < 0.025
    assert p.min() > 0  # not even for kinds that come once


@pytest.mark.parametrize("own", [1, 2])
@pytest.mark.parametrize(
    ("held", "kinds", "apart"),
    [
        ("nearly all in two episodes", "one kind", 0.0),
        ("nearly all in two episodes", "four kinds", 1.0),
        ("nearly all in every fourth", "one kind", 0.0),
        ("nearly all in every fourth", "four kinds", 1.0),
        ("spread widely", "four kinds", 1.0),
    ],
)
def test_few_episodes_that_tell_of_a_law_are_counted_as_few(own, held, kinds, apart):
    """Counted as if all told alike, one in ten to one in two of these were called changed."""
    p = contrast_chances(KINDS[kinds], HELD[held], SCATTERS[0], own, RUNS, apart=apart)
    assert (p <= P_LARGEST).mean() <= 0.045


@pytest.mark.parametrize(
    ("held", "kinds"), [("nearly all in two episodes", "one kind"), ("nearly all in every fourth", "four kinds")]
)
def test_a_change_that_two_episodes_tell_is_seen(held, kinds):
    """By their own residuals alone, which hardly tell how much such episodes scatter, half of these were missed."""
    p = contrast_chances(KINDS[kinds], HELD[held], SCATTERS[0], 1, RUNS, apart=float(kinds != "one kind"), change=3.0)
    assert (p <= P_LARGEST).mean() > 0.8


@pytest.mark.parametrize("own", [1, 2])
@pytest.mark.parametrize("kinds", ["one kind", "four kinds"])
def test_amplitudes_that_scatter_between_both_extremes_are_rarely_called_changed(own, kinds):
    p = contrast_chances(KINDS[kinds], HELD["nearly all in every fourth"], SCATTERS[1], own, RUNS, apart=1.0)
    assert (p <= P_LARGEST).mean() <= 0.06


@pytest.mark.parametrize("own", [1, 2])
def test_a_change_is_seen_behind_what_kinds_differ_by(own):
    within, pooled = (
        contrast_chances(TOLD, MILD, SCATTERS[0], own, RUNS, apart=3.0, change=2.0, told=told) for told in (True, False)
    )
    assert (within <= P_LARGEST).mean() > 0.9 and (pooled <= P_LARGEST).mean() < 0.5


def test_the_family_multiplies_p():
    generator = np.random.default_rng(0)
    here, reference = (
        drawn_grams(generator, np.ones(len(labels)), [np.full(1, amplitude)] * len(labels))
        for labels, amplitude in zip(TOLD, (1.0, 0.0), strict=True)
    )
    alone, among = (contrast_of(here, reference, np.arange(2), 1, family, TOLD) for family in (1, 5))
    assert among.p == pytest.approx(min(1.0, 5 * alone.p)) and (among.least > alone.least).all()
    assert among.errors == pytest.approx(alone.errors)


def test_the_kind_of_a_motion_is_what_the_tool_does():
    scene = replace(SCENE, motions=("push", "hold", "cut-push", "cycles"))
    kinds = [motion_kind(episode_from_sequence(simulate_episode(scene, k), noise_m=2e-4, seed=k)) for k in range(8)]
    assert kinds[0].startswith("push") and kinds[1].startswith("press") and kinds[2].startswith("cut")
    assert kinds[3].split().count("press") == 2
    assert kinds[4:] == kinds[:4]
