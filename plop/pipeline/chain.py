"""A whole chain, from raw data to scores, with settings that ship with plop."""

from __future__ import annotations

import importlib.resources
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plop.artifacts.store import Store
from plop.errors import PlopError
from plop.pipeline.registry import commands, stage_ref
from plop.pipeline.settings import resolve
from plop.pipeline.settings_file import SETTINGS_FILE, parse_assignments, read_settings_file, settings_by_command
from plop.pipeline.stage import Stage
from plop.pipeline.tasks import Need, Task
from plop.pipeline.upstream import Planner

Layers = list[tuple[str, Mapping[str, Mapping[str, Any]]]]
"""(where the overrides come from, overrides by command), later ones winning."""


@dataclass(frozen=True)
class Profile:
    """Settings that ship with plop for a whole chain."""

    name: str
    seeds: list[int]
    """Seeds, one training run per seed."""
    settings: dict[str, dict[str, Any]]
    """By command."""
    also: tuple[str, ...] = ()
    """Optional inputs to make as well, e.g. "train.engine"."""


def read_profile(name: str, among: Sequence[str] = ()) -> Profile:
    """Read a profile: a TOML file with one table per command, `seeds`, `also`, and `based_on`, another profile.

    Args:
        name: Name of the profile.
        among: The allowed profiles; empty for all that ship with plop.

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
    also = tuple(tables.pop("also", base.also))
    own = settings_by_command(tables, commands(), where=f"profile {name}")
    settings = {command: base.settings.get(command, {}) | own.get(command, {}) for command in {**base.settings, **own}}
    return Profile(name, seeds, settings, also)


def layers_of(store: Store, profile: Profile, assignments: list[str]) -> Layers:
    """Combine the sources of settings: profile, plop.toml of the workspace, --set."""
    return [
        (f"profile {profile.name}", profile.settings),
        (SETTINGS_FILE, read_settings_file(store.workspace / SETTINGS_FILE, commands())),
        ("--set", parse_assignments(assignments, commands())),
    ]


def check_layers(layers: Layers, chain: Collection[str]) -> None:
    """Reject settings that no stage of a chain has, before any of them runs.

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
            fix="Correct the stage, or remove the option.",
        )
    for command in chain:
        stage = stage_ref(command).load()
        config = _resolved(stage, command, layers)
        if stage.check is not None:
            stage.check(config, {})


def _resolved(stage: Stage, command: str, layers: Layers, extra: Mapping[str, Any] | None = None) -> Any:
    overrides = [(source, settings.get(command, {})) for source, settings in layers]
    return resolve(stage.config, command, *overrides, ("plop", dict(extra or {})))


def chain(
    planner: Planner,
    layers: Layers,
    *,
    target: str,
    begin: str,
    raw: Path,
    also: Collection[str] = (),
    extra: Mapping[str, Mapping[str, Any]] | None = None,
    about: str = "",
) -> dict[str, Task]:
    """Plan everything from raw data to a target; common parts of two chains are planned once.

    Args:
        planner: Plans the runs.
        layers: Settings.
        target: Command of the last stage.
        begin: Command that reads the raw data.
        raw: The raw data.
        also: Optional inputs to make as well, e.g. "train.engine".
        extra: Settings by command that override the layers.
        about: What the chain is for, e.g. an environment.

    Returns:
        Tasks by command, each after those that it needs.

    Raises:
        PlopError: The raw data cannot be read, or an earlier artifact is damaged.
    """
    tasks: dict[str, Task] = {}
    for command, sources in planner.graph.chain(target, begin=begin, also=also).items():
        ref = stage_ref(command)
        stage = ref.load()
        inputs: dict[str, Need] = {name: None for name, spec in stage.inputs.items() if spec.read}
        inputs |= {name: raw for name, spec in stage.inputs.items() if not spec.stages and not spec.optional}
        inputs |= {name: tasks[maker] for name, maker in sources.items()}
        config = _resolved(stage, command, layers, (extra or {}).get(command))
        tasks[command] = planner.shared(Task(ref, config, inputs, about=about))
    return tasks
