"""A band from training's held-out episodes to its scores: rollout with members, then eval, on exact tracks."""

from __future__ import annotations

import json
from dataclasses import replace

import imageio.v3 as iio
import numpy as np
import pytest
import torch

import stages.rollout.calibrate as calibrate
import stages.rollout.stage as rollout
from plop.dynamics.baselines import ConstantVelocity
from plop.errors import PlopError
from plop.gaussians.trajectory import Trajectory
from plop.pipeline.stage import Input, Output
from plop.uncertainty.band import NOMINAL, Band
from plop.uncertainty.errors import PointErrors
from plop.uncertainty.scores import BandScores
from stages.eval.stage import STAGE as EVAL
from stages.eval.stage import EvalConfig
from tests.support.tracked_set import write_recordings, write_tool_splats

STEP_M = 0.001
HELD = ["block_001", "block_002"]


class Drifting(ConstantVelocity):
    """Everything moves along x by a millimetre a frame."""

    def step(self, state, action, *, generator=None):
        means = state.gaussians.means + torch.tensor([STEP_M, 0.0, 0.0])
        return replace(state, gaussians=state.gaussians.with_(means=means))


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tracked")
    made = write_recordings(folder, 4)
    write_tool_splats(made["recordings"].path, made["init"].path)
    made["measured"] = made.pop("tracks")
    for name in ("model", "members.0", "members.1"):
        (folder / name).mkdir()
        facts = {"schema": 1, "training": {"environment": "block", "validation": HELD}}
        (folder / name / "model.json").write_text(json.dumps(facts))
        made[name] = Input(folder / name)
    return made


def still() -> ConstantVelocity:
    return ConstantVelocity(keep=0)


def roll(inputs, folder, *, member=Drifting):
    def loaded(path, device):
        return still() if path.name == "model" else member()

    folder.mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rollout, "load_model", loaded)
        patch.setattr(calibrate, "load_model", loaded)
        return rollout.run(inputs, rollout.RolloutConfig(jobs=1), Output(folder))


@pytest.fixture(scope="module")
def rolled(inputs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("out") / "rollout"
    return roll(inputs, folder), folder


def test_spread_and_radius_are_stored_and_few_episodes_are_said(rolled, inputs):
    summary, folder = rolled
    band = Band.load(folder)
    assert band.validation == tuple(HELD) and band.models == 3 and not band.guaranteed
    assert any("2 validation episode(s) cannot guarantee" in w and "at least 9" in w for w in summary.warnings)
    with Trajectory(folder / "block_003" / "states.h5") as states:
        last = states.frames("states")[-1]
        spread = states.extra("states", last, "spread_m").numpy()
        np.testing.assert_allclose(spread, last * STEP_M / np.sqrt(3), rtol=1e-4)
        radius = band.factor * NOMINAL * np.hypot(spread, band.noise_m)
        np.testing.assert_allclose(states.extra("states", last, "radius_m").numpy(), radius, rtol=1e-5)
    errors = [PointErrors.read(folder / "validation" / f"{name}.npz") for name in HELD]
    inside = [(np.linalg.norm(e.error_m, axis=-1) <= band.radius_m(e.spread_m))[e.counts].mean() for e in errors]
    assert np.mean(inside) == pytest.approx(0.9, abs=0.01)


def test_the_prediction_is_that_of_the_model_alone_and_the_video_shows_the_band(rolled, inputs, tmp_path):
    alone = {name: inputs[name] for name in ("recordings", "init", "model")}
    roll(alone, tmp_path / "alone")
    assert not (tmp_path / "alone" / "band.json").exists()
    images = [folder / "block_003" / "images.h5" for folder in (rolled[1], tmp_path / "alone")]
    assert images[0].read_bytes() == images[1].read_bytes()
    wide, narrow = (iio.imread(path.with_name("still.png")) for path in images)
    assert wide.shape[0] == narrow.shape[0] and wide.shape[1] > 1.25 * narrow.shape[1]


def test_eval_scores_the_band_beside_its_rivals(rolled, inputs, tmp_path):
    given = {name: inputs[name] for name in ("recordings", "init", "measured")}
    summary = EVAL.run(given | {"rollouts": Input(rolled[1])}, EvalConfig(emd_every=0), Output(tmp_path))
    scores = BandScores.load(tmp_path)
    assert list(scores.episodes) == ["block_003"]
    assert scores.methods["constant"] == scores.methods["persistence"], "the model is persistence"
    ensemble, widened = scores.methods["ensemble"], scores.methods["widened"]
    assert widened["nees"].mean == pytest.approx(ensemble["nees"].mean / scores.band.factor**2, rel=1e-5)
    assert widened["radius_mm"].mean == pytest.approx(ensemble["radius_mm"].mean * scores.band.factor, rel=1e-5)
    assert summary.figures["widened_coverage"] == round(widened["coverage"].mean, 3)
    assert iio.imread(tmp_path / "bands.png").std() > 10
    with pytest.raises(PlopError, match="needs measured points"):
        EVAL.run(
            {k: v for k, v in given.items() if k != "measured"} | {"rollouts": Input(rolled[1])},
            EvalConfig(emd_every=0),
            Output(tmp_path),
        )


def test_members_that_do_not_differ_are_reported(inputs, tmp_path):
    summary = roll(inputs, tmp_path / "same", member=still)
    assert any("all models predict the same" in warning for warning in summary.warnings)
    assert Band.load(tmp_path / "same").factor > 1


def test_a_band_without_held_out_episodes_or_with_a_model_twice_is_refused(inputs, tmp_path):
    with pytest.raises(PlopError, match="member twice"):
        rollout.STAGE.check_inputs(inputs | {"members.1": inputs["model"]}, rollout.RolloutConfig())
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "model.json").write_text(json.dumps({"schema": 1, "training": {"environment": "block"}}))
    with pytest.raises(PlopError, match="no validation episode") as refused:
        roll(inputs | {"members.1": Input(tmp_path / "model")}, tmp_path / "none")
    assert "train.validation=9" in str(refused.value)
    with pytest.raises(PlopError, match="needs measured points"):
        roll({name: value for name, value in inputs.items() if name != "measured"}, tmp_path / "untracked")
