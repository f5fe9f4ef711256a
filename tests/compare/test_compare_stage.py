"""The compare stage: what it writes, what it refuses."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest

from plop.artifacts.manifest import Manifest
from plop.comparison.field_file import read_field
from plop.errors import PlopError
from plop.pipeline.stage import Input, Output
from stages.compare import stage
from stages.compare.stage import CompareConfig, run
from tests.support.compare_scene import make_inputs

ERROR_M = 0.003


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    return make_inputs(tmp_path_factory.mktemp("compare"))


@pytest.fixture
def sinking(monkeypatch):
    """A model that is right but for the right half, which ends 3 mm too low."""

    def predict(model, recording, splat, episode):
        share = np.linspace(0, 1, len(episode.times))[:, None]
        low = ERROR_M * share * (episode.points[0, :, 0] > 0)
        return episode.points - np.stack([0 * low, 0 * low, low], -1)

    monkeypatch.setattr(stage, "predict_episode", predict)


def test_tables_fields_and_pictures(inputs, sinking, tmp_path):
    summary = run(inputs, CompareConfig(jobs=1, frames=2), Output(tmp_path))
    facts = json.loads((tmp_path / "compare.json").read_text())
    assert facts["schema"] == 1 and facts["held_out"] == ["box_001"]
    assert [row["episode"] for row in facts["tables"]["episode"]] == ["box_000", "box_001"]
    worst = facts["episodes"]["box_000"]
    assert worst["worst_frame"] == 8 and worst["error_mm"][-1] == pytest.approx(3 / np.sqrt(2), rel=0.1)
    assert facts["size_mm"] == pytest.approx([60, 60, 30], abs=2)
    field = read_field(tmp_path / "fields" / "box_001.npz")
    assert field.error_m[-1].max() == pytest.approx(ERROR_M, rel=1e-3)
    for name in ("box_000_time", "box_000_object", "tables"):
        assert (tmp_path / "pictures" / f"{name}.png").stat().st_size > 10_000
    assert summary.figures["worst"].startswith("box_00") and "(retract)" in summary.figures["worst"]
    rows = [row for row in summary.table if row["over"] == "phase"]
    assert rows[0]["where"] == "retract" and rows == sorted(rows, key=lambda row: -row["rms_mm"])


def test_cameras_see_the_error_above_their_floor(inputs, sinking, tmp_path):
    run(inputs, CompareConfig(jobs=1, frames=1, pictures=False, episodes="box_000"), Output(tmp_path))
    rows = json.loads((tmp_path / "compare.json").read_text())["tables"]["camera"]
    assert [row["camera"] for row in rows] == [f"cam_0{k}" for k in range(4)]
    assert max(row["depth_mm"] - row["depth_mm_floor"] for row in rows) > 0.3
    assert all(row["n"] > 50 for row in rows)


def test_another_object_is_refused_unless_asked_for(inputs, sinking, tmp_path):
    facts = json.loads((inputs["model"].path / "model.json").read_text())
    for change, words in (
        ({"environment": "sponge"}, "different objects"),
        ({"environment": "box", "size_m": [0.09, 0.06, 0.03]}, "different size"),
    ):
        (tmp_path / "model.json").write_text(json.dumps(facts | {"training": change}))
        other = {**inputs, "model": Input(tmp_path)}
        config = CompareConfig(jobs=1, frames=0, pictures=False)
        with pytest.raises(PlopError, match=words):
            run(other, config, Output(tmp_path))
        run(other, CompareConfig(jobs=1, frames=0, pictures=False, other_object=True), Output(tmp_path))


def test_what_recordings_and_model_tell_is_refused_before_anything_is_tracked(inputs):
    there = {name: inputs[name] for name in ("recordings", "model")}
    stage.STAGE.check_inputs(there, CompareConfig())
    with pytest.raises(PlopError, match="No episode is selected") as caught:
        stage.STAGE.check_inputs(there, CompareConfig(episodes="ball_*"))
    assert "box_000" in str(caught.value.found) and caught.value.fix


def test_unlike_conventions_are_refused(inputs, sinking, tmp_path):
    broken = make_inputs(tmp_path / "set", names=("box_000",))
    with h5py.File(broken["recordings"].path / "episodes" / "box_000.h5", "r+") as file:
        file.attrs["units"] = "mm, s"
    with pytest.raises(PlopError, match="another convention") as caught:
        run(broken, CompareConfig(jobs=1), Output(tmp_path))
    assert caught.value.found == "mm, s"


def test_tracks_of_other_recordings_are_refused(inputs, sinking, tmp_path):
    def of(stage_name: str, mark: str, source: str) -> Manifest:
        return Manifest(stage_name, mark, 1, {}, {"recordings": {"stage": "ingest", "fingerprint": source}})

    known = {
        **inputs,
        "recordings": Input(inputs["recordings"].path, of("calibrate", "aa", "00")),
        "init": Input(inputs["init"].path, of("fit-init", "bb", "aa")),
        "tracks": Input(inputs["tracks"].path, of("filter", "cc", "00")),
    }
    with pytest.raises(PlopError, match="different recordings") as caught:
        run(known, CompareConfig(jobs=1), Output(tmp_path))
    assert caught.value.where == "compare.tracks"


def test_a_pattern_that_fits_no_episode_is_refused(inputs, tmp_path):
    with pytest.raises(PlopError, match="No episode"):
        run(inputs, CompareConfig(episodes="x*"), Output(tmp_path))
