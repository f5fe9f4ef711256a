"""The worker's side of a run on a Dask cluster: run one task, and distribute the pieces of a stage.

See `plop.pipeline.cluster` for the side that submits the tasks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from threading import Event
from typing import Any

from plop.artifacts.store import Store
from plop.errors import PlopError
from plop.physics.effects.trust import trusting
from plop.pipeline.execute import execute
from plop.pipeline.registry import StageRef
from plop.pipeline.tasks import given


@dataclass(frozen=True)
class Made:
    """Report of a worker on a run."""

    key: tuple[str, str]
    skipped: bool
    seconds: float
    warnings: list[str]


def make(
    ref: StageRef,
    workspace: str,
    config: Any,
    force: bool,
    trust_effects: bool,
    version: str,
    inputs: Mapping[str, Any],
) -> Made:
    """Run one task in a worker; `inputs` as returned by `addresses`, completed by the reports of other workers.

    Raises:
        PlopError: The worker does not see the workspace, has another plop, or whatever the stage reports.
    """
    if not (Path(workspace) / "artifacts").is_dir():
        raise PlopError(
            "A worker does not see the workspace.",
            where=workspace,
            expected="a folder that this machine and all workers share under the same path",
            found="no such folder on the worker",
            fix="Put the workspace there (-w), see docs/how-to/cluster.md.",
        )
    if plop_version() != version:
        raise PlopError(
            "A worker has another version of plop.",
            expected=version,
            found=plop_version(),
            fix="Start the workers from the same environment as `plop`.",
        )

    def spelt(value: Any) -> Any:
        return [spelt(one) for one in value] if isinstance(value, list) else _address(value)

    _unobserved()
    sources = given({name: spelt(value) for name, value in inputs.items()})
    with trusting(trust_effects):
        outcome = execute(
            ref.load(),
            store=Store(workspace),
            config=config,
            inputs=sources,
            command=ref.command,
            force=force,
            mapper=spread,
        )
    return Made(outcome.artifact.key, outcome.skipped, outcome.seconds, outcome.warnings)


def spread(task: Callable[[str], Any], names: Sequence[str], jobs: int, /) -> Iterator[Any]:
    """Run the pieces of a stage on all workers, from within one: the mapper of `Output.map` there.

    The worker does other work while this run waits for its pieces.
    """
    from distributed import as_completed, worker_client

    with worker_client() as client:
        for future in as_completed(client.map(partial(_piece, task), names, pure=False)):
            yield future.result()


def _piece(task: Callable[[str], Any], name: str) -> Any:
    _unobserved()
    return task(name)


def _unobserved() -> None:
    """Stop the worker's sampling profiler, which keeps objects of the sampled stack alive.

    An HDF5 dataset that is released later writes its chunks later: the file would have the same content in another
    byte order, and so another digest than without a cluster.
    """
    from distributed import get_worker

    worker = get_worker()
    profiler = worker.periodic_callbacks.get("profile")
    if profiler is not None and profiler.is_running():
        stopped = Event()
        worker.loop.add_callback(profiler.stop)
        worker.loop.add_callback(stopped.set)
        stopped.wait(timeout=60)


def _address(value: Any) -> Any:
    return "@".join(value.key) if isinstance(value, Made) else value


def plop_version() -> str:
    """Return the version of plop in this process."""
    return metadata.version("plop")
