"""Tables of the model beside its peers."""

from __future__ import annotations

from typing import Any

from markdown_parts import rows
from result_files import Table, read


def _scores(columns: str, of: str) -> str:
    from benchmarks.peers import score

    found = {name: table for name, table in read("peers")["environments"].items() if of in next(iter(table.values()))}
    shown = score.columns_of(found.values(), getattr(score, columns))
    lines = []
    for environment, table in found.items():
        for line in score.table_to_markdown(table, shown).splitlines()[2:]:
            lines.append([environment, *(cell.strip() for cell in line.strip("|").split("|"))])
    return rows(["environment", "model", "n", "seeds", *shown.values()], lines)


def _training() -> str:
    lines: list[list[Any]] = []
    for environment, models in read("peers")["training"].items():
        for name, facts in models.items():
            times = [f"{facts[key]:.0f}" if key in facts else "" for key in ("training_step_ms", "rollout_step_ms")]
            lines.append([environment, name, f"{facts['parameters']:,}", facts["steps"], *times])
    return rows(
        [
            "environment",
            "model",
            "parameters",
            "training steps",
            "ms of one (CPU; one frame: a shared GPU)",
            "ms of a step of a rollout",
        ],
        lines,
    )


def _scaling(name: str) -> str:
    from benchmarks.peers.score import scaling_to_markdown

    return scaling_to_markdown(read("peers")[name])


PEERS = ("peers",)
TABLES: dict[str, Table] = {
    "peers-pipeline": (lambda: _scores("PIPELINE_COLUMNS", "cd_mm"), PEERS),
    "peers-particles": (lambda: _scores("PARTICLE_COLUMNS", "mean_l2_mm"), PEERS),
    "peers-training": (_training, PEERS),
    "peers-scaling": (lambda: _scaling("scaling"), PEERS),
    "peers-scaling-gpu": (lambda: _scaling("scaling-cuda"), PEERS),
}
"""Name in `[[table NAME]]` -> what makes the table, and the files that it shows."""
