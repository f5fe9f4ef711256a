"""Stages on a Dask cluster: the same artifacts as without one, and a lost worker costs what it was at."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from plop.artifacts.store import Store
from plop.errors import PlopError
from plop.pipeline.cluster import runner
from plop.pipeline.execute import Outcome, execute
from plop.pipeline.listener import Silent
from plop.pipeline.registry import StageRef
from plop.pipeline.tasks import Task
from plop_cli.app import main
from tests.pipeline import fake_stages as fake

distributed = pytest.importorskip("distributed")
REPOSITORY = Path(__file__).resolve().parents[2]
INGEST, FUSE, FIT, FULL_DISK, MAPPED, HANDS_OUT = (
    StageRef(name.lower(), f"tests.pipeline.fake_stages:{name}", "")
    for name in ("INGEST", "FUSE", "FIT", "FULL_DISK", "MAPPED", "HANDS_OUT")
)


@pytest.fixture(scope="module")
def cluster() -> Iterator[object]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(REPOSITORY))
        with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50, host="127.0.0.1"
        ) as made:
            yield made


def tasks(folder: Path, environments: tuple[str, ...] = ("blocks", "rolls"), **settings: float) -> dict[str, Task]:
    """Plan recordings, clouds and fits of several environments; fits are by environment."""
    found = {}
    for name in environments:
        raw = fake.raw_folder(folder / name, f"{name} ")
        first = Task(INGEST, fake.PiecesConfig(**settings), {"raw": raw}, about=name)  # type: ignore[arg-type]
        clouds = Task(FUSE, fake.JoinConfig(), {"recordings": first}, about=name)
        found[name] = Task(FIT, fake.JoinConfig(), {"recordings": first, "clouds": clouds}, about=name, name=name)
    return found


def contents(folder: Path) -> dict[str, dict[str, str]]:
    return {"@".join(a.key): a.manifest.files for a in Store(folder).artifacts()}


def carried_out(folder: Path, planned: dict[str, Task], scheduler: str | None, **options: bool) -> dict[Task, object]:
    with runner(Store(folder), lambda _: Silent(), scheduler=scheduler, **options) as carries_out:
        return dict(carries_out.run(planned.values()))


def test_two_workers_make_what_none_make(cluster, tmp_path):
    alone, spread = tmp_path / "alone", tmp_path / "spread"
    carried_out(alone, tasks(alone), None)
    outcomes = carried_out(spread, tasks(spread), cluster.scheduler_address)
    assert len(outcomes) == 6 and all(isinstance(one, Outcome) and not one.skipped for one in outcomes.values())
    assert contents(spread) == contents(alone) and len(contents(alone)) == 6
    assert Store(spread).names() == Store(alone).names()
    again = carried_out(spread, tasks(spread), cluster.scheduler_address)
    assert all(isinstance(one, Outcome) and one.skipped for one in again.values())


def test_a_failure_stops_only_what_needs_it(cluster, tmp_path):
    for place, scheduler in (("alone", None), ("spread", cluster.scheduler_address)):
        planned = tasks(tmp_path / place)
        first = planned["blocks"].inputs["recordings"]
        planned["broken"] = Task(FULL_DISK, fake.JoinConfig(upper=True), {"recordings": first})
        planned["after"] = Task(FIT, fake.JoinConfig(), {"recordings": first, "clouds": planned["broken"]})
        sources = {"recordings": first, "clouds": planned["broken"]}
        planned["here"] = Task(HANDS_OUT, fake.HandsOutConfig(), sources)  # a stage that needs no worker itself
        planned["last"] = Task(FIT, fake.JoinConfig(upper=True), {"recordings": first, "clouds": planned["here"]})
        outcomes = carried_out(tmp_path / place, planned, scheduler, keep_going=True)
        failed = {name for name, task in planned.items() if isinstance(outcomes[task], PlopError)}
        assert failed == {"broken", "after", "here", "last"}, place
        assert all("disk is full" in str(outcomes[planned[name]]) for name in failed)
        with pytest.raises(PlopError, match="disk is full"):
            carried_out(tmp_path / place, planned, scheduler)


def test_a_lost_worker_costs_what_it_was_at(cluster, tmp_path):
    alone, spread = tmp_path / "alone", tmp_path / "spread"
    carried_out(alone, tasks(alone, ("blocks",), pieces=5), None)
    slow = tasks(spread, ("blocks",), pieces=5, pause_s=0.4)
    results: list[object] = []
    thread = threading.Thread(
        target=lambda: results.append(carried_out(spread, slow, cluster.scheduler_address)), daemon=True
    )
    thread.start()
    lock = wait_for(lambda: next(iter(spread.glob("artifacts/.locks/ingest-*")), None))
    wait_for(lambda: len(list(spread.glob("artifacts/ingest/.partial-*/.done/*"))) >= 2)
    log = next(iter(spread.glob("artifacts/ingest/.partial-*"))) / "attempts.log.tmp"
    before = log.read_text().split()
    os.kill(int(lock.read_text().split("\n")[0]), signal.SIGKILL)
    wait_for(lambda: not log.exists() or len(log.read_text().split()) > len(before))
    if log.exists():
        assert log.read_text().split().count("piece_0") == 1, "it went on, and did not begin again"
    thread.join(timeout=60)
    assert results and all(isinstance(one, Outcome) for one in results[0].values())  # type: ignore[attr-defined]
    made, expected = contents(spread), contents(alone)
    assert [files for key, files in sorted(made.items())] and len(made) == len(expected) == 3
    assert {json.dumps(f) for f in made.values()} == {json.dumps(f) for f in expected.values()}
    assert not list(spread.glob("artifacts/*/.partial-*")) and not list(spread.glob("artifacts/.locks/*"))


def wait_for(condition: object, seconds: float = 60.0) -> Path:
    end = time.monotonic() + seconds
    while not (found := condition()):  # type: ignore[operator]
        assert time.monotonic() < end, "it took too long"
        time.sleep(0.02)
    return found  # type: ignore[no-any-return]


def test_a_stage_that_hands_out_its_own_work_runs_here(cluster, tmp_path):
    first = tasks(tmp_path, ("blocks",))["blocks"].inputs["recordings"]
    clouds = Task(FUSE, fake.JoinConfig(), {"recordings": first})
    outcomes = carried_out(
        tmp_path,
        {"": Task(HANDS_OUT, fake.HandsOutConfig(), {"recordings": first, "clouds": clouds})},
        cluster.scheduler_address,
    )
    (artifact,) = [one.artifact for task, one in outcomes.items() if task.ref is HANDS_OUT]  # type: ignore[attr-defined]
    told = artifact.manifest.summary["figures"]
    assert told == {"process": os.getpid(), "scheduler": cluster.scheduler_address}


def test_episodes_go_to_all_workers(cluster, tmp_path):
    """From within a run on a worker, which takes part in the work meanwhile."""
    wait_for(lambda: len(cluster.scheduler_info["workers"]) == 2)  # one may have been lost before
    raw = fake.raw_folder(tmp_path / "blocks")
    task = Task(MAPPED, fake.PiecesConfig(pieces=6, pause_s=0.2), {"raw": raw})
    outcome = carried_out(tmp_path, {"": task}, cluster.scheduler_address)[task]
    assert isinstance(outcome, Outcome)
    found = [path.read_text() for path in sorted(outcome.artifact.path.glob("piece_*"))]
    assert len(found) == 6 and len(set(found)) == 2, "both workers wrote some"
    with distributed.Client(cluster.scheduler_address) as client:
        watched = client.run(lambda dask_worker: dask_worker.periodic_callbacks["profile"].is_running())
    assert list(watched.values()) == [False, False], "a profiler would change the bytes of HDF5 files"


def test_a_workspace_that_workers_do_not_see_is_told(cluster, tmp_path):
    store = Store(tmp_path)
    with runner(store, lambda _: Silent(), scheduler=cluster.scheduler_address) as carries_out:
        store.workspace = Path("/nowhere/to/be/seen")
        task = Task(INGEST, fake.PiecesConfig(), {"raw": fake.raw_folder(tmp_path / "blocks")})
        with pytest.raises(PlopError, match="does not see the workspace") as caught:
            list(carries_out.run([task]))
    assert "cluster.md" in str(caught.value.fix)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://127.0.0.1:1", "nonsense"])
def test_a_scheduler_that_is_not_there_is_told_within_seconds(tmp_path, capsys, address):
    raw = fake.raw_folder(tmp_path / "raw")
    (raw / "prism_jelly_000.npz").touch()
    store = Store(tmp_path / "ws")
    fake_raw = fake.raw_folder(tmp_path / "blocks")
    execute(fake.INGEST, store=store, inputs={"raw": fake_raw})
    for words in (["run", "fuse"], ["reproduce", str(raw), "--env", "prism-jelly"]):
        began = time.monotonic()
        assert main([*words, "-w", str(store.workspace), "--scheduler", address]) == 1
        seen = capsys.readouterr().err
        assert "scheduler cannot be reached" in seen and address in seen and "leave --scheduler out" in seen
        assert time.monotonic() - began < 30
    assert len(store.artifacts()) == 1
