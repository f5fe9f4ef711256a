"""All stages on a small recording, then a second run that executes nothing."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from plop.artifacts.store import Store
from plop.artifacts.verify import verify
from plop_cli.app import main
from tests.pipeline.small_set import COMMANDS, arguments

PAYLOAD = {
    "ingest": ["episodes.json", "episodes/box_000.h5"],
    "calibrate": ["episodes.json", "calibration.json"],
    "fuse": ["clouds/box_000.ply", "fuse.json"],
    "fit-init": ["box_000/object.ply", "box_000/tool.ply", "fit.json"],
    "train": ["model.safetensors", "model.json", "log.jsonl"],
    "filter": ["box_002.h5"],
    "rollout": ["box_002/states.h5", "box_002/images.h5", "box_002/video.mp4"],
    "eval": ["scores.json", "scores.csv"],
}


@pytest.fixture(scope="module")
def copied(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a copy: a command that has nothing to do leaves its notes all the same, and other processes read."""
    folder = tmp_path_factory.mktemp("copy") / "chain"
    shutil.copytree(finished, folder)
    return folder


@pytest.mark.parametrize("stage", PAYLOAD)
def test_every_stage_leaves_its_payload(copied: Path, stage: str):
    store = Store(copied)
    artifact = store.find(f"{stage}@latest")
    verify(artifact, store.cache, fresh=True)
    assert set(PAYLOAD[stage]) <= artifact.manifest.files.keys()
    assert artifact.manifest.environment == "box"


def test_second_run_executes_nothing(copied: Path, capsys: pytest.CaptureFixture[str]):
    for command in COMMANDS:
        assert main([*arguments(command, copied), "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["skipped"], command


def test_scores_hold_both_baselines(copied: Path):
    scores = json.loads((Store(copied).find("eval@latest").path / "scores.json").read_text())
    assert set(scores["methods"]) == {"plop", "persistence", "rigid"}


def test_nothing_is_stale_and_a_changed_setting_reruns_only_what_follows(
    finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    folder = tmp_path / "moved"
    shutil.copytree(finished, folder)  # a workspace can be moved
    assert main(["status", "-w", str(folder), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["artifacts"]
    assert {row["artifact"].split("@")[0] for row in rows} == set(PAYLOAD)
    assert all(row["state"] == "current" for row in rows), rows
    ran = {}
    for command in ("calibrate", "fuse", "fit-init"):
        extra = ["--voxel-m", "0.004"] if command == "fuse" else []
        assert main([*arguments(command, folder), *extra, "--json"]) == 0
        ran[command] = not json.loads(capsys.readouterr().out)["skipped"]
    assert ran == {"calibrate": False, "fuse": True, "fit-init": True}
    assert main(["status", "-w", str(folder), "--json", "--all"]) == 0
    states = {row["artifact"].split("@")[0]: row["state"] for row in json.loads(capsys.readouterr().out)["artifacts"]}
    assert states["train"].startswith("stale: its init")
    assert states["eval"].startswith("stale")
