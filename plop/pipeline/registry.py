"""The registry of stages, in order: read from the one list in `stages/__init__.py`.

This package runs stages and imports none of them directly: `REGISTRY` names the list, which is looked up on first
use, and each entry names a module that is imported when its stage runs.
"""

from __future__ import annotations

import importlib
import sys
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from plop.pipeline.stage import Stage

REGISTRY = "stages:PIPELINE"
"""`module:name` of the list of stages, a tuple of `StageRef` in the order of the pipeline."""


@dataclass(frozen=True)
class StageRef:
    """One stage, not yet imported."""

    command: str
    """Command after `plop`, e.g. "ingest disect"."""
    target: str
    """`module:name` of the Stage."""
    help: str
    """One line for `plop --help`."""

    @property
    def name(self) -> str:
        """Name of the stage and of its folder of artifacts."""
        return self.command.split()[0]

    def load(self) -> Stage:
        """Import the stage."""
        stage: Stage = _named(self.target)
        return stage


def _named(target: str) -> Any:
    module, _, name = target.partition(":")
    return getattr(importlib.import_module(module), name)


@cache
def pipeline() -> tuple[StageRef, ...]:
    """Return all stages, none of them imported, in the order of the pipeline."""
    return tuple(_named(REGISTRY))


def commands() -> list[str]:
    """Return the commands of all stages, in the order of the pipeline."""
    return [ref.command for ref in pipeline()]


@cache
def places() -> dict[str, int]:
    """Return the position of each stage in the pipeline, by its name."""
    return {name: place for place, name in enumerate(dict.fromkeys(ref.name for ref in pipeline()))}


def stage_ref(command: str) -> StageRef:
    """Return a stage by its command, e.g. "fit-init" or "ingest disect".

    Raises:
        KeyError: There is none.
    """
    for ref in pipeline():
        if ref.command == command:
            return ref
    raise KeyError(command)


def command_of(stage: Stage) -> str:
    """Return the command of an imported stage; the stage's name when it is not part of the pipeline."""
    for ref in pipeline():
        module, _, name = ref.target.partition(":")
        if getattr(sys.modules.get(module), name, None) is stage:
            return ref.command
    return stage.name
