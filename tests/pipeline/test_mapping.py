"""Episodes in parallel: the same files as one after the other, nothing lost, progress reported."""

from __future__ import annotations

import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

import pytest
from joblib import effective_n_jobs

from plop.artifacts.manifest import content_files
from plop.artifacts.store import Store
from plop.errors import PlopError
from plop.pipeline import mapping
from plop.pipeline.mapping import Piece
from plop.pipeline.stage import Output
from plop_cli.app import main

Sent = TypeVar("Sent")
NAMES = ["a", "b", "c", "d"]
REPOSITORY = Path(__file__).resolve().parents[2]


def write(bad: str, name: str, out: Output) -> None:
    if name == bad:
        raise PlopError("It cannot be read.", where=name, expected="a file", found="none")
    for step in range(4):
        out.progress(step + 1, 4, f"{name} {step}", process=os.getpid())
    (out.path / name).write_text(name)


def slow(name: str, out: Output) -> None:
    (out.path / f"{name}.started").write_text(str(os.getpid()))
    time.sleep(60 if name == "d" else 0)


def written(bad: str, name: str, out: Output) -> dict[str, object]:
    write(bad, name, out)
    return {"name": name, "pair": (1, 2.5), "process": os.getpid()}


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_piece_is_made_once_and_its_error_kept(tmp_path: Path, jobs: int) -> None:
    told: list[tuple[float, float]] = []
    out = Output(tmp_path, lambda done, total, label="", **figures: told.append((done, total)))
    (tmp_path / "a").write_text("made before")
    out.mark_done("a", "kept")
    found = out.map(NAMES, partial(write, "c"), jobs=jobs, keep_going=True)
    assert list(found.values) == ["a", "b", "d"] and list(found.errors) == ["c"]
    assert found.values == {"a": "kept", "b": None, "d": None}
    error = found.errors["c"]
    assert (error.where, error.expected, error.found) == ("c", "a file", "none")
    assert [(tmp_path / name).read_text() for name in "abd"] == ["made before", "b", "d"]
    assert [out.is_done(name) for name in NAMES] == [True, True, False, True]
    assert all(total == 4 and 0 <= done <= 4 for done, total in told) and told[-1][0] == 4
    assert [done for done, _ in told] == sorted(done for done, _ in told)
    again = out.map(NAMES, partial(write, ""), jobs=jobs)
    assert not again.errors and (tmp_path / "c").read_text() == "c"
    assert sorted(path.name for path in tmp_path.iterdir()) == [".done", *NAMES], "how far a piece is stands elsewhere"


@pytest.mark.parametrize("jobs", [1, 2])
def test_values_come_in_order_and_are_the_same_when_a_run_goes_on(tmp_path: Path, jobs: int) -> None:
    out = Output(tmp_path)
    first = out.map(NAMES[::-1], partial(written, ""), jobs=jobs).values
    assert list(first) == NAMES[::-1] and first["a"]["pair"] == [1, 2.5]
    assert out.map(NAMES[::-1], partial(write, "a"), jobs=jobs).values == first  # nothing is left to do


def test_two_kinds_of_pieces_may_have_the_same_names(tmp_path: Path) -> None:
    out = Output(tmp_path)
    for kind in ("track", "made-up"):
        assert out.map(["a"], partial(_of, kind), of=kind).values == {"a": kind}
    assert out.is_done("track-a") and not out.is_done("a")


def _of(kind: str, name: str, out: Output) -> str:
    return kind


def test_a_damaged_mark_is_no_mark(tmp_path: Path) -> None:
    (tmp_path / ".done").mkdir()
    (tmp_path / ".done" / "a").touch()
    assert Output(tmp_path).map(["a"], partial(_of, "new")).values == {"a": "new"}


def test_a_process_of_a_killed_run_leaves_no_note(tmp_path: Path) -> None:
    """It lives a moment longer, while the next run works in the same folder."""
    (tmp_path / "out").mkdir()
    task = mapping._Task(partial(_far, tmp_path), tmp_path / "out", "", tmp_path / "gone")
    assert task("a").value == "a"
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [".done"] and not (tmp_path / "gone").exists()


def _far(folder: Path, name: str, progress: Callable[..., None]) -> str:
    progress(1, 1, name)
    return name


def test_a_mapper_may_carry_the_pieces_out_elsewhere_and_twice(tmp_path: Path) -> None:
    """As a cluster does: pickled, in any order, again where a worker was lost."""
    seen: list[int] = []

    def elsewhere(task: Callable[[str], Piece], names: Sequence[str], jobs: int, /) -> Iterator[Piece]:
        seen.append(jobs)
        for name in reversed(names):
            _sent(task)(name)
            yield _sent(_sent(task)(name))

    out = Output(tmp_path, mapper=elsewhere)
    found = out.map(NAMES, partial(write, "b"), jobs=3, keep_going=True)
    assert seen == [3] and list(found.values) == ["a", "c", "d"] and list(found.errors) == ["b"]
    with pytest.raises(PlopError, match="It cannot be read"):
        out.map(NAMES, partial(write, "b"))


def _sent(thing: Sent) -> Sent:
    """As another process gets it."""
    sent: Sent = pickle.loads(pickle.dumps(thing))  # noqa: S301 - of its own making
    return sent


