"""kill -9 at any moment: nothing looks finished that is not, and the next run ends as an undisturbed one would."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from plop.artifacts.store import Store
from tests.pipeline import fake_stages as fake

REPOSITORY = Path(__file__).resolve().parents[2]
PAUSE_S = 0.15


def start(workspace: Path, pause_s: float = PAUSE_S) -> subprocess.Popen[str]:
    fake.raw_folder(workspace / "blocks")
    command = [sys.executable, "-m", "tests.pipeline.slow_run", str(workspace), str(pause_s)]
    return subprocess.Popen(command, cwd=REPOSITORY, stdout=subprocess.PIPE, text=True)


def wait_for(condition: object, seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < end, "it took too long"
        time.sleep(0.01)


def pieces_done(workspace: Path) -> int:
    return len(list(workspace.glob("artifacts/ingest/.partial-*/.done/*")))


def payload(workspace: Path) -> dict[str, str]:
    (artifact,) = Store(workspace).artifacts("ingest")
    return {name: (artifact.path / name).read_text() for name in artifact.manifest.files}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    workspace = tmp_path_factory.mktemp("undisturbed")
    assert start(workspace).communicate()[0] == "ran\n"
    return payload(workspace)


@pytest.mark.parametrize("after", [1, 4])
def test_killed_run_goes_on_to_the_same_result(tmp_path: Path, undisturbed: dict[str, str], after: int):
    process = start(tmp_path)
    wait_for(lambda: pieces_done(tmp_path) >= after)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert Store(tmp_path).artifacts() == []
    kept = next(tmp_path.glob("artifacts/ingest/.partial-*")) / "attempts.log.tmp"
    first = kept.read_text().split()
    assert start(tmp_path).communicate()[0] == "ran\n"
    assert payload(tmp_path) == undisturbed
    assert len(first) < 6
    assert start(tmp_path).communicate()[0] == "skipped\n"


def test_two_runs_at_once_make_it_once(tmp_path: Path, undisturbed: dict[str, str]):
    first = start(tmp_path)
    wait_for(lambda: pieces_done(tmp_path) >= 1)
    second = start(tmp_path)
    assert first.communicate()[0] == "ran\n"
    said = second.communicate()[0].split()
    assert said[-1] == "skipped"
    assert payload(tmp_path) == undisturbed
    assert not list(tmp_path.glob("artifacts/ingest/.*"))


def test_second_run_takes_over_when_the_first_is_killed(tmp_path: Path, undisturbed: dict[str, str]):
    first = start(tmp_path, 0.4)
    wait_for(lambda: pieces_done(tmp_path) >= 1)
    second = start(tmp_path, 0.4)
    assert second.stdout is not None
    assert second.stdout.readline() == "waiting\n"
    first.send_signal(signal.SIGKILL)
    first.communicate()
    assert second.communicate()[0] == "ran\n"
    assert payload(tmp_path) == undisturbed
