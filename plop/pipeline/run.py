"""Run one stage by its command's name, with whatever it needs: the command line and Python take the same way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from plop.artifacts.store import Artifact, Store
from plop.errors import PlopError
from plop.physics.effects.trust import trusting
from plop.pipeline.augment_inputs import FIT, augment_inputs
from plop.pipeline.execute import execute
from plop.pipeline.listener import Listener, Silent
from plop.pipeline.preparation import Preparation, takes_model_instead, wants_preparation
from plop.pipeline.registry import commands, stage_ref
from plop.pipeline.report_inputs import labels_of_models, report_inputs
from plop.pipeline.settings import resolve, unknown_key
from plop.pipeline.settings_file import SETTINGS_FILE, flat_values, read_settings_file
from plop.pipeline.stage import Stage


def run(
    command: str,
    store: Store | str | Path,
    /,
    *,
    name: str | None = None,
    env: str | None = None,
    force: bool = False,
    trust_effects: bool = False,
    listener: Listener | None = None,
    **settings: Any,
) -> Artifact:
    """Run a stage and give its artifact: the one that `plop <command>` with these options makes.

    What the stage needs besides is found in the workspace or made on the way, and plop.toml of the workspace is read,
    as the command does. Nothing is printed; warnings are in `manifest.summary` of the artifact.

    Args:
        command: What is typed after `plop`, e.g. "train" or "ingest disect".
        store: The workspace, or its folder.
        name: Name for the artifact.
        env: Take inputs of this environment where none is named.
        force: Make the artifact again although it is there.
        trust_effects: Run the effect files that came inside a model, now and later.
        listener: Is told what happens.
        settings: The command's other options by name: inputs (addresses, artifacts or raw paths) and settings. Nested
            settings are dicts, `resampling={"max_count": 4000}`. An option that is None is left out.

    Raises:
        PlopError: There is no such stage or option, the input is bad, or whatever the stage reports.
    """
    if command not in commands():
        raise unknown_key(command, commands(), where="plop.run", owner="plop", lister="--help")
    stage = stage_ref(command).load()
    listener = listener or Silent()
    store = store if isinstance(store, Store) else Store(store, warn=listener.warn)
    check_workspace(store, stage)
    inputs, own = _parted(stage, {key: value for key, value in settings.items() if value is not None})
    written = read_settings_file(store.workspace / SETTINGS_FILE, commands()).get(command, {})
    config = resolve(stage.config, command, (SETTINGS_FILE, written), ("plop.run", own))
    preparation = Preparation(store, listener, tuple(getattr(config, "exclude", ())))
    with trusting(trust_effects):
        config, inputs = completed(stage, config, inputs, preparation, env)
        with listener.progress(command) as progress:
            outcome = execute(
                stage,
                store=store,
                config=config,
                inputs=inputs,
                environment=env,
                name=name,
                force=force,
                progress=progress,
                on_start=listener.starts,
                on_wait=lambda process: listener.waits(command, process),
            )
    listener.finished(command, outcome)
    return outcome.artifact


def _parted(stage: Stage, given: Mapping[str, Any]) -> tuple[dict[str, str | Path], dict[str, Any]]:
    """Part options into inputs of the stage, several artifacts with commas between, and flat settings."""
    names = {
        *stage.inputs,
        *(["model"] if takes_model_instead(stage) else []),
        *([FIT] if stage.name == "augment" else []),
    }
    inputs = {key: _address(value) for key, value in given.items() if key in names}
    return inputs, dict(flat_values({key: value for key, value in given.items() if key not in names}))


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


def check_workspace(store: Store, stage: Stage) -> None:
    """Refuse a folder that is not there to a stage that goes on with artifacts: a misspelt one must not come to be.

    Raises:
        PlopError: There is no such folder.
    """
    if any(spec.stages and not spec.optional for spec in stage.inputs.values()) and not store.workspace.exists():
        store.check_begun()


def completed(
    stage: Stage, config: Any, given: Mapping[str, str | Path], preparation: Preparation, environment: str | None
) -> tuple[Any, dict[str, str | Path]]:
    """Check what was given, and find or make what else the stage needs.

    Args:
        stage: The stage that will run.
        config: Its settings.
        given: What the user named: addresses and raw paths by input name.
        preparation: Makes what is missing, or notes that it would.
        environment: Take inputs of this environment where none is named.

    Returns:
        Settings (a report takes its labels from the names of its models) and inputs.

    Raises:
        PlopError: Bad settings or inputs, or a stage on the way fails.
    """
    inputs = dict(given)
    if stage.check is not None:
        stage.check(config, inputs)
    if wants_preparation(stage, inputs):
        if stage.name == "report" and "models" in inputs and not config.labels:
            config = replace(config, labels=labels_of_models(str(inputs["models"])))
        inputs = (
            report_inputs(preparation, stage, inputs, config)
            if stage.name == "report"
            else preparation.inputs(stage, inputs, environment, config)
        )
    if stage.name == "augment":
        inputs = augment_inputs(preparation, inputs, config, environment)
    return config, inputs
