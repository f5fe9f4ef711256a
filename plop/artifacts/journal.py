"""The journal: which artifacts were made or requested again, in order; `@latest` and `--dry-run` read it."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path


@dataclass(frozen=True)
class Event:
    """One line of the journal."""

    stage: str
    fingerprint: str
    seconds: float | None
    """Time the stage took [s]; None when the artifact was already there."""


class Journal:
    """An append-only file of JSON lines; damaged or missing lines are skipped."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def append(self, event: Event) -> None:
        """Add one event, in one write."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        try:
            os.write(handle, (json.dumps(asdict(event)) + "\n").encode())
        finally:
            os.close(handle)

    def events(self) -> list[Event]:
        """Read all events, oldest first."""
        try:
            lines = self.path.read_text(encoding="utf-8").splitlines()
        except OSError:
            return []
        found = []
        for line in lines:
            try:
                found.append(Event(**json.loads(line)))
            except (ValueError, TypeError):
                continue
        return found

    def order(self) -> dict[tuple[str, str], int]:
        """Return each (stage, fingerprint) the position of its last event."""
        return {(event.stage, event.fingerprint): place for place, event in enumerate(self.events())}

    def last_seconds(self, stage: str) -> float | None:
        """Return how long the stage took the last time it ran and was not skipped [s]."""
        times = [event.seconds for event in self.events() if event.stage == stage and event.seconds is not None]
        return times[-1] if times else None
