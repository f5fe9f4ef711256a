"""A workspace in which three commands are fake stages."""

from __future__ import annotations

from pathlib import Path

import pytest

from plop.pipeline.registry import StageRef
from tests.pipeline import fake_stages as fake

FAKES = (
    StageRef("ingest mesh", "tests.pipeline.fake_stages:INGEST", "Write pieces."),
    StageRef("calibrate", "tests.pipeline.fake_stages:CALIBRATE", "Join."),
    StageRef("fuse", "tests.pipeline.fake_stages:FULL_DISK", "Fail."),
)


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give a workspace in which three commands are fake stages."""
    loaded = {ref.command: ref for ref in FAKES}
    original = StageRef.load
    monkeypatch.setattr(StageRef, "load", lambda ref: original(loaded.get(ref.command, ref)))
    monkeypatch.setenv("PLOP_WORKSPACE", str(tmp_path))
    fake.raw_folder(tmp_path / "blocks")
    return tmp_path
