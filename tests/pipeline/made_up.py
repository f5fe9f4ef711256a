"""Artifacts that only say what they were made from, for tests of what is found and planned."""

from __future__ import annotations

from pathlib import Path

from plop.artifacts.store import Artifact, Store
from plop.pipeline.execute import execute
from plop.pipeline.registry import StageRef
from plop.pipeline.stage import InputSpec, Stage
from plop.pipeline.tasks import Task
from plop.pipeline.upstream import Planner
from tests.pipeline import fake_stages as fake


def made(store: Store, name: str, seed: int = 0, **inputs: Artifact) -> Artifact:
    """Make an artifact of a stage from others."""
    specs = {key: InputSpec((a.key[0],), "") for key, a in inputs.items()}
    stage = Stage(name, 1, "", fake.PiecesConfig, specs, fake.FIT.run)
    addresses = {key: a.address for key, a in inputs.items()}
    return execute(stage, store=store, config=fake.PiecesConfig(seed=seed), inputs=addresses).artifact


def recordings(store: Store, name: str, **settings: int) -> Artifact:
    """Make recordings of an environment."""
    raw = fake.raw_folder(store.workspace / name, f"{name} ")
    return execute(fake.INGEST, store=store, config=fake.PiecesConfig(**settings), inputs={"raw": raw}).artifact


def ref_to(stage: Stage) -> StageRef:
    """Refer to a stage that stands in no list."""
    ref = StageRef(stage.name, "", "")
    object.__setattr__(ref, "load", lambda: stage)
    return ref


def planned(store: Store, stage: Stage, config: object = None, **named: Artifact | str | Path) -> Task:
    """Plan a stage with what is named."""
    given = {key: value.address if isinstance(value, Artifact) else value for key, value in named.items()}
    return Planner(store).task(ref_to(stage), stage.config() if config is None else config, given)


def told(task: Task) -> dict[str, object]:
    """Spell the inputs of a task: addresses, and the commands of what would be made."""

    def one(value: object) -> object:
        if isinstance(value, tuple):
            return [one(each) for each in value]
        return value.ref.command if isinstance(value, Task) else value.address if isinstance(value, Artifact) else value

    return {name: one(value) for name, value in task.inputs.items()}
