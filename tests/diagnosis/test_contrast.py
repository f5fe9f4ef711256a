"""The contrast with the reference: calibrated when nothing has changed, and not blinded by kinds of motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plop.diagnosis.contrast import P_LARGEST, contrast_of
from plop.diagnosis.episode import episode_from_sequence
from plop.diagnosis.phases import motion_kind
from plop.diagnosis.regression import Grams
from plop.physics.scene import simulate_episode
from tests.coarse_episodes import SCENE

KINDS = list("abcd") * 2, list("abcd") * 3
RUNS = 300


def grams(
    generator: np.random.Generator, kinds: list[str], by_kind: dict[str, np.ndarray], own: int, change: float = 0.0
) -> Grams:
    """Episodes of other sensitivities, whose own amplitude depends on the kind and scatters; one base column."""
    hessians, gradients = [], []
    for kind in kinds:
        columns = generator.normal(size=(1 + own, 6))
        hessian = columns @ columns.T * generator.uniform(0.3, 3)
        scatter = np.linalg.solve(np.linalg.cholesky(hessian[1:, 1:]).T, generator.normal(size=own))
        amplitude = by_kind[kind] + change + scatter
        hessians.append(hessian)
        gradients.append(hessian @ np.concatenate([[0.3 * generator.normal()], amplitude]))
    return Grams(np.array(hessians), np.array(gradients), np.ones(len(kinds)))


def chances(own: int, kinds: tuple[list[str], list[str]], change: float = 0.0, *, told: bool = True) -> np.ndarray:
    """p in many pairs of sets; the base alone resembles an amplitude of another size in each kind of motion.

    Where kinds are not told, all episodes are taken for one.
    """
    names = kinds if told else (["any"] * len(kinds[0]), ["any"] * len(kinds[1]))
    generator = np.random.default_rng(own)
    found = []
    for _ in range(RUNS):
        by_kind = {kind: 3 * generator.normal(size=own) for kind in sorted({*kinds[0], *kinds[1]})}
        here, reference = grams(generator, kinds[0], by_kind, own, change), grams(generator, kinds[1], by_kind, own)
        found.append(contrast_of(here, reference, np.arange(1 + own), own, 1, names).p)
    return np.array(found)


@pytest.mark.parametrize("own", [1, 2])
@pytest.mark.parametrize("kinds", [KINDS, (["a"] * 6, ["a"] * 5), (list("abcdefgh"), list("abcdefghijkl"))])
def test_nothing_changed_is_rarely_called_a_change(own, kinds):
    p = chances(own, kinds)
    assert (p < 0.05).mean() < 0.1 and (p < 0.005).mean() < 0.025
    assert p.min() > 0  # not even for kinds that come once


@pytest.mark.parametrize("own", [1, 2])
def test_a_change_is_seen_behind_what_kinds_differ_by(own):
    within = (chances(own, KINDS, change=2.0) < P_LARGEST).mean()
    pooled = (chances(own, KINDS, change=2.0, told=False) < P_LARGEST).mean()
    assert within > 0.9 and pooled < 0.5


def test_the_family_multiplies_p():
    generator = np.random.default_rng(0)
    by_kind = {kind: np.zeros(1) for kind in "abcd"}
    here, reference = grams(generator, KINDS[0], by_kind, 1, 1.0), grams(generator, KINDS[1], by_kind, 1)
    alone, among = (contrast_of(here, reference, np.arange(2), 1, family, KINDS) for family in (1, 5))
    assert among.p == pytest.approx(min(1.0, 5 * alone.p)) and among.least > alone.least
    assert among.errors == pytest.approx(alone.errors)


def test_the_kind_of_a_motion_is_what_the_tool_does():
    scene = replace(SCENE, motions=("push", "hold", "cut-push", "cycles"))
    kinds = [motion_kind(episode_from_sequence(simulate_episode(scene, k), noise_m=2e-4, seed=k)) for k in range(8)]
    assert kinds[0].startswith("push") and kinds[1].startswith("press") and kinds[2].startswith("cut")
    assert kinds[3].split().count("press") == 2
    assert kinds[4:] == kinds[:4]
