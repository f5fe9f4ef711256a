"""Settings that make no sense are refused by name before any work is done."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

from plop.errors import PlopError
from plop.pipeline.stage import Input, Output
from stages import PIPELINE

STAGES = {ref.name: ref for ref in PIPELINE}
PROCESSES = ["compare", "diagnose", "eval", "filter", "fit-init", "identify", "simulate", "train"]
WRONG = [
    ("calibrate", "check_frames", 0),
    ("calibrate", "refine_scan", "sometimes"),
    ("fuse", "frame", -1),
    ("fuse", "method", "voxels"),
    ("fuse", "min_points", 0),
    ("fit-init", "steps", -1),
    ("fit-init", "flatness", 0.5),
    ("fit-init", "filling", "foam"),
    ("train", "track_steps", -5),
    ("train", "batch", 0),
    ("train", "horizon", 0),
    ("train", "width", 0),
    ("train", "learning_rate", -1e-3),
    ("train", "mask_weight", float("nan")),
    ("train", "cells_across", 0.0),
    ("filter", "settle", -1),
    ("filter", "views", 0),
    ("filter", "split", "validation"),
    ("rollout", "min_inside", 2.0),
    ("eval", "emd_every", -1),
    ("eval", "lpips_net", "resnet"),
    ("identify", "iterations", -1),
    *((name, "jobs", 0) for name in PROCESSES),
]


@pytest.mark.parametrize("name, setting, value", WRONG)
def test_a_setting_is_refused_by_name(tmp_path: Path, name: str, setting: str, value: object):
    stage = STAGES[name].load()
    inputs = {key: Input(tmp_path / key) for key in stage.inputs}
    with pytest.raises(PlopError) as caught:
        stage.run(inputs, stage.config(**{setting: value}), Output(tmp_path / "out"))
    assert caught.value.where == f"{name}.{setting}"
    assert caught.value.expected and caught.value.found == str(value)
    assert not list(tmp_path.glob("out/*"))


def test_a_training_without_steps_is_refused(tmp_path: Path):
    stage = STAGES["train"].load()
    with pytest.raises(PlopError, match="nothing to train"):
        stage.run({}, stage.config(track_steps=0, image_steps=0), Output(tmp_path))


def test_every_stage_with_processes_is_among_them():
    found = [name for name, ref in STAGES.items() if "jobs" in {field.name for field in fields(ref.load().config)}]
    assert sorted(found) == PROCESSES
