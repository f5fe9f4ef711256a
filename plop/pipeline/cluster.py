"""Run tasks on a Dask cluster: each stage run is one job, and independent runs are parallel.

Workers see the workspace under the same path, and have the same version of plop. Results are the same as without a
cluster: an artifact is written atomically by the process that makes it. When a worker is lost, its active runs start
again elsewhere and resume from the finished pieces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields, replace
from typing import Any

from plop.artifacts.store import Store
from plop.compute.cluster import connected
from plop.errors import PlopError
from plop.pipeline.cluster_worker import Made, make, plop_version
from plop.pipeline.execute import Outcome
from plop.pipeline.listener import Listener
from plop.pipeline.tasks import Finished, Runner, Task, addresses, given, in_order


@contextmanager
def runner(
    store: Store,
    listener: Callable[[Task], Listener],
    *,
    scheduler: str | None = None,
    keep_going: bool = False,
    trust_effects: bool = False,
) -> Iterator[Runner]:
    """Yield a runner of tasks: this process, or the workers of a Dask scheduler.

    Args:
        store: The workspace.
        listener: Returns the listener of a task.
        scheduler: Address of the scheduler.
        keep_going: Whether a failure stops only what needs it.
        trust_effects: Whether workers run the effect files that came inside a model.

    Raises:
        PlopError: The scheduler does not answer.
    """
    if not scheduler:
        yield Runner(store, listener, keep_going)
        return
    with connected(scheduler) as client:
        store.root.mkdir(parents=True, exist_ok=True)
        yield ClusterRunner(store, listener, keep_going, client=client, trust_effects=trust_effects)


@dataclass
class ClusterRunner(Runner):
    """Runs tasks on the workers of a Dask scheduler."""

    client: Any = None
    """The `distributed.Client`."""
    trust_effects: bool = False

    def run(self, tasks: Iterable[Task]) -> Finished:
        """Run tasks and all that they need; yield each as it finishes.

        Raises:
            PlopError: One fails, unless `keep_going`; or workers or the scheduler are lost.
        """
        from distributed import as_completed

        running: dict[Any, Task] = {}
        made: dict[Task, Any] = {}
        try:
            for task in in_order(tasks):
                if any(other in self.failed for other in task.before) or self._runs_here(task):
                    result = self._here(task, made)
                    if isinstance(result, Outcome):
                        made[task] = Made(result.artifact.key, result.skipped, result.seconds, [])
                    yield task, result
                else:
                    made[task] = self._submitted(task, addresses(task, made))
                    running[made[task]] = task
            if running and not self.client.scheduler_info()["workers"]:
                self.listener(next(iter(running.values()))).warn("the scheduler has no workers yet; waiting for one")
            for future in as_completed(list(running)):
                yield running[future], self._outcome(running[future], future)
        finally:
            with suppress(Exception):  # however this ends, a lost scheduler included: do not wait for the rest
                self.client.cancel([future for future in running if not future.done()], force=True)

    def _runs_here(self, task: Task) -> bool:
        """Return whether a task is done already, or sends its own work to the scheduler."""
        return (task.there is not None and not task.force) or _hands_out(task.config)

    def _here(self, task: Task, made: Mapping[Task, Any]) -> Outcome | PlopError:
        """Run a task in this process, once its inputs are made."""
        try:
            keys = {}
            for other in task.before:
                result = self.failed[other] if other in self.failed else self._result(made[other])
                if isinstance(result, PlopError):
                    raise result
                keys[other] = "@".join(result.key)
            if _hands_out(task.config):
                task.config = replace(task.config, scheduler=self.client.scheduler.address)
            return self.one(task, given(addresses(task, keys)))
        except PlopError as error:
            if not self.keep_going:
                raise
            self.failed[task] = error
            return error

    def _submitted(self, task: Task, inputs: Mapping[str, Any]) -> Any:
        facts = (task.ref, str(self.store.workspace), task.config, task.force, self.trust_effects, plop_version())
        command = task.ref.command.replace(" ", "-")
        return self.client.submit(make, *facts, dict(inputs), key=f"{command}-{task.about}-{id(task):x}", pure=False)

    def _outcome(self, task: Task, future: Any) -> Outcome | PlopError:
        result = self._result(future)
        if isinstance(result, PlopError):
            if not self.keep_going:
                raise result
            self.failed[task] = result
            return result
        artifact = self.store.get(*result.key)
        if artifact is None:
            raise PlopError(
                "A worker made an artifact that is not in the workspace here.",
                where=self.store.workspace,
                expected="@".join(result.key),
                fix="Use a folder that this machine and all workers share under the same path.",
            )
        moved = None if task.name is None else self.store.set_name(task.name, artifact)
        outcome = Outcome(artifact, result.skipped, result.seconds, result.warnings, moved)
        self.listener(task).finished(task.ref.command, outcome)
        return outcome

    def _result(self, future: Any) -> Made | PlopError:
        """Wait for the reports of workers.

        Raises:
            Exception: An error of a worker that is not a PlopError.
        """
        if isinstance(future, Made):
            return future
        error = future.exception()
        if error is None:
            made: Made = future.result()
            return made
        if isinstance(error, PlopError):
            return error
        if type(error).__name__ in ("KilledWorker", "CancelledError", "FutureCancelledError", "CommClosedError"):
            return PlopError(
                "Workers, or the scheduler, were lost while a stage ran.",
                where=self.client.scheduler.address,
                found=str(error) or type(error).__name__,
                fix="See their logs for the reason (memory?). Run the same command again: finished work is kept.",
            )
        raise error


def _hands_out(config: Any) -> bool:
    """Return whether a stage sends its own work to a scheduler that its settings name."""
    return any(field.name == "scheduler" for field in fields(config))
