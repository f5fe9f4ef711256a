"""A run that ends with pictures names files that are there, and opens nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from plop.artifacts.manifest import Manifest
from plop.artifacts.store import Artifact
from plop_cli.console import Console
from plop_cli.pictures import say_videos, shown, worst_picture


def artifact(folder: Path, table: list[dict], files: list[str]) -> Artifact:
    for name in files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"x")
    manifest = Manifest.__new__(Manifest)
    object.__setattr__(manifest, "summary", {"table": table})
    return Artifact(folder, manifest)


def test_videos_and_stills_are_named_as_far_as_they_are_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    made = artifact(tmp_path / "r", [], ["a/images.h5", "a/video.mp4", "a/still.png", "b/images.h5", "b/video.mp4"])
    found = say_videos(Console(), made)
    told = capsys.readouterr().out
    assert "r/a/video.mp4" in told and "r/a/still.png" in told and "r/b/video.mp4" in told and "b/still" not in told
    assert [Path(path).is_file() for path in found["videos"] + found["stills"]] == [True] * 3
    assert shown(Path("/elsewhere/x")) == "/elsewhere/x"


def test_the_still_of_a_report_is_of_its_worst_episode(tmp_path: Path):
    rows = [{"over": "all", "where": "3 episodes", "rms_mm": 9.0}]
    rows += [{"over": "episode", "where": name, "rms_mm": rms} for name, rms in (("a", 1.0), ("b", 3.0), ("c", None))]
    names = [f"pictures/{name}_object.png" for name in "abc"]
    assert worst_picture(artifact(tmp_path / "x", rows, names)) == tmp_path / "x" / names[1]
    assert worst_picture(artifact(tmp_path / "y", rows, names[:1])) == tmp_path / "y" / names[0]
    assert worst_picture(artifact(tmp_path / "z", rows, [])) is None
