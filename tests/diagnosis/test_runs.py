"""Engine runs: remembered by content, resumed after a kill, the same on any number of processes and on a cluster."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plop.diagnosis.responses import runs as runs_module
from plop.diagnosis.responses.hypotheses import candidates_of
from plop.diagnosis.responses.job import Answer, Job, run_job
from plop.diagnosis.responses.runs import Runs, code_digest, digest
from plop.errors import PlopError
from plop.physics.effects.library import library
from tests.support.coarse_episodes import BASE, coarse_episode

TYPES = library()
COLUMNS = {c.effect: c.columns[0] for c in candidates_of(TYPES)}


def jobs() -> list[Job]:
    episode = coarse_episode(0)
    settings = [(), *(((COLUMNS[name], COLUMNS[name].value),) for name in ("tilt", "stiffness", "viscosity"))]
    return [Job(episode, BASE, setting) for setting in settings]


@pytest.fixture(scope="module")
def expected() -> list[np.ndarray]:
    return [run_job(job, TYPES).points.astype(np.float32) for job in jobs()]


def check(answers: list[Answer], expected: list[np.ndarray]) -> None:
    for answer, points in zip(answers, expected, strict=True):
        np.testing.assert_array_equal(answer.points, points)


@pytest.fixture
def counted(monkeypatch):
    """Count runs, and answer each with its own number instead of simulating."""
    asked: list[Job] = []

    def quick(job: Job, files: tuple[str, ...]) -> Answer:
        asked.append(job)
        return Answer(np.full((2, 3, 3), float(len(job.key)), np.float32))

    monkeypatch.setattr(runs_module, "answer_job", quick)
    return asked


def test_jobs_are_remembered_by_content(tmp_path, counted):
    first = Runs(tmp_path, jobs=1)(jobs())
    assert len(counted) == 4
    again = Runs(tmp_path, jobs=1)
    check(again(jobs()), [a.points for a in first])
    assert (len(counted), again.done) == (4, 0)
    other = replace(jobs()[0], base=replace(BASE, settled=False))
    again([other, jobs()[2]])
    assert (len(counted), again.done) == (5, 1)


def test_a_killed_batch_goes_on_where_it_was(tmp_path, counted, monkeypatch):
    def stop(done: int, total: int, label: str) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Runs(tmp_path, jobs=1, progress=stop)(jobs())
    before = len(counted)
    steps: list[tuple[int, int]] = []
    more = Runs(tmp_path, jobs=1, progress=lambda done, total, label: steps.append((done, total)))
    assert len(more(jobs())) == 4
    assert more.done == 2 and len(counted) == before + 2
    assert steps == [(3, 4), (4, 4)]


def test_progress_says_what_the_runs_are_for(tmp_path, counted):
    said: list[str] = []
    runs = Runs(tmp_path, jobs=1, progress=lambda done, total, label: said.append(label))
    runs(jobs()[:1])
    runs.begin("every law, reference")
    runs(jobs()[1:2])
    name = jobs()[0].episode.name
    assert said == [name, f"every law, reference: {name} {jobs()[1].key}"]


def test_a_file_that_was_cut_short_is_run_again(tmp_path, counted):
    Runs(tmp_path, jobs=1)(jobs())
    files = sorted(tmp_path.glob("*.npz"))
    files[0].write_bytes(files[0].read_bytes()[:100])
    files[1].write_bytes(b"")
    again = Runs(tmp_path, jobs=1)
    again(jobs())
    assert again.done == 2


def test_an_unstable_run_is_an_answer_and_is_remembered(tmp_path, monkeypatch):
    def refuse(*_: object) -> None:
        raise PlopError("The engine's run is unstable.", where="youngs_modulus_pa", found="x")

    monkeypatch.setattr("plop.diagnosis.responses.job.start_particles", refuse)
    runs = Runs(tmp_path, jobs=1)
    for _ in range(2):
        (answer,) = runs(jobs()[:1])
        assert answer.points is None and "unstable" in answer.trouble and "youngs_modulus_pa" in answer.trouble
    assert runs.done == 1


def test_everything_that_decides_the_answer_is_in_its_name():
    job = jobs()[1]
    episode = job.episode
    later = replace(episode, times=episode.times + 0.1)
    others = [
        replace(job, base=replace(BASE, spacing_m=0.011)),
        replace(job, settings=()),
        replace(job, episode=later),
        replace(job, settings=((COLUMNS["tilt"], 0.123),)),
        replace(job, episode=replace(episode, table_z_m=0.1)),
        replace(job, episode=replace(episode, vertices=episode.vertices * 1.01)),
    ]
    assert len({digest(j, "") for j in [job, *others]}) == len(others) + 1
    assert digest(replace(job, episode=replace(episode, name="other")), "") == digest(job, "") != digest(job, "new")


def test_another_engine_and_other_effects_have_other_answers(tmp_path, monkeypatch):
    mine = tmp_path / "mine.py"
    mine.write_text("a = 1")
    before = code_digest(), code_digest([mine])
    assert before[0] != before[1]
    mine.write_text("a = 2")
    assert code_digest([mine]) != before[1] and code_digest() == before[0]
    monkeypatch.setattr(runs_module, "sources_digest", lambda folder: f"changed {folder.name}")
    assert code_digest() != before[0]


def test_the_least_recently_used_answers_go(tmp_path, counted):
    runs = Runs(tmp_path, jobs=1)
    runs(jobs())
    for k, path in enumerate(sorted(tmp_path.glob("*.npz"))):
        os.utime(path, (k, k))
    Runs(tmp_path, jobs=1)(jobs()[:1])  # used again: the newest now
    kept = tmp_path / f"{digest(jobs()[0], code_digest())}.npz"
    runs.forget(kept_bytes=kept.stat().st_size)
    assert list(tmp_path.glob("*.npz")) == [kept]
    Runs(None, jobs=1).forget()


def test_one_and_two_processes_give_the_same(expected):
    check(Runs(jobs=1)(jobs()), expected)
    check(Runs(jobs=2)(jobs()), expected)


def test_the_address_of_a_scheduler_that_cannot_be(tmp_path):
    pytest.importorskip("distributed")
    with pytest.raises(PlopError, match="scheduler cannot be reached") as caught:
        Runs(tmp_path, scheduler="nonsense://127.0.0.1:1")(jobs())
    assert caught.value.where == "nonsense://127.0.0.1:1" and "tcp://" in str(caught.value.expected)


def test_a_cluster_that_loses_a_worker_gives_the_same(tmp_path: Path, expected, monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).resolve().parents[2]))
    many = [
        job
        for k in range(3)
        for job in [
            replace(j, base=replace(BASE, table_cone=cone)) for j in jobs()[k : k + 2] for cone in ("round", "pyramid")
        ]
    ]
    alone = Runs(jobs=1)(many)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50, host="127.0.0.1"
    ) as cluster:
        lost: list[int] = []

        def kill_one(done: int, total: int, label: str) -> None:
            if not lost:
                lost.append(cluster.workers[0].pid)
                os.kill(lost[0], signal.SIGKILL)

        runs = Runs(tmp_path, scheduler=cluster.scheduler_address, progress=kill_one)
        check(runs(many), [a.points for a in alone])
        assert lost and runs.done == len({digest(j, "") for j in many}) or runs.done == len(many)
    check(runs_again(tmp_path, many), [a.points for a in alone])


def runs_again(folder: Path, many: list[Job]) -> list[Answer]:
    """Without any cluster: everything is there."""
    runs = Runs(folder, jobs=1)
    answers = runs(many)
    assert runs.done == 0
    return answers
