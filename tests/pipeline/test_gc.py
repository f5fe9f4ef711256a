"""`plop gc`: what nobody needs can go; what has a name, what it is made from and what a run uses stay."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from plop.artifacts.store import Artifact, Store
from plop.errors import PlopError
from plop.pipeline.execute import execute
from plop.pipeline.gc import removable, remove
from plop_cli.app import main
from tests.pipeline import fake_stages as fake

REPOSITORY = Path(__file__).resolve().parents[2]
HOLD = """
import sys, time
from plop.artifacts.store import Store
store = Store(sys.argv[1])
with store.making("fit-init", "ff" * 8, [store.find(address) for address in sys.argv[2:]]):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path)


def ingest(store: Store, pieces: int) -> Artifact:
    raw = fake.raw_folder(store.workspace / "blocks")
    return execute(fake.INGEST, store=store, config=fake.PiecesConfig(pieces=pieces), inputs={"raw": raw}).artifact


def line(store: Store, pieces: int, name: str | None = None) -> list[Artifact]:
    """Make recordings, clouds and a fit; the last bears the name."""
    first = ingest(store, pieces)
    return [
        first,
        *(execute(s, store=store, name=name if s is fake.FIT else None).artifact for s in (fake.FUSE, fake.FIT)),
    ]


def addresses(store: Store) -> set[str]:
    return {one.address for one in removable(store)}


def test_what_was_superseded_can_go_and_the_latest_stays(store):
    old, new = line(store, 3), line(store, 4)
    assert addresses(store) == {a.address for a in old}
    assert all(one.size > 0 and "needed" in one.why for one in removable(store))
    assert [a.key for a in store.artifacts()] == [a.key for a in [*old, *new]], "nothing is removed by looking"
    assert len(remove(store, removable(store))) == 3
    assert [a.key for a in store.artifacts()] == [a.key for a in new] and addresses(store) == set()
    assert not list(store.root.glob("*/.*"))


def test_what_has_a_name_and_what_it_is_made_from_stays(store):
    named, old, _ = line(store, 3, "base"), line(store, 4), line(store, 5)
    assert addresses(store) == {a.address for a in old}
    store.set_name("base", old[1])
    assert addresses(store) == {a.address for a in [*named, old[2]]}


def test_other_environments_and_seeds_stay(store):
    line(store, 3)
    other = fake.raw_folder(store.workspace / "rolls", "rolls ")
    execute(fake.INGEST, store=store, inputs={"raw": other})
    execute(fake.INGEST, store=store, config=fake.PiecesConfig(seed=1), inputs={"raw": other})
    assert addresses(store) == set()


def killed(store: Store, stage: str, name: str) -> Path:
    folder = store.root / stage / name
    (folder / "half").mkdir(parents=True)
    (folder / "half" / "piece").write_text("x" * 1000)
    return folder


def test_what_killed_runs_left_can_go(store):
    (first, *_) = line(store, 3)
    left = [killed(store, "fuse", name) for name in (".partial-" + "ab" * 8, ".gone-" + "cd" * 8)]
    replaced = killed(store, "ingest", f".old-{first.key[1]}")
    goes_back = killed(store, "ingest", ".old-" + "ee" * 8)  # killed between two renames: its next run puts it back
    assert {one.path for one in removable(store)} == {*left, replaced}
    remove(store, removable(store))
    assert goes_back.is_dir() and not any(path.exists() for path in (*left, replaced))
    assert len(store.artifacts()) == 3


def hold(store: Store, *reads: Artifact) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", HOLD, str(store.workspace), *(a.address for a in reads)]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    assert process.stdout is not None and process.stdout.readline() == "held\n"
    return process


def test_what_a_run_that_goes_on_makes_and_reads_stays(store):
    old, _ = line(store, 3), line(store, 4)
    scratch = killed(store, "fit-init", ".partial-" + "ff" * 8)
    process = hold(store, old[1])
    try:
        assert addresses(store) == {old[2].address}, "its scratch folder, its input, and what that is made from stay"
        assert main(["gc", "--delete", "-q", "-w", str(store.workspace)]) == 0
        assert scratch.is_dir() and old[0].path.is_dir() and old[1].path.is_dir() and not old[2].path.exists()
    finally:
        process.send_signal(signal.SIGKILL)
        process.communicate()
    assert {one.path for one in removable(store)} == {scratch, old[0].path, old[1].path}, "a dead run holds nothing"


def test_what_is_taken_up_between_looking_and_removing_stays(store):
    old, _ = line(store, 3), line(store, 4)
    seen = removable(store)
    store.set_name("base", old[1])
    assert [one.address for one in remove(store, seen)] == [old[2].address]


def test_a_run_whose_input_was_removed_as_it_began_is_refused(store):
    old, _ = line(store, 3), line(store, 4)
    remove(store, removable(store))
    with pytest.raises(PlopError, match="removed while the run started"), store.making("fit-init", "ab", [old[1]]):
        raise AssertionError("it began")


def test_a_run_begins_only_once_removing_is_over(store):
    (first, *_) = line(store, 3)
    began = threading.Event()

    def begin() -> None:
        with store.making("fit-init", "ab", [first]):
            began.set()

    with store.removing():
        thread = threading.Thread(target=begin)
        thread.start()
        time.sleep(0.3)
        assert not began.is_set()
    thread.join(timeout=10)
    assert began.is_set()


def test_nothing_goes_where_a_manifest_cannot_be_read(store, capsys):
    old, new = line(store, 3), line(store, 4)
    path = new[2].path / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"schema": 99}))
    scratch = killed(store, "fuse", ".partial-" + "ab" * 8)
    assert [one.path for one in removable(store)] == [scratch]
    assert main(["gc", "-w", str(store.workspace)]) == 0
    assert "is unknown" in capsys.readouterr().err and old[0].path.is_dir()


def test_it_is_listed_first_and_removed_when_asked(store, capsys):
    old, _ = line(store, 3), line(store, 4)
    command = ["gc", "-w", str(store.workspace)]
    assert main(command) == 0
    shown = capsys.readouterr().out
    assert old[0].address in shown and "--delete" in shown and old[0].path.is_dir()
    assert main([*command, "--delete", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["deleted"] and {item["address"] for item in facts["items"]} == {a.address for a in old}
    assert main(command) == 0
    assert "nothing to remove" in capsys.readouterr().out
