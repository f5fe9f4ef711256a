"""The eval stage on predictions that are exactly right, and that do not move."""

import csv
import json

import h5py
import numpy as np
import pytest

import stages.rollout.stage as rollout
from plop.dynamics.baselines import ConstantVelocity
from plop.errors import PlopError
from plop.pipeline.stage import Input, Output
from stages.eval.stage import STAGE, EvalConfig
from tests.support.block_scene import STEP_M, Parting, make_inputs


def roll(inputs, model, folder) -> Input:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rollout, "load_model", lambda path, device: model)
        folder.mkdir()
        rollout.run(inputs, rollout.RolloutConfig(jobs=1), Output(folder))
    return Input(folder)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("block")
    made = make_inputs(folder, names=("a", "b"))
    return made | {"rollouts": roll(made, Parting(), folder / "rollout")}


@pytest.fixture(scope="module")
def scored(inputs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("eval")
    return STAGE.run(inputs, EvalConfig(), Output(folder)), folder


@pytest.fixture(scope="module")
def report(scored):
    return json.loads((scored[1] / "scores.json").read_text())


def mean(report, method, metric, part="episode"):
    return report["methods"][method][part][metric]["mean"]


def test_an_exact_prediction_scores_almost_perfectly(report):
    assert mean(report, "plop", "cd_mm") < 0.02
    assert mean(report, "plop", "emd_mm") < 0.05
    assert mean(report, "plop", "j_score") > 0.998
    assert mean(report, "plop", "psnr_db") > 45
    assert mean(report, "plop", "truth_rms_mm") < 0.01


def test_persistence_is_perfect_at_frame_0_and_worst_at_the_end(report):
    assert mean(report, "persistence", "cd_mm", "start") < 0.02
    assert mean(report, "persistence", "cd_mm", "end") > mean(report, "persistence", "cd_mm", "episode") > 0.5


def test_the_node_error_of_persistence_is_the_motion_itself(report):
    # Every node moves by STEP_M a frame, over three frames.
    assert mean(report, "persistence", "truth_rms_mm", "end") == pytest.approx(3000 * STEP_M, rel=1e-4)
    assert mean(report, "persistence", "truth_rms_mm") == pytest.approx(2000 * STEP_M, rel=1e-4)


def test_no_rigid_motion_parts_the_halves_but_it_is_no_worse_than_standing_still(report):
    for part in ("episode", "end"):
        assert mean(report, "plop", "cd_mm", part) < mean(report, "rigid", "cd_mm", part)
        assert mean(report, "rigid", "cd_mm", part) < 1.1 * mean(report, "persistence", "cd_mm", part)


def test_the_prediction_is_compared_with_persistence(report):
    better = report["better_than_persistence_percent"]
    assert better["episode"]["cd_mm"] > 95
    assert better["end"]["emd_mm"] > 95


def test_lpips_is_unavailable_and_says_why(report, scored, tmp_path, inputs, monkeypatch):
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "empty"))
    (tmp_path / "out").mkdir()
    summary = STAGE.run(inputs, EvalConfig(emd_every=0), Output(tmp_path / "out"))
    found = json.loads((tmp_path / "out" / "scores.json").read_text())
    assert "alexnet" in found["unavailable"]["lpips"]
    assert found["methods"]["plop"]["episode"]["lpips"] is None
    assert any("lpips is unavailable" in warning for warning in summary.warnings)


def test_conventions_and_parts_are_named_inside(report):
    assert "[mm]" in report["conventions"]["cd_mm"]
    assert set(report["conventions"]) == set(report["methods"]["plop"]["end"])
    assert set(report["parts"]) == {"episode", "end", "start"}
    assert "oracle" in report["baselines"]["rigid"]
    assert any("Two episodes" in note for note in report["notes"])


