"""The loop on tracked points: a hidden effect is named, added, and the error falls; where nothing is hidden none is.

The truth is finer than the engine that diagnoses, and of another elastic law.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plop.comparison.engine_run import predict_points, start_particles
from plop.diagnosis.decision.conclusion import Conclusion
from plop.diagnosis.diagnose import diagnose
from plop.diagnosis.responses.runs import Runs
from plop.diagnosis.responses.table import Measured
from plop.physics.adapters.filled import EngineBase
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import effect_type, library
from plop.physics.engine.material import ElasticLaw
from plop.physics.scenes.scene import simulate_episode
from plop.tracking.episode import Episode, episode_from_sequence
from tests.support.coarse_episodes import MATERIAL, SCENE

EPISODES = 5
EFFECTS = ("swelling", "tilt", "table_friction", "drag")
HIDDEN = effect_type("swelling")(rate_per_s=-0.3)
TRUTH = replace(SCENE, spacing_m=0.006, dx_m=0.012, material=replace(MATERIAL, law=ElasticLaw.FIXED_COROTATED))
ENGINE = EngineBase(MATERIAL, spacing_m=0.008)


def measured(first: int, effects: tuple[Effect, ...] = ()) -> list[Episode]:
    return [
        episode_from_sequence(simulate_episode(TRUTH, k, effects), noise_m=3e-4, seed=k, points=150)
        for k in range(first, first + EPISODES)
    ]


@pytest.fixture(scope="module")
def told(tmp_path_factory) -> Callable[[list[Episode]], Conclusion]:
    folder: Path = tmp_path_factory.mktemp("jobs")
    reference = Measured(measured(20))

    def run(episodes: list[Episode]) -> Conclusion:
        runs = Runs(folder, jobs=2)
        return diagnose(Measured(episodes), ENGINE, library(), runs, reference=reference, effects=EFFECTS)

    return run


def error_m(episodes: list[Episode], effects: tuple[Effect, ...]) -> float:
    """RMS over the patches' motion [m]."""
    squares = []
    for episode in episodes:
        points = predict_points(ENGINE, episode, start_particles(ENGINE, episode, effects), effects)
        squares.append((episode.pooled(points - points[:1] - episode.points + episode.points[:1]) ** 2).mean())
    return float(np.sqrt(np.mean(squares)))


def test_a_hidden_effect_is_named_and_adding_it_lowers_the_error(told):
    episodes = measured(0, (HIDDEN,))
    found = told(episodes)
    best = found.findings[0]
    assert best.name == "swelling" and best.stands, (best, found.verdict)
    assert "swelling" in found.verdict.named and "drag" not in found.verdict.named
    value = best.parameters["rate_per_s"]
    assert value.value == pytest.approx(HIDDEN["rate_per_s"], rel=0.3)
    assert found.verdict.evidence.left < found.verdict.evidence.error
    fitted = effect_type("swelling")(rate_per_s=value.value)
    held_out = measured(10, (HIDDEN,))[:2]
    assert error_m(held_out, (fitted,)) < 0.6 * error_m(held_out, ())


def test_nothing_hidden_nothing_detectable(told):
    found = told(measured(0))
    assert found.verdict.kind == "NOTHING DETECTABLE", found.verdict
    assert found.verdict.named == ()
    limit = found.limits["swelling"]
    assert limit.amplitude is not None and 0 < abs(limit.amplitude) < abs(HIDDEN["rate_per_s"]) and limit.unit == "1/s"
