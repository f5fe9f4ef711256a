"""Make the runs of a plan that are lacking: one row a file, so that a stopped benchmark goes on where it was.

A new version of `diagnose` does not empty the tables: a run that it has not judged yet keeps the row of an older one,
with the version that gave it.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from benchmarks.missing_physics.plan import Run
from benchmarks.missing_physics.row import Group, Row
from plop.artifacts.atomic_file import write_json
from plop.artifacts.lock import locked
from stages.diagnose.stage import STAGE


class Benchmark(Protocol):
    """Hides things in one way of measuring them: followed points, or cameras."""

    work: Path
    """Where it keeps what it makes."""
    plan: Sequence[Run]

    def prepare(self) -> None:
        """Fit the base to recordings in which nothing is hidden, once."""

    def carry_out(self, run: Run, earlier: Row | None) -> Row:
        """Hide, diagnose and score; what is hidden is compared with the verdict only afterwards.

        Args:
            run: Which.
            earlier: The row of an older version of `diagnose`; what it hid is hidden again.
        """


def stored_rows(path: Path) -> dict[str, Row]:
    """Give the rows of a result file by their names; none where there is no file."""
    rows = map(Row.from_json, json.loads(path.read_text())["runs"]) if path.is_file() else ()
    return {row.name: row for row in rows}


def newest_rows(names: Iterable[str], folder: Path, stored: Mapping[str, Row]) -> list[Row]:
    """Give the rows that there are, in order: the folder's before the stored ones."""
    rows = []
    for name in names:
        path = folder / f"{name}.json"
        if path.is_file():
            rows.append(Row.from_json(json.loads(path.read_text())))
        elif name in stored:
            rows.append(stored[name])
    return rows


def is_judged(name: str, folder: Path, stored: Mapping[str, Row]) -> bool:
    """Tell whether a run's row lies in the folder, or is stored by the present version of `diagnose`."""
    return (folder / f"{name}.json").is_file() or (name in stored and stored[name].judged_by == STAGE.version)


def shared(runs: Sequence[Run], share: str) -> list[Run]:
    """Give what the K-th of N processes takes: every N-th, for the share "K/N"."""
    number, of = map(int, share.split("/"))
    return list(runs[number - 1 :: of])


def go_on(benchmark: Benchmark, runs: Iterable[Run], stored: Mapping[str, Row], minutes: float) -> None:
    """Prepare, and make runs that this version has not judged; none is started after so many minutes.

    What could not be given a signal is not tried again.
    """
    deadline, folder = time.monotonic() + 60 * minutes, benchmark.work / "rows"
    folder.mkdir(parents=True, exist_ok=True)
    with locked(benchmark.work / "base.lock"):
        benchmark.prepare()
    for run in runs:
        earlier = stored.get(run.name)
        if is_judged(run.name, folder, stored) or (earlier and earlier.set is Group.UNREACHABLE):
            continue
        if time.monotonic() >= deadline:
            break
        started = time.perf_counter()
        row = replace(benchmark.carry_out(run, earlier), judged_by=STAGE.version)
        row = replace(row, seconds=round(time.perf_counter() - started, 1))
        write_json(folder / f"{run.name}.json", row.to_json(), sort_keys=False)
        sys.stdout.write(f"{row.name}: {row.verdict} {row.named} (SNR {row.snr:.2f})\n")
        sys.stdout.flush()


def unreachable(run: Run) -> Row:
    """Give the row of a run whose law cannot move the object enough."""
    hidden: dict[str, dict[str, float]] = {name: {} for name, _ in run.hidden}
    return Row(run.name, Group.UNREACHABLE, run.seed, hidden, 0.0, "-", wanted=run.snr)
