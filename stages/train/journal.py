"""The log of a training run: log.jsonl (one JSON object per step), and the same for TensorBoard if installed.

When a run resumes, entries after the checkpoint are discarded, so that no step is logged twice.
"""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from plop.artifacts.atomic_file import write_text
from plop.artifacts.layouts import Model


class Journal:
    """Writes one line per step."""

    def __init__(self, file: Any, board: Any) -> None:
        self._file = file
        self._board = board

    @classmethod
    @contextmanager
    def open(cls, folder: Path, from_step: int, *, enabled: bool) -> Iterator[Journal]:
        """Open the log of a folder to resume at a step.

        Args:
            folder: Folder of log.jsonl and tensorboard/.
            from_step: First step to log; later lines are discarded.
            enabled: A disabled journal writes nothing.
        """
        if not enabled:
            yield cls(None, None)
            return
        path = Model(folder).log
        kept = [line for line in _lines(path) if line["step"] < from_step]
        write_text(path, "".join(json.dumps(line) + "\n" for line in kept))
        board = _board(folder, from_step)
        with path.open("a", buffering=1) as file:
            try:
                yield cls(file, board)
            finally:
                if board is not None:
                    board.close()

    def write(self, step: int, loss: float, terms: dict[str, float]) -> None:
        """Log one step: the loss, its terms, counts of Gaussians, splits and merges per frame."""
        if self._file is None:
            return
        rounded = {name: float(f"{value:.6g}") for name, value in terms.items()}
        self._file.write(json.dumps({"step": step, "loss": float(f"{loss:.6g}"), **rounded}) + "\n")
        if self._board is None:
            return
        self._board.add_scalar("loss", loss, step)
        for name, value in terms.items():
            self._board.add_scalar(name, value, step)


def _board(folder: Path, from_step: int) -> Any:
    """Open TensorBoard's writer; None where the package is not installed (extra `tensorboard`)."""
    if importlib.util.find_spec("tensorboard") is None:
        return None
    from torch.utils.tensorboard import SummaryWriter

    return SummaryWriter(str(Model(folder).board), purge_step=from_step)


def _lines(path: Path) -> list[dict[str, Any]]:
    if not path.is_file():
        return []
    found = []
    for line in path.read_text().splitlines():
        try:
            found.append(json.loads(line))
        except ValueError:
            break  # A killed run may leave an incomplete line.
    return found
