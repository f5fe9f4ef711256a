"""Run the fake ingest in a process of its own: `python -m tests.pipeline.slow_run WORKSPACE PAUSE_S`."""

from __future__ import annotations

import sys
from pathlib import Path

from plop.artifacts.store import Store
from plop.pipeline.execute import execute
from tests.pipeline import fake_stages as fake

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    config = fake.PiecesConfig(pieces=6, pause_s=float(sys.argv[2]))
    outcome = execute(
        fake.INGEST,
        store=Store(folder),
        config=config,
        inputs={"raw": folder / "blocks"},
        on_wait=lambda pid: print("waiting", flush=True),
    )
    print("skipped" if outcome.skipped else "ran", flush=True)
