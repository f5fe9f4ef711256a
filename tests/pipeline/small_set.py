"""A raw recording set small enough to run every stage on within seconds: a box is cut and pulled apart."""

from __future__ import annotations

from pathlib import Path

from plop.recordings.readers.mesh.sequence import write_mesh_sequence
from tests.support.box_sequence import box_sequence

SMALL = [
    "fit-init.count=120",
    "fit-init.steps=40",
    "fit-init.tool_count=20",
    "train.track_steps=6",
    "train.image_steps=2",
    "train.horizon=2",
    "train.validate_every=4",
    "train.update.iterations=3",
    "train.network.width=4",
    "train.network.cells_across=4",
    "eval.threads=1",
]
"""--set options of the small workspace, for commands that run the whole pipeline."""

COMMANDS = ("ingest mesh", "calibrate", "fuse", "fit-init", "train", "filter", "rollout", "eval")

SETTINGS = """
[ingest.mesh]
test = ["box_002"]

[ingest.mesh.cameras]
size = 40
count = 4
supersample = 1

[fit-init]
count = 120
steps = 40
tool_count = 20

[train]
track_steps = 6
image_steps = 2
horizon = 2
validate_every = 4
checkpoint_every = 2
update.iterations = 3
network.width = 4
network.cells_across = 4

[filter]
split = "test"
update.iterations = 3

[eval]
threads = 1
"""
"""plop.toml of the small workspace."""


def make_workspace(folder: Path) -> Path:
    """Write raw data and settings; gives the raw folder."""
    raw = folder / "raw"
    raw.mkdir(parents=True)
    for number, gap_m in enumerate((0.015, 0.02, 0.025)):
        write_mesh_sequence(raw, box_sequence(f"box_{number:03d}", frames=5, gap_m=gap_m))
    (folder / "plop.toml").write_text(SETTINGS)
    return raw


def arguments(command: str, folder: Path) -> list[str]:
    """Give what the user types for one stage."""
    raw = [str(folder / "raw")] if command.startswith("ingest") else []
    return [*command.split(), *raw, "-w", str(folder)]
