"""A stage as a command: its options are generated from its inputs and its settings."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape

from plop.artifacts.store import Store
from plop.errors import PlopError
from plop.physics.effects.trust import trusting
from plop.pipeline.cluster import runner
from plop.pipeline.execute import is_first_process
from plop.pipeline.registry import StageRef, commands
from plop.pipeline.run import finished, planned
from plop.pipeline.settings import Setting, meant, resolve, settings_of
from plop.pipeline.settings_file import SETTINGS_FILE, own_assignments, read_settings_file
from plop.pipeline.settings_reference import in_brackets, sections
from plop.pipeline.stage import Choice, InputSpec, Origin, Stage
from plop.pipeline.tasks import Task
from plop.pipeline.upstream import Planner
from plop_cli.console import Console
from plop_cli.help_option import HELP
from plop_cli.listener import LastOne, OnTheWay
from plop_cli.outcome import report, report_plan


def _common(kind: Any, *names: str, help: str, **more: Any) -> Any:
    return Annotated[kind, typer.Option(*names, help=help, rich_help_panel="Running", **more)]


COMMON: dict[str, tuple[Any, Any]] = {
    "workspace": (
        _common(Path, "--workspace", "-w", help="Folder with artifacts/ and plop.toml.", envvar="PLOP_WORKSPACE"),
        Path("."),
    ),
    "env": (_common(str | None, "--env", help="Use inputs of this environment."), None),
    "name": (_common(str | None, "--name", help="Name of the artifact."), None),
    "set_": (_common(list[str] | None, "--set", help="Override a setting.", metavar="KEY=VALUE"), None),
    "dry_run": (_common(bool, "--dry-run", help="Show what would run, without running it."), False),
    "force": (_common(bool, "--force", help="Run although the artifact exists."), False),
    "scheduler": (
        _common(str | None, "--scheduler", help="Run on the workers of this Dask scheduler.", metavar="ADDRESS"),
        None,
    ),
    "trust_effects": (
        _common(bool, "--trust-effects", help="Trust the effect files inside a model, now and later."),
        False,
    ),
    "quiet": (_common(bool, "--quiet", "-q", help="Print nothing but warnings and errors."), False),
    "as_json": (_common(bool, "--json", help="Print the result as JSON."), False),
    "debug": (_common(bool, "--debug", help="Show tracebacks."), False),
}
"""Options of every stage's command: parameter -> (annotation, default)."""


CHOICES: dict[Choice | Origin, str] = {
    Choice.MADE: "made if missing",
    Choice.MATCHING: "the latest made from the other inputs",
}
"""Default of unnamed inputs in --help; that of all others is the latest match."""
PLAIN = {int: "<int>", float: "<float>"}
"""Type of numbers in --help, which are read as text, in the style of Typer."""


def run_stage_command(ref: StageRef, arguments: list[str]) -> None:
    """Import a stage, parse its arguments, run it and report."""
    app = stage_app(ref)
    try:
        code = app(arguments, prog_name=f"plop {ref.command}", standalone_mode=False)
    except Exception as error:
        if hasattr(error, "possibilities"):  # an unknown option; Typer does not know renamed settings
            key = str(error.option_name).lstrip("-").replace("-", "_")  # type: ignore[attr-defined]
            likely = [_option(name) for name in meant(key, settings_of(ref.load().config))]
            error.possibilities = likely[:3] or error.possibilities
        raise
    raise typer.Exit(code if isinstance(code, int) else 0)


def stage_app(ref: StageRef) -> typer.Typer:
    """Import a stage and create the app that parses its arguments."""
    stage = ref.load()
    app = typer.Typer(
        add_completion=False, rich_markup_mode="rich", pretty_exceptions_enable=False, context_settings=HELP
    )
    app.command(help=escape(stage.help))(stage_function(ref, stage))
    return app


def stage_function(ref: StageRef, stage: Stage) -> Callable[..., None]:
    """Create the function whose signature Typer converts to options."""
    settings = settings_of(stage.config)
    parameters: list[inspect.Parameter] = []
    for name, spec in stage.inputs.items():
        parameters.append(_parameter(f"input_{name}", *_input_option(name, spec)))
    taken = {option for name in stage.inputs for option in [_option(name)]}
    taken |= {f"--{name.replace('_', '-').strip('-')}" for name in COMMON} | {"--json", "--set", "--help"}
    shown = [(setting, title) for title, part in sections(settings).items() for setting in part]
    for setting, title in shown:
        if _option(setting.key) not in taken:  # such a setting is available through --set only
            parameters.append(_parameter(_variable(setting.key), _setting_option(setting, title), None))
    parameters += [_parameter(name, *option) for name, option in COMMON.items()]

    def command(**values: Any) -> None:
        with trusting(values["trust_effects"]):
            run_parsed(ref, stage, settings, values)

    command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    command.__annotations__ = {p.name: p.annotation for p in parameters}
    return command


