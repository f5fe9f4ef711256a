"""The stage on small recordings: the verdict with all its keys, what it never reads, and what it refuses."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plop.comparison.bases import predictions_of
from plop.comparison.discretisations import discretised
from plop.diagnosis.diagnose import diagnose
from plop.diagnosis.responses import measured as reading
from plop.errors import PlopError
from plop.physics.effects.library import effect_type, library
from plop.pipeline.stage import Input, Inputs, Output
from plop.recordings.set import RecordingSet
from plop.tracking.sets import check_touch, tracked_episodes
from stages.augment.stage import AugmentConfig
from stages.augment.stage import run as augment
from stages.diagnose import stage
from stages.diagnose.stage import DiagnoseConfig, run
from tests.support.coarse_episodes import BASE, coarse_episode
from tests.support.tracked_set import write_engine, write_recordings
from tests.support.without_truth import write_without_truth

CONFIG = DiagnoseConfig(effects=("tilt", "adhesion"), sensors=False, jobs=1)
REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("set")


@pytest.fixture(scope="module")
def inputs(folder: Path) -> Inputs:
    tilted = write_recordings(folder, 4, (effect_type("tilt")(gx_m_s2=3.0),))
    plain = write_recordings(folder / "plain", 5, name="reference_")
    return {**tilted, **plain, "reference": plain["reference_recordings"], "model": write_engine(folder / "model")}


@pytest.fixture(scope="module")
def out(folder: Path) -> Path:
    (folder / "out").mkdir()
    return folder / "out"


@pytest.fixture(scope="module")
def facts(inputs: Inputs, out: Path) -> dict:
    assert run(inputs, CONFIG, Output(out)).figures["engine_runs"] > 20
    return verdict_of(out)


def verdict_of(path: Path) -> dict:
    return json.loads((path / "diagnosis.json").read_text())


def again(out: Path, target: Path) -> Path:
    """A scratch folder in which all engine runs are remembered, as after a kill."""
    target.mkdir()
    shutil.copytree(out / ".jobs", target / ".jobs")
    return target


def test_the_hidden_effect_is_named_with_everything_that_speaks_for_it(facts):
    assert facts["verdict"]["kind"] == "EFFECT" and facts["verdict"]["named"] == ["tilt"]
    best = facts["ranking"][0]
    assert best["effect"] == "tilt" and best["passes"] and best["reasons"] == []
    value = best["parameters"]["gx_m_s2"]
    assert value["unit"] == "m/s^2" and value["value"] == pytest.approx(3.0, rel=0.4)
    assert set(facts) == {
        "schema",
        "verdict",
        "ranking",
        "limits",
        "sensors",
        "searches",
        "error",
        "floor",
        "next_step",
        "episodes",
        "repeats",
        "reference_episodes",
        "dropped",
        "environment",
    }
    assert len(facts["episodes"]) == 4 and len(facts["reference_episodes"]) == 5
    assert facts["floor"] < facts["error"] and facts["environment"] == "block"
    assert facts["limits"]["tilt"]["displacement_m"] < best["size_mm"] / 1000


def test_a_camera_that_is_not_there_cannot_be_left_out(inputs, tmp_path):
    with pytest.raises(PlopError, match="no such camera") as caught:
        run(inputs, replace(CONFIG, exclude=("cam_99",)), Output(tmp_path))
    assert caught.value.found == "cam_99" and "cam_0" in str(caught.value.expected)


def test_every_fitted_and_chosen_number_has_its_unit(facts):
    types = library()
    for row in facts["ranking"]:
        kind = types[row["effect"]]
        units = {p.name: p.unit for p in kind.parameters()}
        assert {name: p["unit"] for name, p in row["parameters"].items()} == units


def test_what_was_added_is_not_expected_of_the_reference(inputs, facts, out, tmp_path, monkeypatch):
    """The reference has not the effect: the base predicts it, or the added effect would look missing there."""

    def noted(measured, *rest, reference, **more):
        given_predictions.append((measured.predictions, reference.predictions))
        return diagnose(measured, *rest, reference=reference, **more)

    given_predictions: list[tuple] = []
    monkeypatch.setattr(stage, "diagnose", noted)
    (tmp_path / "base+tilt").mkdir()
    augment({"model": inputs["model"]}, AugmentConfig("tilt", ("gx_m_s2=3",)), Output(tmp_path / "base+tilt"))
    found = {}
    for name, model in {"base": inputs["model"], "base+tilt": Input(tmp_path / "base+tilt")}.items():
        (tmp_path / name).mkdir(exist_ok=True)
        again(out, tmp_path / name / "out")
        run({**inputs, "model": model}, CONFIG, Output(tmp_path / name / "out"))
        found[name] = json.loads((tmp_path / name / "out" / "diagnosis.json").read_text())
    assert found["base"]["verdict"]["named"] == ["tilt"] and found["base+tilt"]["verdict"]["named"] == []
    assert found["base+tilt"]["error"] < 0.5 * found["base"]["error"]
    (bare, reference), (augmented, still) = given_predictions
    assert bare is None and reference is None and still is None  # None: the engine without anything added
    assert {len(each) for each in augmented.values()} == {len(discretised(BASE))}


@pytest.mark.parametrize(("trained", "used", "warned"), [(1, 3, False), (2, 4, True), (0, 4, False)])
def test_a_reference_that_the_model_was_trained_on_is_left_out(
    inputs, facts, out, tmp_path, monkeypatch, trained, used, warned
):
    def noted(measured, *rest, reference, **more):
        counts.append(len(reference.episodes))
        return diagnose(measured, *rest, reference=reference, **more)

    counts: list[int] = []
    monkeypatch.setattr(stage, "diagnose", noted)
    names = RecordingSet.load(inputs["recordings"].path).names
    model = tmp_path / "model"
    shutil.copytree(inputs["model"].path, model)
    (model / "tracks").mkdir()
    for name in [*names[:trained], "another_000"]:
        (model / "tracks" / f"{name}.h5").touch()
    given = {
        f"reference{part}": inputs[key] for part, key in (("", "recordings"), ("_init", "init"), ("_tracks", "tracks"))
    }
    again(out, tmp_path / "out")
    summary = run({**inputs, **given, "model": Input(model)}, CONFIG, Output(tmp_path / "out"))
    dropped = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["dropped"]
    assert counts == [used]
    assert dropped == {f"reference {name}": "the model was trained on it" for name in names[: 4 - used]}
    assert any("--folds 2" in text and "with 3 episodes or more" in text for text in summary.warnings) == warned


def test_a_fold_predicts_what_the_model_was_trained_on(inputs, tmp_path, monkeypatch):
    def noted(folder, recording_path, splat_path, episode):
        predicted.setdefault(folder, []).append(episode.name)
        return predictions_of(inputs["model"].path, recording_path, splat_path, episode)

    predicted: dict[Path, list[str]] = {}
    monkeypatch.setattr(reading, "predictions_of", noted)
    names = RecordingSet.load(inputs["recordings"].path).names
    model = tmp_path / "model"
    (model / "tracks").mkdir(parents=True)
    for name in names[:3]:
        (model / "tracks" / f"{name}.h5").touch()
    facts = json.loads((inputs["model"].path / "model.json").read_text())
    del facts["engine"]
    for part, left_out in {".": [], "folds/0": names[:3:2], "folds/1": names[1:2]}.items():
        (model / part).mkdir(parents=True, exist_ok=True)
        training = {**facts["training"], "left_out": left_out}
        (model / part / "model.json").write_text(json.dumps({**facts, "kind": "plop", "training": training}))
    given = {
        f"reference{part}": inputs[key] for part, key in (("", "recordings"), ("_init", "init"), ("_tracks", "tracks"))
    }
    (tmp_path / "out").mkdir()
    learned = {**inputs, **given, "model": Input(model), "engine": inputs["model"]}
    summary = run(learned, replace(CONFIG, effects=("tilt",)), Output(tmp_path / "out"))
    assert predicted[model / "folds" / "0"] == [names[0], names[2]]
    assert predicted[model / "folds" / "1"] == [names[1]]
    assert predicted[model] == [*names, names[3]]  # what is to be explained, and what the model has not seen
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert found["reference_episodes"] == names and not found["dropped"] and not summary.warnings


def test_after_a_kill_nothing_is_run_twice(inputs, facts, out, tmp_path):
    scratch = again(out, tmp_path / "again")
    assert run(inputs, CONFIG, Output(scratch)).figures["engine_runs"] == 0
    # not a byte differs, so that a repeat leaves what was made from it current
    assert (scratch / "diagnosis.json").read_bytes() == (out / "diagnosis.json").read_bytes()


def test_another_diagnosis_of_the_same_recordings_runs_the_engine_no_more(inputs, facts, out, tmp_path):
    """A shared folder outlives the artifact: with other settings, or another base around the same engine."""
    (tmp_path / "one").mkdir()
    summary = run(inputs, replace(CONFIG, seed=CONFIG.seed), Output(tmp_path / "one", cache=out / ".jobs"))
    assert summary.figures["engine_runs"] == 0 and summary.figures["named"] == "tilt"
    assert not (tmp_path / "one" / ".jobs").exists()


def test_the_truth_in_the_recordings_is_not_read(inputs, facts, out, tmp_path):
    bare = tmp_path / "bare"
    shutil.copytree(inputs["recordings"].path, bare)
    for path in (bare / "episodes").glob("*.h5"):
        path.unlink()
        write_without_truth(inputs["recordings"].path / "episodes" / path.name, path)
    scratch = again(out, tmp_path / "out")
    run({**inputs, "recordings": Input(bare)}, CONFIG, Output(scratch))
    assert verdict_of(scratch) == verdict_of(out)


_WATCHED = f"""
import sys
opened = []
sys.addaudithook(lambda event, args: opened.append(str(args[0])) if event == "open" else None)
import json
from pathlib import Path
from plop.pipeline.stage import Input, Output
from stages.diagnose.stage import DiagnoseConfig, run
inputs, out = json.loads(sys.argv[1]), Path(sys.argv[2])
inputs = {{name: Input(Path(path)) for name, path in inputs.items()}}
run(inputs, {CONFIG!r}, Output(out))
truth = ("plop.physics.scenes.sealed", "plop.recordings.truth")
print(json.dumps([opened, sorted(m for m in sys.modules if m in truth)]))
"""


def test_the_sealed_answer_is_never_opened(inputs, facts, out, tmp_path):
    assert (inputs["recordings"].path / "answer" / "sealed.json").is_file()
    scratch = again(out, tmp_path / "out")
    given = json.dumps({name: str(source.path) for name, source in inputs.items()})
    done = subprocess.run(
        [sys.executable, "-c", _WATCHED, given, str(scratch)],
        cwd=REPOSITORY,
        timeout=300,
        capture_output=True,
        text=True,
        check=True,
    )
    opened, imported = json.loads(done.stdout.splitlines()[-1])
    assert any(path.endswith("model.json") for path in opened)  # the watch works
    assert not [path for path in opened if "sealed.json" in path or "answer" in Path(path).parts]
    assert imported == []
    assert verdict_of(scratch) == verdict_of(out)


def refused(inputs: Inputs, path: Path, config: DiagnoseConfig = CONFIG) -> PlopError:
    with pytest.raises(PlopError) as caught:
        run(inputs, config, Output(path))
    return caught.value


def test_fewer_than_four_episodes_are_too_few(inputs, tmp_path):
    error = refused(inputs, tmp_path, replace(CONFIG, split="train"))
    assert error.expected == "at least 4" and "3" in error.found


@pytest.mark.parametrize(
    ("change", "environment", "problem"),
    [
        ({"exclude": ("cam_99",)}, "block", "no such camera"),
        ({}, "ball", "different objects"),
        ({"split": "train"}, "block", "too few episodes"),
    ],
)
def test_what_recordings_and_model_tell_is_refused_before_anything_is_tracked(
    inputs, tmp_path, change, environment, problem
):
    there = {"recordings": inputs["recordings"], "model": write_engine(tmp_path / "model", environment)}
    with pytest.raises(PlopError, match=problem):
        stage.check_inputs(there, replace(CONFIG, **change))
    assert stage.STAGE.check_inputs is stage.check_inputs


def test_model_and_recordings_of_different_objects(inputs, tmp_path):
    error = refused({**inputs, "model": write_engine(tmp_path / "model", "ball")}, tmp_path)
    assert (error.expected, error.found) == ("ball", "block")


def test_a_model_of_an_object_of_another_size(inputs, tmp_path):
    model = write_engine(tmp_path / "model", "block")
    facts = json.loads((model.path / "model.json").read_text())
    facts["training"]["size_m"] = [0.08, 0.05, 0.02]
    (model.path / "model.json").write_text(json.dumps(facts))
    error = refused({**inputs, "model": model}, tmp_path)
    assert "different size" in error.problem and error.expected == "80 x 50 x 20 mm"


def test_an_unknown_effect_gets_a_suggestion(inputs, tmp_path):
    assert refused(inputs, tmp_path, replace(CONFIG, effects=("tillt",))).fix == "Did you mean tilt?"


def test_an_error_in_an_effect_file_is_named_with_its_line(inputs, tmp_path):
    mine = tmp_path / "mine.py"
    mine.write_text("from plop.physics.effects.effect import Effect\n\nprint(wnid)\n")
    error = refused({**inputs, "effect_file": Input(mine)}, tmp_path)
    assert error.where == f"{mine}, line 3" and "wnid" in error.found


def test_a_learned_model_needs_an_engine(inputs, tmp_path):
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "model.json").write_text(json.dumps({"schema": 1, "kind": "plop", "config": {}}))
    assert "needs the engine" in refused({**inputs, "model": Input(tmp_path / "model")}, tmp_path).problem


def test_episodes_without_a_track_are_left_out_with_the_reason(inputs, tmp_path):
    recordings = RecordingSet.load(inputs["recordings"].path)
    tracks = tmp_path / "tracks"
    shutil.copytree(inputs["tracks"].path, tracks)
    (tracks / f"{recordings.names[0]}.h5").unlink()
    found, left_out = tracked_episodes(recordings, inputs["init"].path, tracks, recordings.names)
    assert [e.name for e in found] == recordings.names[1:]
    assert list(left_out) == recordings.names[:1]
    with pytest.raises(PlopError, match="No episode can be compared"):
        tracked_episodes(recordings, inputs["init"].path, tmp_path / "nothing", recordings.names)


def test_a_motion_that_never_touches_is_refused():
    episode = coarse_episode(0)
    check_touch(episode)
    poses = episode.tool.world_from_tool.copy()
    poses[:, 2, 3] += 0.2
    away = replace(episode, tool=replace(episode.tool, world_from_tool=poses))
    with pytest.raises(PlopError, match="never touches") as caught:
        check_touch(away)
    assert "mm at the closest" in caught.value.found


def test_points_follow_their_gaussians(inputs):
    recordings = RecordingSet.load(inputs["recordings"].path)
    (episode,), _ = tracked_episodes(recordings, inputs["init"].path, inputs["tracks"].path, recordings.names[:1])
    assert np.abs(episode.motion).max() > 2e-3
    assert episode.noise_m < 5e-4 and episode.patches >= 8
