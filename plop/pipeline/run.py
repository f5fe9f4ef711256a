"""Run one stage by the name of its command, with all that it needs; used by the command line and by Python."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from plop.artifacts.store import Artifact, Store
from plop.errors import PlopError
from plop.physics.effects.trust import trusting
from plop.pipeline.cluster import runner
from plop.pipeline.execute import Outcome
from plop.pipeline.listener import Listener, Silent
from plop.pipeline.registry import StageRef, commands, stage_ref
from plop.pipeline.settings import resolve, unknown_key
from plop.pipeline.settings_file import SETTINGS_FILE, flat_values, read_settings_file
from plop.pipeline.stage import Stage
from plop.pipeline.tasks import Runner, Task
from plop.pipeline.upstream import Planner


def run(
    command: str,
    store: Store | str | Path,
    /,
    *,
    name: str | None = None,
    env: str | None = None,
    force: bool = False,
    trust_effects: bool = False,
    scheduler: str | None = None,
    listener: Listener | None = None,
    **settings: Any,
) -> Artifact:
    """Run a stage and return its artifact: the same as from `plop <command>` with these options.

    Other inputs of the stage are found in the workspace or made first, and plop.toml of the workspace is read, as by
    the command. Nothing is printed; warnings are in `manifest.summary` of the artifact.

    Args:
        command: Command after `plop`, e.g. "train" or "ingest disect".
        store: The workspace, or its folder.
        name: Name for the artifact.
        env: Environment of inputs that are not named.
        force: Make the artifact again although it exists.
        trust_effects: Trust the effect files inside a model, now and later.
        scheduler: Address of a Dask scheduler whose workers run it and the stages before it.
        listener: Receives the events of the runs.
        settings: The command's other options by name: inputs (addresses, artifacts or raw paths) and settings. Nested
            settings are dicts, `resampling={"max_count": 4000}`. An option that is None is left out.

    Raises:
        PlopError: There is no such stage or option, the input is bad, or whatever the stage reports.
    """
    if command not in commands():
        raise unknown_key(command, commands(), where="plop.run", owner="plop", lister="--help")
    ref, listener = stage_ref(command), listener or Silent()
    stage = ref.load()
    store = store if isinstance(store, Store) else Store(store, warn=listener.warn)
    inputs, own = _parted(stage, {key: value for key, value in settings.items() if value is not None})
    written = read_settings_file(store.workspace / SETTINGS_FILE, commands()).get(command, {})
    config = resolve(stage.config, command, (SETTINGS_FILE, written), ("plop.run", own))
    with trusting(trust_effects):
        planner = Planner(store, listener)
        task = planned(planner, ref, config, inputs, environment=env, name=name, force=force)
        receiver = listener
        with runner(store, lambda _: receiver, scheduler=scheduler, trust_effects=trust_effects) as run_tasks:
            return finished(run_tasks, task).artifact


def planned(
    planner: Planner,
    ref: StageRef,
    config: Any,
    given: Mapping[str, str | Path],
    *,
    environment: str | None = None,
    name: str | None = None,
    force: bool = False,
) -> Task:
    """Check the arguments, and plan a run with all that it needs.

    Args:
        planner: Finds existing inputs, and plans missing ones.
        ref: The stage.
        config: Its settings.
        given: Inputs named by the user: addresses and raw paths by input name.
        environment: Environment of inputs that are not named.
        name: Name for the artifact.
        force: Make it again although it exists.

    Raises:
        PlopError: Bad settings or inputs, or one that is missing and cannot be made.
    """
    stage = ref.load()
    _check_workspace(planner.store, stage)
    if stage.check is not None:
        stage.check(config, given)
    if stage.complete is not None:
        config = stage.complete(config, given)
    return planner.task(ref, config, given, environment=environment, name=name, force=force)


def finished(run_tasks: Runner, task: Task) -> Outcome:
    """Run a task with all that it needs, and return its outcome.

    Raises:
        PlopError: It or a task that it needs fails.
    """
    outcome = dict(run_tasks.run([task]))[task]
    if isinstance(outcome, PlopError):
        raise outcome
    return outcome


def _parted(stage: Stage, given: Mapping[str, Any]) -> tuple[dict[str, str | Path], dict[str, Any]]:
    """Split options into inputs of the stage, several artifacts separated by commas, and flat settings."""
    inputs = {key: _address(value) for key, value in given.items() if key in stage.inputs}
    return inputs, dict(flat_values({key: value for key, value in given.items() if key not in stage.inputs}))


def _address(given: Any) -> str | Path:
    if isinstance(given, Artifact):
        return "@".join(given.key)
    if isinstance(given, (list, tuple)):
        return ",".join(str(_address(one)) for one in given)
    if isinstance(given, (str, Path)):
        return given
    raise PlopError(
        "An input is neither an artifact nor an address.",
        where="plop.run",
        found=repr(given),
        expected="an artifact, its address or a path",
        fix="`plop status` lists them.",
    )


def _check_workspace(store: Store, stage: Stage) -> None:
    """Reject a missing workspace for a stage that needs artifacts: a misspelt folder must not be created.

    Raises:
        PlopError: There is no such folder.
    """
    if any(spec.stages and not spec.optional for spec in stage.inputs.values()) and not store.workspace.exists():
        store.check_begun()