def run_parsed(ref: StageRef, stage: Stage, settings: list[Setting], values: dict[str, Any]) -> None:
    """Run a stage with parsed options."""
    first = is_first_process()
    console = Console(quiet=values["quiet"] or not first, as_json=values["as_json"] and first)
    store = Store(values["workspace"], warn=console.warn if first else None)
    config = _config(ref, stage, settings, values, store)
    names = [name.removeprefix("input_") for name in values if name.startswith("input_")]
    inputs = {name: values[f"input_{name}"] for name in names if values[f"input_{name}"] is not None}
    listener = OnTheWay(console)
    task = planned(
        Planner(store, listener),
        ref,
        config,
        inputs,
        environment=values["env"],
        name=values["name"],
        force=values["force"],
    )
    if values["dry_run"]:
        report_plan(console, store, task)
        return
    _check_processes(task)
    last = LastOne(console)
    with runner(
        store,
        lambda one: last if one is task else listener,
        scheduler=values["scheduler"],
        trust_effects=values["trust_effects"],
    ) as carries_out:
        report(console, store, finished(carries_out, task), values["name"])


def _check_processes(task: Task) -> None:
    """Reject missing inputs under torchrun, which would be made in several processes at once."""
    missing = [one.ref.command for one in task.before if one.there is None]
    if missing and os.environ.get("WORLD_SIZE", "1") != "1":
        raise PlopError(
            "Under torchrun all inputs of a stage must exist.",
            found=f"{', '.join(missing)} would run first",
            fix=f"Run `plop {missing[0]}` without torchrun first.",
        )


def _config(ref: StageRef, stage: Stage, settings: list[Setting], values: dict[str, Any], store: Store) -> Any:
    options = {s.key: values.get(_variable(s.key)) for s in settings}
    # a repeated option and one with commas are equivalent
    given = {
        key: ",".join(value) if isinstance(value, list) else value
        for key, value in options.items()
        if value is not None and value != []
    }
    return resolve(
        stage.config,
        ref.command,
        (SETTINGS_FILE, read_settings_file(store.workspace / SETTINGS_FILE, commands()).get(ref.command, {})),
        ("--set", own_assignments(values["set_"] or [], ref.command, commands())),
        ("command line", given),
    )


def _parameter(name: str, annotation: Any, default: Any) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _variable(key: str) -> str:
    return "setting_" + key.replace(".", "__")


def _option(key: str) -> str:
    return "--" + key.replace("_", "-")


def _input_option(name: str, spec: InputSpec) -> tuple[Any, Any]:
    if spec.stages:
        source = " or ".join(spec.stages)
        unnamed = "none" if spec.recipe is None else "made if needed"
        default = unnamed if spec.choice is Choice.NAMED else CHOICES.get(spec.choice, "the latest match")
        default += ", or none" if spec.optional and spec.choice is not Choice.NAMED else ""
        text = escape(f"{spec.help.rstrip('.')}. Address of an artifact of {source}.")
        metavar = "ADDRESS,..." if spec.many else "ADDRESS"
        option = typer.Option(_option(name), metavar=metavar, help=text, show_default=default, rich_help_panel="Inputs")
        return Annotated[str | None, option], None
    if spec.optional:
        return Annotated[
            Path | None, typer.Option(_option(name), metavar="PATH", help=escape(spec.help), rich_help_panel="Inputs")
        ], None
    argument = typer.Argument(metavar=name.upper(), help=escape(spec.help), show_default=False)
    return Annotated[Path, argument], inspect.Parameter.empty


def _setting_option(setting: Setting, title: str) -> Any:
    several = setting.kind.type == tuple[str, ...]
    # numbers are parsed like those of --set and plop.toml, so that errors are the same for all sources
    kind: Any = list[str] if several else bool if setting.kind.type is bool else str
    name = _option(setting.key)
    option = typer.Option(
        f"{name}/--no-{name[2:]}" if kind is bool else name,  # with an off switch: the default, or plop.toml, may be on
        help=escape(f"{setting.help} {in_brackets(setting)}".strip()),
        show_default=False,
        metavar="TEXT,..." if several else PLAIN.get(setting.kind.type, "<word>" if setting.kind.choices else None),
        rich_help_panel=title,
    )
    return Annotated[kind | None, option]