def test_the_csv_has_a_row_per_episode_method_and_frame(scored):
    with (scored[1] / "scores.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 3 * 4
    assert {row["lpips"] for row in rows} == {""}
    assert all(float(row["cd_mm"]) >= 0 for row in rows)


def test_pictures_are_there_and_the_plot_too(scored):
    import imageio.v3 as iio

    for name in ("a", "b"):
        picture = iio.imread(scored[1] / "pictures" / f"{name}.png")
        assert picture.shape[2] == 3
        assert picture.std() > 10
    assert (scored[1] / "over_time.png").stat().st_size > 10000


def test_the_summary_shows_every_method_and_part(scored):
    shown = {(row["over"], row["method"]) for row in scored[0].table}
    assert shown == {
        (part, method) for part in ("episode", "end", "start") for method in ("plop", "persistence", "rigid")
    }


def test_a_second_run_goes_on_and_gives_the_same_bytes(inputs, scored, tmp_path):
    done = Output(tmp_path)
    STAGE.run(inputs, EvalConfig(), done)
    before = (tmp_path / "episodes" / "a.json").stat().st_mtime_ns
    STAGE.run(inputs, EvalConfig(), done)
    assert (tmp_path / "episodes" / "a.json").stat().st_mtime_ns == before
    for name in ("scores.json", "scores.csv", "over_time.png", "pictures/a.png", "episodes/b.json"):
        assert (tmp_path / name).read_bytes() == (scored[1] / name).read_bytes()


def test_a_prediction_that_stands_still_scores_as_persistence(inputs, tmp_path):
    still = roll(inputs, ConstantVelocity(keep=0), tmp_path / "still")
    (tmp_path / "out").mkdir()
    STAGE.run(inputs | {"rollouts": still}, EvalConfig(method="still"), Output(tmp_path / "out"))
    methods = json.loads((tmp_path / "out" / "scores.json").read_text())["methods"]
    for metric in ("cd_mm", "emd_mm", "ssim", "j_score"):
        still, persistence = (methods[name]["end"][metric]["mean"] for name in ("still", "persistence"))
        assert still == pytest.approx(persistence, rel=1e-6)


def test_an_empty_mask_is_undefined_and_said(inputs, tmp_path):
    made = make_inputs(tmp_path, names=("a",))
    rolled = roll(made, Parting(), tmp_path / "rollout")
    with h5py.File(tmp_path / "recordings" / "episodes" / "a.h5", "a") as file:
        for camera in file["cameras"].values():
            camera["mask"][2] = 0
    (tmp_path / "out").mkdir()
    summary = STAGE.run(made | {"rollouts": rolled}, EvalConfig(), Output(tmp_path / "out"))
    rows = json.loads((tmp_path / "out" / "episodes" / "a.json").read_text())
    empty = [row for row in rows if row["frame"] == 2]
    assert all(row[metric] is None for row in empty for metric in ("cd_mm", "emd_mm", "j_score", "ssim", "psnr_db"))
    assert any("j_score of plop is undefined in 1 frame" in warning for warning in summary.warnings)
    report = json.loads((tmp_path / "out" / "scores.json").read_text())
    assert mean(report, "plop", "j_score") > 0.998


def expect_error(inputs, tmp_path, text, **config):
    (tmp_path / "out").mkdir(exist_ok=True)
    with pytest.raises(PlopError, match=text):
        STAGE.run(inputs, EvalConfig(**config), Output(tmp_path / "out"))


def test_rollouts_of_other_recordings_are_refused(inputs, tmp_path):
    made = make_inputs(tmp_path / "other", names=("z",))
    expect_error(made | {"rollouts": inputs["rollouts"]}, tmp_path, "another set of recordings")


def test_rollouts_of_another_length_are_refused(inputs, tmp_path):
    made = make_inputs(tmp_path / "other", names=("a", "b"), frames=5)
    expect_error(made | {"rollouts": inputs["rollouts"]}, tmp_path, "differ in frames")


def test_missing_rollouts_fits_and_damaged_views_are_errors(inputs, tmp_path):
    (tmp_path / "nothing").mkdir()
    expect_error(inputs | {"rollouts": Input(tmp_path / "nothing")}, tmp_path, "nothing to score")
    expect_error(inputs | {"init": Input(tmp_path / "nothing")}, tmp_path, "no fitted Gaussians")
    (tmp_path / "cut" / "a").mkdir(parents=True)
    (tmp_path / "cut" / "a" / "images.h5").write_bytes(b"half a file")
    expect_error(inputs | {"rollouts": Input(tmp_path / "cut")}, tmp_path, "cannot be opened")


def test_settings_that_make_no_sense_are_refused(inputs, tmp_path):
    expect_error(inputs, tmp_path, "out of range", emd_every=-1)
    expect_error(inputs, tmp_path, "invalid value", lpips_net="resnet")
    expect_error(inputs, tmp_path, "no such camera", picture_camera="top")


def test_scores_are_plain_json(scored):
    text = (scored[1] / "scores.json").read_text()
    assert "NaN" not in text and "Infinity" not in text
    assert np.isfinite(json.loads(text)["methods"]["plop"]["end"]["cd_mm"]["mean"])
