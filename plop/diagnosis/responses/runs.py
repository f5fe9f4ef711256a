"""Carry out engine runs in parallel processes, or on a Dask cluster; what is finished survives a kill."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from joblib import Parallel, delayed, parallel_config

from plop.artifacts.atomic_file import whole
from plop.compute.cluster import connected
from plop.compute.kernel_cache import sources_digest
from plop.compute.workers import workers
from plop.diagnosis.responses.hypotheses import run_key
from plop.diagnosis.responses.job import Answer, Job, run_job
from plop.physics.effects.library import library

KEPT_BYTES = 2_000_000_000
"""Answers that are kept for later diagnoses; the least recently used ones go first."""
_PACKAGE = Path(__file__).parents[2]
_CODE = ("physics/engine", "physics/effects", "physics/adapters", "geometry")
_CODE_FILES = ("comparison/engine_run.py", "compute/numba_lanes.py", "diagnosis/responses/job.py")


@dataclass
class Runs:
    """Runs jobs and remembers their answers by content; use it as a function."""

    folder: Path | None = None
    """Where answers are kept, one file a job; nowhere when None. Several diagnoses may share it."""
    effect_files: tuple[str, ...] = ()
    """The user's effect files; every process reads them itself."""
    jobs: int = -1
    """Processes on this machine; -1 is one a core."""
    scheduler: str = ""
    """Address of a Dask scheduler, e.g. tcp://10.0.0.5:8786; this machine's processes when empty."""
    progress: Callable[[int, int, str], None] | None = None
    """Called with (done, total, job) after each job of a batch; the job begins with what the batch is for, if told."""
    done: int = field(default=0, init=False)
    """Engine runs carried out, not counting those that were remembered."""
    _purpose: str = field(default="", init=False)

    def begin(self, purpose: str) -> None:
        """Say what the batches from now on are for, in a few words that stand before each job in the progress."""
        self._purpose = f"{purpose}: "

    def __call__(self, jobs: Sequence[Job]) -> list[Answer]:
        """Answer all jobs, in their order.

        Raises:
            PlopError: The scheduler cannot be reached.
        """
        answers = [self._remembered(job) for job in jobs]
        missing = [k for k, answer in enumerate(answers) if answer is None]
        ready = len(jobs) - len(missing)
        with self._backend():
            lazily = Parallel(n_jobs=self.jobs, return_as="generator", batch_size=1)
            running = lazily(delayed(answer_job)(jobs[k], self.effect_files) for k in missing)
            for k, answer in zip(missing, running, strict=True):
                answers[k] = answer
                self.done += 1
                self._remember(jobs[k], answer)
                ready += 1
                if self.progress is not None:
                    label = f"{self._purpose}{jobs[k].episode.name} {run_key(jobs[k].settings)}"
                    self.progress(ready, len(jobs), label.rstrip())
        return [answer for answer in answers if answer is not None]

    @contextmanager
    def _backend(self) -> Iterator[None]:
        if not self.scheduler:
            with workers():
                yield
            return
        with connected(self.scheduler), parallel_config("dask", wait_for_workers_timeout=60):
            yield

    def _remembered(self, job: Job) -> Answer | None:
        path = self._path(job)
        if path is None or not path.is_file():
            return None
        try:
            with np.load(path, allow_pickle=False) as file:
                answer = Answer(file.get("points"), str(file["trouble"]), float(file["step_s"]))
            os.utime(path)
            return answer
        except (OSError, ValueError, KeyError, EOFError, BadZipFile):  # cut short: run it again
            return None

    def _remember(self, job: Job, answer: Answer) -> None:
        path = self._path(job)
        if path is None:
            return
        arrays = {"trouble": np.array(answer.trouble), "step_s": np.array(answer.step_s)}
        if answer.points is not None:
            arrays["points"] = answer.points.astype(np.float32)
        with whole(path) as scratch, scratch.open("wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]

    def _path(self, job: Job) -> Path | None:
        return None if self.folder is None else self.folder / f"{digest(job, self._code)}.npz"

    @cached_property
    def _code(self) -> str:
        return code_digest(self.effect_files)

    def forget(self, kept_bytes: int = KEPT_BYTES) -> None:
        """Delete the answers that were not used for the longest time until the rest is small enough."""
        total = 0
        for _, size, path in sorted(self._kept(), reverse=True):
            total += size
            if total > kept_bytes:
                path.unlink(missing_ok=True)

    def _kept(self) -> Iterator[tuple[float, int, Path]]:
        """Last use, size and path of every answer, and of what a killed process left half written."""
        for path in [] if self.folder is None else self.folder.glob("*.npz*"):
            try:
                facts = path.stat()
            except FileNotFoundError:  # another diagnosis has just deleted or renamed it
                continue
            yield facts.st_mtime, facts.st_size, path


def answer_job(job: Job, effect_files: tuple[str, ...]) -> Answer:
    """Run one job in whatever process it lands in."""
    answer = run_job(job, library(effect_files))
    # single precision is what a remembered answer has, too: a resumed diagnosis says the same to the last digit
    points = None if answer.points is None else answer.points.astype(np.float32)
    return Answer(points, answer.trouble, answer.step_s)


def code_digest(effect_files: Sequence[str | Path] = ()) -> str:
    """Hash the sources of the engine and of the user's effects: another engine gives other answers."""
    total = hashlib.sha256("".join(sources_digest(_PACKAGE / folder) for folder in _CODE).encode())
    for path in (*(_PACKAGE / name for name in _CODE_FILES), *map(Path, effect_files)):
        total.update(path.read_bytes())
    return total.hexdigest()


def digest(job: Job, code: str) -> str:
    """Name a job by everything that decides its answer; `code` is that of the engine, see `code_digest`."""
    total = hashlib.sha256(f"{code}|{job.base!r}|{job.key}|{job.episode.table_z_m}".encode())
    episode = job.episode
    for array in (
        episode.times,
        episode.points[0],
        episode.vertices,
        episode.faces,
        episode.tool.vertices,
        episode.tool.world_from_tool,
    ):
        total.update(np.ascontiguousarray(array, np.float64).tobytes())
    return total.hexdigest()[:32]
