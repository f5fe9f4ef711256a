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
from plop_cli.console import Console, format_seconds
from plop_cli.execute import Outcome, execute
from plop_cli.inputs import ORDER
from plop_cli.outcome import begins
from plop_cli.settings import resolve
from plop_cli.settings_file import SETTINGS_FILE, parse_assignments, read_settings_file, settings_by_command
from stages import PIPELINE, stage_ref
from stages.contract import Stage

COMMANDS = [ref.command for ref in PIPELINE]
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
    folder = importlib.resources.files("plop_cli") / "profiles"
    names = sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))
    names = [known for known in names if not among or known in among]
    if name not in names:
        raise PlopError("There is no such profile.", expected=", ".join(names), found=name)
    tables = tomllib.loads((folder / f"{name}.toml").read_text(encoding="utf-8"))
    base = read_profile(tables.pop("based_on")) if "based_on" in tables else Profile(name, [0], {})
    seeds = [int(seed) for seed in tables.pop("seeds", base.seeds)]
    engine = bool(tables.pop("engine", base.engine))
    own = settings_by_command(tables, COMMANDS, where=f"profile {name}")
    settings = {command: base.settings.get(command, {}) | own.get(command, {}) for command in {**base.settings, **own}}
    return Profile(name, seeds, settings, engine)


def layers_of(store: Store, profile: Profile, assignments: list[str]) -> Layers:
    """Stack the sources of settings: profile, plop.toml of the workspace, --set."""
    return [
        (f"profile {profile.name}", profile.settings),
        (SETTINGS_FILE, read_settings_file(store.workspace / SETTINGS_FILE, COMMANDS)),
        ("--set", parse_assignments(assignments, COMMANDS)),
    ]


def check_layers(layers: Layers, commands: Sequence[str]) -> None:
    """Refuse settings that no stage of a chain takes, before any of them runs.

    Args:
        layers: From `layers_of`.
        commands: The commands of the chain.

    Raises:
        PlopError: `--set` names a stage that is not among them, or a setting is unknown or out of range.
    """
    given = layers[-1][1]
    for command in given.keys() - set(commands):
        raise PlopError("--set names a stage that does not run here.", where=f"--set {command.replace(' ', '.')}...",
                        expected=", ".join(name.replace(" ", ".") for name in commands),
                        found=", ".join(given[command]), fix="Correct the stage, or leave it out.")  # fmt: skip
    for command in commands:
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
    console: Console,
    layers: Layers,
    made: Mapping[str, Outcome],
    raw: Path | None = None,
    named: Mapping[str, Outcome] | None = None,
    extra: Mapping[str, Any] | None = None,
    title: str = "",
) -> Outcome:
    """Run one stage of a chain.

    Args:
        command: The stage's command.
        store: The workspace.
        console: Where progress and one line of result go.
        layers: Settings.
        made: Outcomes of the stages before, by stage name.
        raw: The raw folder, for an ingest.
        named: Outcomes that are taken for an input of that name whatever `made` holds.
        extra: Settings that win over the layers.
        title: What to write before the command, e.g. the environment.
    """
    stage = stage_ref(command).load()
    config = _resolved(stage, command, layers, extra)
    with console.progress(f"{title} {command}".strip()) as progress:
        outcome = execute(
            stage,
            store=store,
            config=config,
            inputs=_inputs(stage, made, raw) | {name: _address(one) for name, one in (named or {}).items()},
            progress=progress,
            on_wait=lambda pid: console.warn(f"another run (process {pid}) is making {command}; waiting for it"),
            on_start=lambda planned: console.note(f"{title} {begins(planned)}".strip()),
        )
    for text in [] if outcome.skipped else outcome.warnings:
        console.warn(f"{command}: {text}")
    state = "already there" if outcome.skipped else format_seconds(outcome.seconds)
    console.say(f"{title} {outcome.artifact.address}  {state}".strip())
    return outcome


def show_times(console: Console, outcomes: Mapping[str, Outcome]) -> None:
    """Print how long each stage took, and of those that were there already how long they took when they were made."""
    rows = [{"stage": stage, "time": _time(outcome)} for stage, outcome in outcomes.items()]
    whole = sum(outcome.seconds for outcome in outcomes.values())
    console.table([*rows, {"stage": "all", "time": format_seconds(whole)}], title="time")


def _time(outcome: Outcome) -> str:
    if not outcome.skipped:
        return format_seconds(outcome.seconds)
    return f"kept (took {format_seconds(float(outcome.artifact.manifest.provenance.get('seconds', 0.0)))})"


def _inputs(stage: Stage, made: Mapping[str, Outcome], raw: Path | None) -> dict[str, str | Path]:
    found: dict[str, str | Path] = {}
    for name, spec in stage.inputs.items():
        fitting = [outcome for source, outcome in made.items() if source in spec.stages]
        if not spec.stages and raw is not None and not spec.optional:
            found[name] = raw
        elif fitting and not spec.only_named:
            latest = max(fitting, key=lambda outcome: ORDER[outcome.artifact.manifest.stage])
            found[name] = _address(latest)
        elif spec.stages and spec.optional:
            found[name] = LEFT_OUT
    return found


def _address(outcome: Outcome) -> str:
    return "@".join(outcome.artifact.key)
