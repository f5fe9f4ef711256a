"""Every setting says its range, unit and meaning, and a stage refuses what cannot be before it looks for any input."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from plop.errors import PlopError
from plop.pipeline.registry import StageRef
from plop.pipeline.settings import Setting, resolve, settings_of, unknown_setting
from plop.pipeline.settings_reference import sections, settings_reference
from plop.setting_kinds import SAME_RESULT, Range
from plop_cli.app import main
from plop_cli.stage_command import stage_function
from stages import PIPELINE

STAGES = {ref.command: ref for ref in PIPELINE}
UNITS = {"m": "m", "mm": "mm", "px": "px", "deg": "deg", "s": "s", "ms": "ms", "hz": "Hz", "pa": "Pa"}
"""What the name of a setting ends in -> its unit."""
RENAMED = [
    ("fit-init", "depth_weight", "render.depth"),
    ("fit-init", "ssim_weight", "render.ssim"),
    ("fit-init", "depth_unit_m", "render.depth_unit_m"),
    ("train", "l1_weight", "render.l1"),
    ("train", "mask_weight", "render.mask"),
    ("train", "length_unit_m", "render.depth_unit_m"),
    ("train", "track_weight", "weights.track"),
    ("train", "isometry_weight", "weights.isometry"),
    ("train", "filter_iterations", "update.iterations"),
    ("train", "kernel", "network.kernel"),
    ("train", "width", "network.width"),
    ("train", "resample", "resampling.enabled"),
    ("train", "resampling_form", "resampling.form"),
    ("train", "made_up", "made_up.episodes"),
    ("train", "made_up_turn_deg", "made_up.turn_deg"),
    ("filter", "iterations", "update.iterations"),
    ("filter", "depth_weight", "render.depth"),
    ("identify", "table_friction", "material.table_friction"),
    ("simulate", "depth_noise_m", "cameras.depth_noise_m"),
    ("ingest mesh", "cameras", "cameras.count"),
    ("ingest disect", "size", "cameras.size"),
    ("ingest droid", "idle_s", "rows.idle_s"),
    ("ingest droid", "camera_delay_ms", "cameras.delay_ms"),
]


def settings(ref: StageRef) -> list[Setting]:
    return settings_of(ref.load().config)


every_stage = pytest.mark.parametrize("ref", PIPELINE, ids=lambda ref: ref.command)


@every_stage
def test_numbers_have_a_range_a_fitting_unit_and_a_meaning(ref: StageRef) -> None:
    for setting in settings(ref):
        assert setting.help, setting.key
        assert not re.search(r"\[(-|px|deg|degrees)\]|\[m\]\.$", setting.help), "the unit is in the annotation"
        if setting.kind.type in (int, float):
            assert setting.kind.range != Range(), setting.key
            *before, last = setting.key.rpartition(".")[2].split("_")
            if last in UNITS and before and before[-1] not in {*UNITS, "per"}:  # m_s and per_s are other units
                assert setting.kind.unit == UNITS[last], setting.key


@every_stage
def test_a_number_out_of_range_is_refused_with_key_range_value_and_advice(ref: StageRef) -> None:
    config = ref.load().config
    for setting in settings(ref):
        low = setting.kind.range.low
        wrong = 0 if setting.kind.range.but == 0 else low - 1
        if setting.kind.type in (int, float):
            with pytest.raises(PlopError, match="out of range") as caught:
                resolve(config, ref.command, ("plop.toml", {setting.key: wrong}))
            assert caught.value.where == f"plop.toml: {ref.command.replace(' ', '.')}.{setting.key}"
            assert caught.value.expected == setting.kind.expected and float(str(caught.value.found)) == wrong
            assert f"plop {ref.command} --help" in str(caught.value.fix)


@every_stage
def test_at_most_ten_settings_are_common_and_come_first(ref: StageRef) -> None:
    found = settings(ref)
    common = [setting.key for setting in found if setting.common]
    assert len(common) <= 10 and (len(found) <= 10 or len(common) >= 3)
    title, rows = next(iter(sections(found).items()))
    assert title == ("Common settings" if common else "Settings") and (not common or {s.key for s in rows} == {*common})
    options = [name for name in stage_function(ref, ref.load()).__signature__.parameters if name.startswith("setting_")]
    assert len(options) == len([s for s in found if s.key != "scheduler"])  # every stage's own option


def test_only_settings_of_speed_and_programs_are_no_part_of_the_fingerprint() -> None:
    found = {s.key for ref in PIPELINE for s in settings(ref) if SAME_RESULT in s.kind.marks}
    assert found == {"jobs", "threads", "scheduler", "cameras.blender"}


@pytest.mark.parametrize(("command", "old", "new"), RENAMED)
def test_a_renamed_setting_points_to_its_new_name(command: str, old: str, new: str) -> None:
    error = unknown_setting(old, settings(STAGES[command]), where="plop.toml", stage=command)
    assert error.fix.startswith(f"Did you mean {new}")


def test_a_group_is_no_setting() -> None:
    error = unknown_setting("render", settings(STAGES["train"]), where="--set", stage="train")
    assert "group" in error.problem and "render.ssim" in str(error.expected) and error.fix


def test_an_option_that_was_renamed_points_to_its_new_name(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["train", "--depth-weight", "1", "-w", str(tmp_path)]) == 2
    assert "--render.depth" in capsys.readouterr().err


def test_help_shows_unit_range_and_default(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["train", "--help"]) == 0
    shown = capsys.readouterr().out
    assert "[1 or more frames; default 4]" in shown and "[0 to 1 m; default 0.001]" in shown
    assert shown.index("Common settings") < shown.index("─ Settings ") < shown.index("Settings render.*: Weights")
    assert "[paper or quadratic or cubic; default quadratic]" in shown and "[default yes]" in shown


def test_the_reference_has_a_row_for_every_setting() -> None:
    reference = settings_reference()
    assert list(reference) == [ref.command for ref in PIPELINE]
    for ref in PIPELINE:
        lines = reference[ref.command].splitlines()
        for setting in settings(ref):
            (row,) = [line for line in lines if line.startswith(f"| `{setting.key}`")]
            assert len(re.findall(r"(?<!\\)\|", row)) == 7, row
    assert "cuda:&lt;number>" in reference["train"] and "`animation/frame_<number>.ply`" in reference["rollout"]
    assert "| `horizon` | integer | `4` | frames | 1 or more |" in reference["train"]
    assert "| `render.depth_unit_m` | number | `0.1` | m | 1e-6 to 1e6 |" in reference["fit-init"]


@pytest.mark.parametrize(
    ("command", "key", "value"),
    [
        ("calibrate", "hand_eye_method", "FOO"),
        ("calibrate", "board_kind", "round"),
        ("calibrate", "check_frames", "0"),
        ("fuse", "voxel_m", "1e-9"),
        ("fuse", "source", "both"),
        ("identify", "table_cone", "square"),
        ("eval", "backend", "gpu"),
        ("compare", "split", "tset"),
        ("compare", "frames", "-1"),
        ("filter", "split", "tset"),
        ("report", "frames", "1"),
        ("report", "difference_mm", "nan"),
        ("augment", "value", "stiffness"),
    ],
)
def test_a_dry_run_refuses_what_a_run_would(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, key: str, value: Any
) -> None:
    (tmp_path / "artifacts").mkdir()
    assert main([command, "--set", f"{key}={value}", "--dry-run", "-w", str(tmp_path)]) == 1
    told = capsys.readouterr().err
    assert re.search(f"found: '?{value}", told) and "needs the input" not in told
