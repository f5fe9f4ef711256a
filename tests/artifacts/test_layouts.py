"""Names in payloads: artifacts that were written by earlier versions have them, so they stay."""

from __future__ import annotations

from pathlib import Path

from plop.artifacts import layouts as of

HERE = Path()
NAMES = {
    "episodes.json": of.Recordings(HERE).index,
    "calibration.json": of.Recordings(HERE).verdicts,
    "episodes/a.h5": of.Recordings(HERE).episode("a"),
    "reports/a.json": of.Recordings(HERE).report("a"),
    "clouds/a.ply": of.Clouds(HERE).cloud("a"),
    "fuse.json": of.Clouds(HERE).facts,
    "fit.json": of.Fits(HERE).facts,
    "a/fit.json": of.Fits(HERE).episode("a").score,
    "a/object.ply": of.Fits(HERE).episode("a").object_splat,
    "a/tool.ply": of.Fits(HERE).episode("a").tool_splat,
    "a/tool_view.png": of.Fits(HERE).episode("a").picture("tool_view"),
    "a.h5": of.Tracks(HERE).states("a"),
    "a.json": of.Tracks(HERE).innovation("a"),
    "model.json": of.Model(HERE).facts,
    "model.safetensors": of.Model(HERE).weights,
    "log.jsonl": of.Model(HERE).log,
    "tensorboard": of.Model(HERE).board,
    "tracks/a.h5": of.Model(HERE).tracks.states("a"),
    "made-up/a-0.h5": of.Model(HERE).made_up.states("a-0"),
    "folds": of.Model(HERE).folds,
    "base/base/model.json": of.Model(HERE).base.base.facts,
    "effects": of.Model(HERE).effects,
    "a/states.h5": of.Rollouts(HERE).episode("a").states,
    "a/images.h5": of.Rollouts(HERE).episode("a").images,
    "a/video.mp4": of.Rollouts(HERE).episode("a").video,
    "a/still.png": of.Rollouts(HERE).episode("a").still,
    "a/animation/frame_00007.ply": of.Rollouts(HERE).episode("a").frame(7),
    "validation/a.npz": of.Rollouts(HERE).validation("a"),
    "scores.json": of.ScoreFiles(HERE).report,
    "bands.png": of.ScoreFiles(HERE).bands,
    "bands/a.npz": of.ScoreFiles(HERE).band_errors("a"),
    "scores.csv": of.ScoreFiles(HERE).table,
    "over_time.png": of.ScoreFiles(HERE).over_time,
    "pictures/a.png": of.ScoreFiles(HERE).picture("a"),
    "compare.json": of.ComparisonFiles(HERE).facts,
    "fields/a.npz": of.ComparisonFiles(HERE).field("a"),
    "pictures/a_object.png": of.ComparisonFiles(HERE).on_object("a"),
    "report.html": of.Report(HERE).page,
}


def test_names_are_those_of_artifacts_that_are_there() -> None:
    assert {name: path.as_posix() for name, path in NAMES.items()} == {name: name for name in NAMES}


def test_rollouts_are_found_by_name(tmp_path: Path) -> None:
    for name in "ba":
        (tmp_path / name).mkdir()
        of.Rollouts(tmp_path).episode(name).images.touch()
    (tmp_path / "c").mkdir()
    assert [rollout.folder.name for rollout in of.Rollouts(tmp_path).all] == ["a", "b"]
