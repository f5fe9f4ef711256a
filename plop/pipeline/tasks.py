"""Planned runs with their dependencies: listed, run sequentially, or sent to a cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from plop.artifacts.lineage import LEFT_OUT
from plop.artifacts.store import Artifact, Store
from plop.errors import PlopError
from plop.pipeline.execute import Outcome, execute
from plop.pipeline.listener import Listener
from plop.pipeline.registry import StageRef


@dataclass(eq=False)
class Task:
    """One planned run."""

    ref: StageRef
    config: Any
    inputs: Mapping[str, Need]
    """Every input of the stage; None for one that is left out."""
    there: Artifact | None = None
    """Its artifact, where it exists already."""
    name: str | None = None
    """Name for the artifact."""
    force: bool = False
    """Make it again although it exists."""
    about: str = ""
    """What distinguishes it from similar tasks, e.g. an environment."""

    @property
    def before(self) -> list[Task]:
        """The tasks that make its inputs."""
        return [one for value in self.inputs.values() for one in needs(value) if isinstance(one, Task)]

    @property
    def waits(self) -> bool:
        """Whether one of its inputs is still to be made, so that its address is not known yet."""
        return any(task.there is None for task in self.before)


Need = Task | Artifact | Path | tuple[Task | Artifact, ...] | None
"""An input of a task: the task that makes it, the artifact, a raw path, several of these, or None."""

Finished = Iterator[tuple[Task, Outcome | PlopError]]


def needs(value: Need) -> tuple[Task | Artifact, ...]:
    """Return the tasks and artifacts of an input."""
    return value if isinstance(value, tuple) else (value,) if isinstance(value, (Task, Artifact)) else ()


def there(need: Task | Artifact) -> Artifact | None:
    """Return the artifact, where it exists already."""
    return need.there if isinstance(need, Task) else need


def in_order(tasks: Iterable[Task]) -> list[Task]:
    """List tasks and their dependencies, each once, each after its dependencies."""
    found: dict[Task, None] = {}

    def visit(task: Task) -> None:
        if task not in found:
            for other in task.before:
                visit(other)
            found[task] = None

    for task in tasks:
        visit(task)
    return list(found)


def addresses(task: Task, made: Mapping[Task, str]) -> dict[str, Any]:
    """Return the inputs of a task as arguments of `execute`; `made`: the artifact of each task that it waits for."""

    def spelt(one: Task | Artifact) -> Any:
        return made[one] if isinstance(one, Task) else "@".join(one.key)

    found: dict[str, Any] = {}
    for name, value in task.inputs.items():
        several = [spelt(one) for one in needs(value)]
        found[name] = several if isinstance(value, tuple) else several[0] if several else value
    return found


def given(inputs: Mapping[str, Any]) -> dict[str, str | Path]:
    """Write inputs whose tasks are done as the user would: addresses, separated by commas, or "none"."""
    return {
        name: LEFT_OUT if value is None else ",".join(value) if isinstance(value, list) else value
        for name, value in inputs.items()
    }


@dataclass
class Runner:
    """Runs tasks sequentially in this process."""

    store: Store
    listener: Callable[[Task], Listener]
    """Returns the listener of a task."""
    keep_going: bool = False
    """Whether a failure stops only what needs it."""
    failed: dict[Task, PlopError] = field(default_factory=dict)

    def run(self, tasks: Iterable[Task]) -> Finished:
        """Run tasks and their dependencies; yield each with its outcome or its error.

        Raises:
            PlopError: One fails, unless `keep_going`.
        """
        made: dict[Task, str] = {}
        for task in in_order(tasks):
            error = next((self.failed[other] for other in task.before if other in self.failed), None)
            if error is None:
                try:
                    outcome = self.one(task, given(addresses(task, made)))
                except PlopError as raised:
                    if not self.keep_going:
                        raise
                    error = raised
                else:
                    made[task] = "@".join(outcome.artifact.key)
                    yield task, outcome
            if error is not None:
                self.failed[task] = error
                yield task, error

    def one(self, task: Task, inputs: Mapping[str, str | Path]) -> Outcome:
        """Run one task whose inputs exist."""
        listener, command = self.listener(task), task.ref.command
        with listener.progress(command) as progress:
            outcome = execute(
                task.ref.load(),
                store=self.store,
                config=task.config,
                inputs=inputs,
                command=command,
                name=task.name,
                force=task.force,
                progress=progress,
                on_wait=lambda process: listener.waits(command, process),
                on_start=listener.starts,
            )
        listener.finished(command, outcome)
        return outcome
