"""How far the half that is not pushed moves: `python -m studies.resting_half WORKSPACE [ENVIRONMENT ...]`.

Reads the simulator's true nodes of the part recordings of a workspace (`make reproduce` makes one). What a blade throws
aside in some recordings and leaves alone in others, with the same first frame and the same kind of motion, no model can
tell beforehand.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import torch

from benchmarks.workspace import latest
from plop.artifacts.store import Store
from plop.dynamics.episodes import Actions
from plop.dynamics.sides import advance_sides
from plop.recordings.set import RecordingSet
from plop.recordings.truth import Truth
from plop_cli.results_file import is_part


def halves_mm(recordings: RecordingSet, name: str) -> tuple[float, float]:
    """Mean distance that the nodes of each half have moved at the end: the half that moved less, the other [mm]."""
    with recordings.open(name) as recording, Truth(recordings.path(name)) as truth:
        steps = list(Actions.of(recording).steps())
        side = torch.zeros(len(truth.nodes_m(0)))
        for frame, action in enumerate(steps):
            side = advance_sides(side, torch.from_numpy(np.asarray(truth.nodes_m(frame + 1))).float(), action)
        moved = 1000 * np.linalg.norm(np.asarray(truth.nodes_m(len(steps))) - np.asarray(truth.nodes_m(0)), axis=1)
    found = sorted(float(moved[side.numpy() == half].mean()) for half in (-1, 1))
    return found[0], found[1]


def line(recordings: RecordingSet, environment: str) -> str:
    """Give one environment's line of the table: resting half / pushed half of each part recording."""
    cells = []
    for names in (recordings.train, recordings.test):
        found = [halves_mm(recordings, name) for name in names if is_part(name)]
        cells.append(" ".join(f"{rest:.1f}/{pushed:.0f}" for rest, pushed in found))
    return f"| {environment} | {cells[0]} | {cells[1]} |"


def main(workspace: Path, environments: list[str]) -> None:
    """Print the table."""
    store = Store(workspace)
    known = sorted({a.manifest.environment for a in store.artifacts("calibrate")})
    sys.stdout.write("| environment | training: resting/pushed half [mm] | test |\n|---|---|---|\n")
    for environment in environments or known:
        recordings = RecordingSet.load(latest(store, "calibrate", environment).path)
        sys.stdout.write(line(recordings, environment) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
