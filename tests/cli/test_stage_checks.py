"""Every stage refuses settings that cannot be before it, or a dry run, looks for any input."""

from __future__ import annotations

from pathlib import Path

import pytest

from plop.errors import PlopError
from plop.pipeline.registry import StageRef, stage_ref
from plop.pipeline.settings import resolve, settings_of
from plop_cli.app import main
from stages import PIPELINE

ANY_NUMBER = {"seed", "jobs"}
"""A seed is checked where settings are read; jobs below 0 count from the number of cores."""


@pytest.mark.parametrize("ref", PIPELINE, ids=lambda ref: ref.command)
def test_numbers_have_a_range_and_defaults_are_in_it(ref: StageRef) -> None:
    stage = ref.load()
    assert stage.check is not None
    stage.check(stage.config(), {})
    for setting in settings_of(stage.config):
        if setting.kind in (int, float) and setting.key not in ANY_NUMBER:
            config = resolve(stage.config, ref.command, ("--set", {setting.key: -(10**9)}))
            with pytest.raises(PlopError) as caught:
                stage.check(config, {})
            assert setting.key.rpartition(".")[2] in str(caught.value.where), setting.key


@pytest.mark.parametrize(
    ("command", "key", "value"),
    [
        ("calibrate", "hand_eye_method", "FOO"),
        ("calibrate", "board_kind", "round"),
        ("fuse", "voxel_m", 1e-9),
        ("identify", "table_cone", "square"),
        ("eval", "backend", "gpu"),
        ("compare", "split", "tset"),
        ("augment", "value", "stiffness"),
    ],
)
def test_a_dry_run_refuses_what_a_run_would(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, key: str, value: object
) -> None:
    with pytest.raises(PlopError):
        stage = stage_ref(command).load()
        stage.check(resolve(stage.config, command, ("--set", {key: value})), {})  # type: ignore[misc]
    assert main([command, "--set", f"{key}={value}", "--dry-run", "-w", str(tmp_path)]) == 1
    told = capsys.readouterr().err
    assert f"found: {value}" in told and "needs the input" not in told
