"""Several stages in a row on one environment, each fed by those before it."""

from __future__ import annotations

import importlib.resources
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plop.artifacts.lineage import LEFT_OUT
from plop.artifacts.store import Store
from plop.errors import PlopError
from plop.pipeline.execute import Outcome, execute
from plop.pipeline.listener import Listener
from plop.pipeline.registry import commands, places, stage_ref
from plop.pipeline.settings import resolve
from plop.pipeline.settings_file import SETTINGS_FILE, parse_assignments, read_settings_file, settings_by_command
from plop.pipeline.stage import Stage

AFTER_INGEST = ("calibrate", "fuse", "fit-init", "train", "rollout", "eval")

Layers = list[tuple[str, Mapping[str, Mapping[str, Any]]]]
"""(where the overrides come from, overrides by command), later ones winning."""


@dataclass(frozen=True)
class Profile:
    """Settings that ship with plop for a whole chain."""

    name: str
    seeds: list[int]
    """One training each."""
    settings: dict[str, dict[str, Any]]
    """By command."""
    engine: bool = False
    """Fit the engine to the tracks first, so that it makes up episodes to learn from, too."""


def read_profile(name: str, among: Sequence[str] = ()) -> Profile:
    """Read a profile: a TOML file with a table a command, `seeds`, `engine`, and `based_on`, another profile.

    Args:
        name: What it is called.
        among: Only these can be meant; empty for all that ship with plop.

    Raises:
        PlopError: There is no such profile.
    """
    folder = importlib.resources.files(__package__) / "profiles"
    names = sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))
    names = [known for known in names if not among or known in among]
    if name not in names:
        raise PlopError("There is no such profile.", expected=", ".join(names), found=name)
    tables = tomllib.loads((folder / f"{name}.toml").read_text(encoding="utf-8"))
    base = read_profile(tables.pop("based_on")) if "based_on" in tables else Profile(name, [0], {})
    seeds = [int(seed) for seed in tables.pop("seeds", base.seeds)]
    engine = bool(tables.pop("engine", base.engine))
    own = settings_by_command(tables, commands(), where=f"profile {name}")
    settings = {command: base.settings.get(command, {}) | own.get(command, {}) for command in {**base.settings, **own}}
    return Profile(name, seeds, settings, engine)


def layers_of(store: Store, profile: Profile, assignments: list[str]) -> Layers:
    """Stack the sources of settings: profile, plop.toml of the workspace, --set."""
    return [
        (f"profile {profile.name}", profile.settings),
        (SETTINGS_FILE, read_settings_file(store.workspace / SETTINGS_FILE, commands())),
        ("--set", parse_assignments(assignments, commands())),
    ]


def check_layers(layers: Layers, chain: Sequence[str]) -> None:
    """Refuse settings that no stage of a chain takes, before any of them runs.

    Args:
        layers: From `layers_of`.
        chain: Its commands.

    Raises:
        PlopError: `--set` names a stage that is not among them, or a setting is unknown or out of range.
    """
    given = layers[-1][1]
    for command in given.keys() - set(chain):
        raise PlopError(
            "--set names a stage that does not run here.",
            where=f"--set {command.replace(' ', '.')}...",
            expected=", ".join(name.replace(" ", ".") for name in chain),
            found=", ".join(given[command]),
            fix="Correct the stage, or leave it out.",
        )
    for command in chain:
        stage = stage_ref(command).load()
        config = _resolved(stage, command, layers)
        if stage.check is not None:
            stage.check(config, {})


def _resolved(stage: Stage, command: str, layers: Layers, extra: Mapping[str, Any] | None = None) -> Any:
    overrides = [(source, settings.get(command, {})) for source, settings in layers]
    return resolve(stage.config, command, *overrides, ("plop", dict(extra or {})))


def run_step(
    command: str,
    *,
    store: Store,
    listener: Listener,
    layers: Layers,
    made: Mapping[str, Outcome],
    raw: Path | None = None,
    named: Mapping[str, Outcome] | None = None,
    extra: Mapping[str, Any] | None = None,
) -> Outcome:
    """Run one stage of a chain.

    Args:
        command: The stage's command.
        store: The workspace.
        listener: Is told what happens.
        layers: Settings.
        made: Outcomes of the stages before, by stage name.
        raw: The raw folder, for an ingest.
        named: Outcomes that are taken for an input of that name whatever `made` holds.
        extra: Settings that win over the layers.
    """
    stage = stage_ref(command).load()
    config = _resolved(stage, command, layers, extra)
    with listener.progress(command) as progress:
        outcome = execute(
            stage,
            store=store,
            config=config,
            inputs=_inputs(stage, made, raw) | {name: _address(one) for name, one in (named or {}).items()},
            progress=progress,
            on_wait=lambda pid: listener.waits(command, pid),
            on_start=listener.starts,
        )
    listener.finished(command, outcome)
    return outcome


def _inputs(stage: Stage, made: Mapping[str, Outcome], raw: Path | None) -> dict[str, str | Path]:
    found: dict[str, str | Path] = {}
    for name, spec in stage.inputs.items():
        fitting = [outcome for source, outcome in made.items() if source in spec.stages]
        if not spec.stages and raw is not None and not spec.optional:
            found[name] = raw
        elif fitting and not spec.only_named:
            latest = max(fitting, key=lambda outcome: places()[outcome.artifact.manifest.stage])
            found[name] = _address(latest)
        elif spec.stages and spec.optional:
            found[name] = LEFT_OUT
    return found


def _address(outcome: Outcome) -> str:
    return "@".join(outcome.artifact.key)
