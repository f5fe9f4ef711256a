"""Episodes side by side: the same files as one after the other, nothing lost, everybody told."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from plop.artifacts.manifest import content_files
from plop.artifacts.store import Store
from plop.errors import PlopError
from plop.pipeline.parallel import each_piece, every_piece  # noqa: F401 - named in a program
from plop.pipeline.stage import Output
from plop_cli.app import main

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


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_piece_is_made_once_and_its_error_told(tmp_path: Path, jobs: int) -> None:
    told: list[tuple[float, float]] = []
    out = Output(tmp_path, lambda done, total, label="", **figures: told.append((done, total)))
    (tmp_path / "a").write_text("made before")
    out.mark_done("a")
    found = dict(each_piece(partial(write, "c"), NAMES, out, jobs=jobs))
    assert set(found) == set(NAMES) and [name for name in NAMES if found[name] is not None] == ["c"]
    error = found["c"]
    assert error is not None and (error.where, error.expected, error.found) == ("c", "a file", "none")
    assert [(tmp_path / name).read_text() for name in "abd"] == ["made before", "b", "d"]
    assert [out.is_done(name) for name in NAMES] == [True, True, False, True]
    assert all(total == 4 and 0 <= done <= 4 for done, total in told) and told[-1][0] == 4
    assert [done for done, _ in told] == sorted(done for done, _ in told)
    again = dict(each_piece(partial(write, ""), NAMES, out, jobs=jobs))
    assert again == dict.fromkeys(NAMES) and (tmp_path / "c").read_text() == "c"


def test_one_job_stays_in_this_process_and_two_do_not(tmp_path: Path) -> None:
    for jobs, here in ((1, True), (2, False)):
        folder = tmp_path / str(jobs)
        folder.mkdir()
        list(each_piece(partial(_own_number), NAMES[:2], Output(folder), jobs=jobs))
        numbers = {int((folder / name).read_text()) for name in NAMES[:2]}
        assert (os.getpid() in numbers) == here


def _own_number(name: str, out: Output) -> None:
    (out.path / name).write_text(str(os.getpid()))


def test_a_killed_run_keeps_what_was_finished_and_leaves_no_process(tmp_path: Path) -> None:
    program = (
        "from pathlib import Path; from tests.pipeline.test_parallel import *; "
        f"list(each_piece(slow, NAMES, Output(Path({str(tmp_path)!r})), jobs=2))"
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


def test_what_no_plop_error_explains_is_raised(tmp_path: Path) -> None:
    for jobs in (1, 2):
        with pytest.raises(json.JSONDecodeError):
            list(each_piece(_broken, NAMES[:2], Output(tmp_path), jobs=jobs))


def test_a_piece_that_fails_stops_the_others_without_a_word_of_its_helpers(tmp_path: Path) -> None:
    program = (
        "from pathlib import Path; from tests.pipeline.test_parallel import *; "
        f"every_piece(partial(write, 'a'), [*'abcdefgh'], Output(Path({str(tmp_path)!r})), jobs=2)"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "It cannot be read." in done.stderr and "Warning" not in done.stderr


def _broken(name: str, out: Output) -> None:
    json.loads("{")


@pytest.mark.parametrize("words", [["fit-init"], ["filter", "--split", "all"], ["eval"]])
def test_the_number_of_processes_changes_no_digit(finished: Path, tmp_path: Path, words: list[str]) -> None:
    made = []
    for jobs in ("1", "2"):
        folder = tmp_path / jobs
        shutil.copytree(finished, folder)
        shutil.rmtree(folder / "artifacts" / words[0])
        assert main([*words, "--jobs", jobs, "-w", str(folder), "-q"]) == 0
        made.append(Store(folder).find(f"{words[0]}@latest").manifest)
    assert made[0].fingerprint == made[1].fingerprint
    assert content_files(made[0]) == content_files(made[1])
