"""False alarms are as rare as stated; what the limit promises is found, what lies far below is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.diagnosis.conclusion import conclusion
from plop.diagnosis.findings import finding_of
from plop.diagnosis.limits import detection_limits
from plop.diagnosis.screen import one_per_effect
from plop.diagnosis.shams import SIGNS_LEAST, p_value, sham_gains
from tests.support.synthetic_evidence import candidate, episodes, key, state


def best_p(seed: int, shams: int = 49, *, alone: bool = True, **misfit_m: float) -> float:
    now = state(episodes(seed, count=7, **misfit_m))
    return p_value(now.scores()[0].gain, sham_gains(now.screen, seed=seed, count=shams, alone=alone))


@pytest.mark.parametrize("misfit_m", [{"misfit_m": 3e-4}, {"rough_m": 3e-4}])
def test_p_is_rarely_small_where_nothing_is_hidden(misfit_m):
    """Without a reference, also where the base errs smoothly over the whole object."""
    values = np.array([best_p(seed, **misfit_m) for seed in range(60)])
    assert (values <= 0.02).mean() <= 0.1
    assert (values <= 0.2).mean() <= 0.4
    assert values.mean() > 0.35


def test_a_smooth_misfit_looks_like_evidence_to_shams_that_change_signs_in_parts():
    """Why there are others where no reference tells."""
    values = np.array([best_p(seed, misfit_m=3e-4, alone=False) for seed in range(60)])
    assert (values <= 0.02).mean() > 0.1


def test_a_hidden_law_beats_every_sham():
    now = state(episodes(1, {"tilt": 0.3}))
    for alone in (False, True):
        shams = sham_gains(now.screen, count=99, alone=alone)
        assert p_value(now.scores()[0].gain, shams) == pytest.approx(0.01)


def test_a_law_along_one_axis_is_not_lost_to_the_signs_of_whole_episodes():
    """Of few episodes they are often all as they were; then parts of the object alone are turned."""
    for count in (4, SIGNS_LEAST):
        straight = [
            replace(
                e,
                residual=0.5 * e.responses[key("tilt")] * [1, 0, 0] + e.residual * [0.1, 0.1, 0.1],
                responses={**e.responses, key("tilt"): e.responses[key("tilt")] * [1, 0, 0]},
            )
            for e in episodes(1, count=count)
        ]
        now = state(straight)
        assert now.scores()[0].candidate.effect == "tilt"
        assert p_value(now.scores()[0].gain, sham_gains(now.screen, alone=True)) <= 0.02


def test_shams_are_drawn_from_the_seed_and_leave_the_evidence_alone():
    now = state(episodes(2, {"tilt": 0.3}))
    before = [e.residual.copy() for e in now.screen.episodes]
    one, two, other = (sham_gains(now.screen, seed=seed, count=20) for seed in (5, 5, 6))
    np.testing.assert_array_equal(one, two)
    assert (one != other).any()
    for old, episode in zip(before, now.screen.episodes, strict=True):
        np.testing.assert_array_equal(old, episode.residual)


def test_p_counts_the_shams_that_do_as_well():
    shams = np.array([0.1, 0.2, 0.3, 0.4])
    assert p_value(0.25, shams) == pytest.approx(3 / 5)
    assert p_value(0.5, shams) == pytest.approx(1 / 5)


def limits_of(now, shams):
    return detection_limits(now.screen, one_per_effect(now.scores()), shams, now.response_rms_m, {})


def test_what_is_hidden_at_its_limit_is_mostly_named_and_at_half_of_it_hardly():
    """In other takes of the same motions: nine in ten are promised."""
    named: dict[float, list[bool]] = {1.0: [], 0.5: []}
    for seed in range(6):
        misfit = {"misfit_m": 2e-4} if seed % 2 else {"rough_m": 3e-4}
        reference = episodes(seed + 1000, count=8, **misfit)
        limits = conclusion(state(episodes(seed, count=8, **misfit), reference), (), 99, seed).limits
        for law in ("tilt", "viscosity", "swelling"):
            for factor, found in named.items():
                hidden = {law: factor * limits[law]["amplitude"]}
                again = state(episodes(seed, hidden, count=8, take=1, **misfit), reference)
                found.append(law in conclusion(again, (), 99, seed).verdict.named)
    assert np.mean(named[1.0]) > 0.7 and np.mean(named[0.5]) < 0.2


@pytest.mark.parametrize("law", ["tilt", "viscosity"])
def test_what_is_injected_at_twice_its_limit_is_found_and_at_a_third_not(law):
    quiet = episodes(3, rough_m=3e-4)
    now = state(quiet)
    shams = sham_gains(now.screen, count=99)
    limit = limits_of(now, shams)[law]
    assert limit["unit"] == "-" and limit["parameter"] == "a"
    assert limit["displacement_m"] == pytest.approx(limit["amplitude"] * now.response_rms_m(key(law)))
    for factor, seen in ((2.0, True), (0.3, False)):
        amplitude = factor * limit["amplitude"]
        loud = [replace(e, residual=e.residual + amplitude * e.responses[key(law)]) for e in quiet]
        then = state(loud)
        finding = finding_of(then, then.scores()[0], sham_gains(then.screen, count=99))
        assert (finding.name == law and finding.passes()) == seen


def test_less_noise_lowers_the_limit():
    found = []
    for noise_m in (4e-4, 1e-4):
        now = state(episodes(4, noise_m=noise_m))
        found.append(limits_of(now, sham_gains(now.screen, count=49))["tilt"]["amplitude"])
    assert found[1] < 0.5 * found[0]


def test_what_cannot_be_seen_at_any_amplitude_has_no_limit():
    """In one episode only: what is fitted to the others says nothing about it."""
    data = episodes(5)
    lonely = [
        e if k == 0 else replace(e, responses={**e.responses, key("tilt"): 1e-9 * e.residual})
        for k, e in enumerate(data)
    ]
    now = state(lonely)
    assert limits_of(now, sham_gains(now.screen, count=49))["tilt"]["amplitude"] is None


def test_the_limit_of_a_law_with_two_amplitudes_is_that_of_the_one_seen_best():
    """The other one does what the base's own parameter can do, but for little."""
    both = tuple(replace(candidate("tilt").columns[0], amplitude=name) for name in "ab")
    laws = [candidate("stiffness"), replace(candidate("tilt"), columns=both)]
    for seen in both:
        data = []
        for e in episodes(6, noise_m=1e-4):
            other = e.responses[key("stiffness")] + 0.3 * e.responses[key("drag")]
            own = {c.key: e.responses[key("tilt")] if c is seen else other for c in both}
            data.append(replace(e, responses={**e.responses, **own}))
        now = state(data, candidates=laws)
        limit = limits_of(now, sham_gains(now.screen, count=49))["tilt"]
        assert limit["parameter"] == seen.amplitude and limit["amplitude"] is not None