def test_one_job_stays_in_this_process_and_two_do_not(tmp_path: Path) -> None:
    for jobs, here in ((1, True), (2, False)):
        folder = tmp_path / str(jobs)
        folder.mkdir()
        numbers = set(Output(folder).map(NAMES[:2], _own_number, jobs=jobs).values.values())
        assert (os.getpid() in numbers) == here


def _own_number(name: str, out: Output) -> int:
    return os.getpid()


def test_processes_are_as_many_as_memory_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("joblib.effective_n_jobs", lambda jobs: 64 if jobs < 0 else jobs)
    for free, count in ((3_500_000_000, 3), (1, 1), (None, 10)):
        monkeypatch.setattr("plop.pipeline.mapping.available_bytes", lambda free=free: free)
        assert mapping.processes(-1, 10) == count
        assert mapping.processes(5, 10) == 5  # the user's own choice


def test_a_killed_run_keeps_what_was_finished_and_leaves_no_process(tmp_path: Path) -> None:
    program = (
        "from pathlib import Path; from tests.pipeline.test_mapping import *; "
        f"Output(Path({str(tmp_path)!r})).map(NAMES, slow, jobs=2)"
    )
    parent = subprocess.Popen([sys.executable, "-c", program], cwd=REPOSITORY)
    end = time.monotonic() + 60
    while not (tmp_path / "d.started").is_file() or not all((tmp_path / ".done" / name).exists() for name in "abc"):
        assert parent.poll() is None and time.monotonic() < end
        time.sleep(0.05)
    worker = int((tmp_path / "d.started").read_text())
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    while Path(f"/proc/{worker}/stat").exists() and "Z" not in Path(f"/proc/{worker}/stat").read_text().split()[2]:
        assert time.monotonic() < end, "the worker outlived the run"
        time.sleep(0.1)
    assert [Output(tmp_path).is_done(name) for name in NAMES] == [True, True, True, False]


def test_processes_that_a_killed_run_has_just_started_end_too(tmp_path: Path) -> None:
    """They find their parent gone when they have read their first line."""
    program = (
        "from pathlib import Path; from tests.pipeline.test_mapping import *; "
        f"Output(Path({str(tmp_path)!r})).map(NAMES, slow, jobs=3)"
    )
    parent = subprocess.Popen([sys.executable, "-c", program], cwd=REPOSITORY, stderr=subprocess.DEVNULL)
    end = time.monotonic() + 60
    started: list[Path] = []
    while len(started) < 3:
        assert parent.poll() is None and time.monotonic() < end
        children = Path(f"/proc/{parent.pid}/task/{parent.pid}/children").read_text().split()
        processes = [Path("/proc") / child for child in children]
        started = [each for each in processes if b"popen_loky" in (each / "cmdline").read_bytes()]
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    while any(each.exists() and "Z" not in (each / "stat").read_text().split()[2] for each in started):
        assert time.monotonic() < end, "a process outlived the run"
        time.sleep(0.1)


def test_what_no_plop_error_explains_is_raised(tmp_path: Path) -> None:
    for jobs in (1, 2):
        with pytest.raises(json.JSONDecodeError):
            Output(tmp_path).map(NAMES[:2], _broken, jobs=jobs, keep_going=True)


def test_a_piece_that_fails_stops_the_others_without_a_word_of_its_helpers(tmp_path: Path) -> None:
    program = (
        "from pathlib import Path; from tests.pipeline.test_mapping import *; "
        f"Output(Path({str(tmp_path)!r})).map([*'abcdefgh'], partial(write, 'a'), jobs=2)"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "It cannot be read." in done.stderr and "Warning" not in done.stderr


def _broken(name: str, out: Output) -> None:
    json.loads("{")


@pytest.mark.parametrize("command", ["ingest mesh {folder}/raw", "calibrate", "fuse", "fit-init"])
def test_one_process_makes_what_several_made(finished: Path, tmp_path: Path, command: str) -> None:
    """The finished workspace was made by as many processes as there are cores."""
    jobs = "2" if effective_n_jobs(-1) == 1 else "1"
    assert _made(finished, tmp_path / jobs, command, jobs) == _content(finished, command)


@pytest.mark.parametrize("commands", [["filter --split all"], ["rollout --split all", "eval"]])
def test_the_number_of_processes_changes_no_digit(finished: Path, tmp_path: Path, commands: list[str]) -> None:
    one, two = ([_made(finished, tmp_path / jobs, command, jobs) for command in commands] for jobs in ("1", "2"))
    assert one == two


def _made(finished: Path, folder: Path, command: str, jobs: str) -> dict[str, str]:
    """Run a command in a copy of the workspace, which later commands go on with."""
    words = command.format(folder=folder).split()
    if not folder.exists():
        shutil.copytree(finished, folder)
    shutil.rmtree(folder / "artifacts" / words[0])
    assert main([*words, "--jobs", jobs, "-w", str(folder), "-q"]) == 0
    return _content(folder, command)


def _content(folder: Path, command: str) -> dict[str, str]:
    manifest = Store(folder).find(f"{command.split()[0]}@latest").manifest
    return {"fingerprint": manifest.fingerprint, **content_files(manifest)}
