"""Inside a run a recording is opened and checked once; a replaced file is another one."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from plop.errors import PlopError
from plop.recordings import open_recordings as pool
from plop.recordings import recording as module
from plop.recordings.open_recordings import share_open_recordings
from plop.recordings.recording import Recording
from plop.recordings.set import RecordingSet
from tests.support.ellipsoid_scene import ring, write_set


@pytest.fixture
def checks(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the files that were checked, in order."""
    seen: list[str] = []
    real = module.check_recording_file

    def check(file: object, path: Path, *, maker: str) -> None:
        seen.append(path.stem)
        real(file, path, maker=maker)

    monkeypatch.setattr(module, "check_recording_file", check)
    return seen


@pytest.fixture
def recordings(tmp_path: Path) -> RecordingSet:
    write_set(tmp_path, {name: {} for name in "abc"}, cameras=ring(2))
    return RecordingSet.load(tmp_path)


def test_a_recording_is_checked_once_in_a_run(recordings: RecordingSet, checks: list[str]) -> None:
    with share_open_recordings():
        with recordings.open("a") as first, recordings.open("a") as second:
            assert first is second
        with share_open_recordings(), Recording.open(recordings.path("a")) as third:  # a piece inside the run
            assert third is first and len(third) == len(third.time_s)
    assert checks == ["a"] and not first._file
    for _ in range(2):
        with recordings.open("a") as alone:
            assert len(alone)
        assert not alone._file
    assert checks == ["a", "a", "a"]


def test_few_stay_open_and_none_is_checked_twice(
    recordings: RecordingSet, checks: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pool, "MOST_OPEN", 1)
    with share_open_recordings():
        opened = []
        for name in "abcab":
            with recordings.open(name) as recording, recordings.open("c") as read_meanwhile:
                assert recording.name == name and len(read_meanwhile)
            opened.append(recording)
        assert sum(bool(each._file) for each in {id(each): each for each in opened}.values()) <= 2
    assert sorted(checks) == ["a", "b", "c"]


def test_a_replaced_or_damaged_file_is_opened_anew(recordings: RecordingSet, checks: list[str]) -> None:
    path = recordings.path("a")
    with share_open_recordings():
        with recordings.open("a") as before:
            assert before.name == "a"
        recordings.path("b").replace(path)
        with recordings.open("a") as after:
            assert after.name == "b"
        path.unlink()
        with pytest.raises(PlopError, match="no such recording"):
            recordings.open("a")
        path.write_bytes(b"no HDF5")
        with pytest.raises(PlopError, match="cannot be opened"):
            recordings.open("a")
    assert checks == ["a", "a"]


def test_another_thread_opens_its_own(recordings: RecordingSet) -> None:
    seen: list[Recording] = []

    def read() -> None:
        with recordings.open("a") as recording:
            seen.append(recording)

    with share_open_recordings(), recordings.open("a") as own:
        thread = threading.Thread(target=read)
        thread.start()
        thread.join()
        assert seen and seen[0] is not own and len(own)
