"""identify: the engine follows what it was fitted to; what it found, left out and cannot do is said."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest

from plop.comparison.discretisations import predicted_by_each, spacing_for
from plop.errors import PlopError
from plop.identification.first_guess import DRAWS, best_start, likeliest_draws
from plop.identification.identify import identify, starts_settled
from plop.identification.tracked_case import SlopeCase, TrackedCase
from plop.models import load_model
from plop.parameters import NOT_DETERMINED, Estimate
from plop.physics.adapters.filled import EngineBase
from plop.physics.adapters.filled_model import FilledEngineModel
from plop.physics.calibration.gauss_newton import Calibration
from plop.physics.calibration.material_parameters import PARAMETERS
from plop.physics.calibration.posterior import Posterior
from plop.physics.engine.fill import fill_surface
from plop.pipeline.settings import resolve
from plop.pipeline.stage import Input, Output
from plop.recordings.set import RecordingSet
from plop.tracking.episode import Episode
from stages.identify.stage import FIRST_GUESS, STAGE, IdentifyConfig, _summary, run
from tests.support.coarse_episodes import BASE, MATERIAL, coarse_episode
from tests.support.tracked_set import write_recordings


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    return write_recordings(tmp_path_factory.mktemp("set"), 2)


def test_the_fit_is_no_worse_and_the_model_can_be_loaded(inputs, tmp_path):
    config = IdentifyConfig(
        fit=("youngs_modulus_pa",),
        material=replace(FIRST_GUESS, youngs_modulus_pa=2.0e4, damping_per_s=5.0),
        spacing_m=0.010,
        start="settled",
        iterations=1,
        jobs=1,
    )
    summary = run(inputs, config, Output(tmp_path))
    facts = json.loads((tmp_path / "model.json").read_text())
    assert facts["kind"] == "engine" and facts["training"]["environment"] == "block"
    np.testing.assert_allclose(facts["training"]["size_m"], [0.06, 0.05, 0.04], rtol=0.05)
    found = facts["estimates"]["youngs_modulus_pa"]["value"]
    assert summary.figures["rms_after_mm"] <= summary.figures["rms_before_mm"]
    assert summary.table[0]["parameter"] == "youngs_modulus_pa"
    assert facts["training"]["episodes"] == RecordingSet.load(inputs["recordings"].path).train, "no test episode"
    model = load_model(tmp_path)
    assert isinstance(model, FilledEngineModel) and model.base.material.youngs_modulus_pa == pytest.approx(found)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"fit": ("hardness",)}, "youngs_modulus_pa"),
        ({"fit": ()}, "youngs_modulus_pa"),
        ({"start": "warm"}, "settled"),
        ({"split": "tset"}, "train"),
        ({"table_cone": "square"}, "pyramid"),
        ({"iterations": -1}, "0 or more"),
        ({"material.table_friction": -1.0}, "0 to 10"),
    ],
)
def test_settings_that_make_no_sense_are_refused_before_anything_is_read(change, expected):
    with pytest.raises(PlopError) as caught:
        resolve(IdentifyConfig, "identify", ("--set", change))
    name = next(iter(change))
    assert str(caught.value.where).endswith(name) and expected in str(caught.value.expected) and caught.value.fix


def test_a_split_without_an_episode_is_told_before_anything_is_tracked(tmp_path):
    RecordingSet(tmp_path, "block", ["block_000"], []).save()
    with pytest.raises(PlopError, match="no episode") as caught:
        STAGE.check_inputs({"recordings": Input(tmp_path)}, IdentifyConfig(split="test"))
    assert caught.value.expected == "an episode of split test"


def test_no_episode_is_said():
    with pytest.raises(PlopError, match="no episode"):
        identify([], BASE, ("youngs_modulus_pa",), iterations=1, jobs=1)


def test_hidden_patches_are_not_fitted():
    episode = coarse_episode(0)
    seen = np.ones(episode.points.shape[:2], bool)
    seen[2:, episode.patch == 0] = False
    observed = TrackedCase(replace(episode, seen=seen), BASE).observed
    assert np.isnan(observed[-1, 0]).all() and np.isfinite(observed[:, 1:]).all()


def test_particles_fill_the_object_in_about_the_number_asked_for():
    episode = coarse_episode(0)
    filled, _, _ = fill_surface(episode.vertices, episode.faces, spacing_for([episode], 500))
    assert len(filled) == pytest.approx(500, rel=0.15)


@pytest.mark.parametrize("settled", [True, False])
def test_the_state_at_the_start_is_seen_in_the_motion(settled):
    from plop.comparison.engine_run import predict_points, start_particles

    soft = EngineBase(replace(MATERIAL, youngs_modulus_pa=8e3), spacing_m=0.010, settled=settled)
    episode = coarse_episode(0)
    own = replace(episode, points=predict_points(soft, episode, start_particles(soft, episode)))
    assert starts_settled([own], soft) == settled


def test_what_the_recordings_hardly_tell_is_said():
    estimates = {
        "table_friction": Estimate(0.46, 0.39, 0.53, "-"),
        "tool_friction": Estimate(0.24, 0.0, 1.55, "-"),
        "youngs_modulus_pa": Estimate(1.5e4, unit="Pa"),
        "poisson": Estimate(0.0, unit="-", at_bound=True),
    }
    judged = {name: found.within(PARAMETERS[name]) for name, found in estimates.items()}
    found = Calibration(MATERIAL, judged, 1e-3, 1e-3, [1e-3, 1e-3, 1e-3, 3e-3], 1, 1)
    odd, *warnings = _summary(BASE, found, list("abcd"), {}).warnings
    assert odd.startswith("d counts little") and "3.00 mm RMS, the median episode by 1.00 mm" in odd
    assert [w.split()[0] for w in warnings] == ["tool_friction", "youngs_modulus_pa", "poisson"]
    assert "(0 to 1.55)" in warnings[0] and "remove it from --fit" in warnings[0]
    assert "(anything)" in warnings[1] and "bound of its range" in warnings[2]
    assert all(NOT_DETERMINED in warning for warning in warnings)
    assert [row["determined"] for row in _summary(BASE, found, list("abcd"), {}).table] == [
        "yes",
        *[NOT_DETERMINED] * 3,
    ]


FINE = replace(BASE, spacing_m=0.008)


def own(base: EngineBase, seed: int) -> Episode:
    """An episode as the engine itself moves."""
    episode = coarse_episode(seed)
    return replace(episode, points=np.mean(predicted_by_each(base, episode), 0))


@pytest.mark.parametrize("times", [0.15, 0.8, 7.0])
def test_the_stiffness_is_found_however_far_the_guess_is(times: float):
    guess = replace(FINE, material=replace(MATERIAL, youngs_modulus_pa=times * MATERIAL.youngs_modulus_pa))
    fitted, _ = identify([own(FINE, 0), own(FINE, 1)], guess, ("youngs_modulus_pa",), iterations=6, jobs=1)
    assert fitted.material.youngs_modulus_pa == pytest.approx(MATERIAL.youngs_modulus_pa, rel=0.01)
    assert replace(fitted.material, youngs_modulus_pa=guess.material.youngs_modulus_pa) == guess.material


def test_an_episode_in_which_something_else_happened_does_not_pull_the_fit():
    good = [own(FINE, k) for k in range(3)]
    softer = replace(FINE, material=replace(MATERIAL, youngs_modulus_pa=0.2 * MATERIAL.youngs_modulus_pa))
    fitted, found = identify([*good, own(softer, 3)], FINE, ("youngs_modulus_pa",), iterations=6, jobs=1)
    assert fitted.material.youngs_modulus_pa == pytest.approx(MATERIAL.youngs_modulus_pa, rel=0.02)
    assert np.argmax(found.episodes_rms_m) == 3


def test_the_likeliest_draw_need_not_lead_to_the_best_minimum(monkeypatch):
    @dataclass(frozen=True)
    class Valleys:
        """Off by 1 mm at a friction of 0.3, by nothing at 0.8, and far off between them."""

        base = BASE
        table_z_m = 0.0
        observed = np.zeros((1, 4, 3))

        def predict(self, material, config):
            mu = material.table_friction
            return np.full((1, 4, 3), 1e-3 + 0.05 * (mu - 0.3) ** 2 if mu < 0.6 else 0.02 * (mu - 0.8))

    draws = [replace(MATERIAL, table_friction=mu) for mu in (0.31, 0.7)]
    monkeypatch.setattr("plop.identification.first_guess.likeliest_draws", lambda *_: (draws, 2))
    found, runs = best_start([Valleys()] * 4, MATERIAL, Posterior.around(MATERIAL, ("table_friction",)), 8, jobs=1)
    assert found.table_friction == pytest.approx(0.8, abs=0.01) and runs > 10


def test_a_draw_on_which_the_engine_is_unstable_is_passed_over():
    class Unstable(SlopeCase):
        def predict(self, material, config):
            if material.youngs_modulus_pa > 1e4:
                raise PlopError("unstable", fix="softer")
            return super().predict(material, config)

    prior = Posterior.around(MATERIAL, ("youngs_modulus_pa",))
    found, runs = likeliest_draws([Unstable(coarse_episode(0), FINE)], MATERIAL, prior, jobs=1)
    assert all(each.youngs_modulus_pa <= 1e4 for each in found) and runs == DRAWS
