"""The command line: every command, in the order of the pipeline."""

from __future__ import annotations

import os
import sys
from typing import Annotated, Any

import typer

from plop.compute.malloc import keep_freed_memory
from plop.errors import PlopError
from plop.pipeline.registry import StageRef, pipeline
from plop_cli.commands import WHOLE, add_commands
from plop_cli.completion import completed_by
from plop_cli.console import Console
from plop_cli.front_help import FrontDoor
from plop_cli.help_option import HELP

STYLE: dict[str, Any] = {
    "no_args_is_help": True,
    "rich_markup_mode": "rich",
    "pretty_exceptions_enable": False,
    "context_settings": HELP,
}
"""How every group of commands behaves."""

app = typer.Typer(
    name="plop",
    cls=FrontDoor,
    help="Turn recordings of a robot cutting a soft object into a learned, scored dynamics model, "
    "and name the physics that it misses.",
    **STYLE,
)
ingest = typer.Typer(help="Turn raw data into recordings.", add_completion=False, **STYLE)

stages = typer.Typer(
    help="Run a stage, and before it the stages that it needs; the command of the stage itself does the same.",
    add_completion=False,
    **STYLE,
)

STAGES = "Stages, in order"

INTERRUPTED = 130
"""Exit code after Ctrl-C, as in shells."""

PASS_ON = {"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}
"""A stage parses its own arguments after its import, including --help."""


def _add(owner: typer.Typer, name: str, ref: StageRef) -> None:
    def command(context: typer.Context) -> None:
        _announce(ref, context.args)
        from plop_cli.stage_command import run_stage_command

        run_stage_command(ref, list(context.args))

    def inner() -> typer.Typer:
        from plop_cli.stage_command import stage_app

        return stage_app(ref)

    owner.command(
        name,
        cls=completed_by(inner),
        help=ref.help,
        context_settings=PASS_ON,
        rich_help_panel=STAGES,
        add_help_option=False,
    )(command)


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib import metadata

        typer.echo(f"plop {metadata.version('plop')}")
        raise typer.Exit


@app.callback()
def _front(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def _ingest(context: typer.Context) -> None:
    """Turn raw data into recordings: disect, mesh or droid."""
    if context.args and _names_a_path(context.args[0]):
        from pathlib import Path

        from plop.recordings.readers.raw_folder import ask_format

        raise ask_format(Path(context.args[0]), context.args[1:])
    code = ingest(list(context.args), prog_name="plop ingest", standalone_mode=False)
    raise typer.Exit(code if isinstance(code, int) else 0)


def _announce(ref: StageRef, arguments: list[str]) -> None:
    """Print immediately what will run: the import of a stage takes seconds."""
    silent = {"--quiet", "-q", "--json", "--help", "-h"}
    if not silent & set(arguments) and os.environ.get("RANK", "0") == "0":
        Console().at_once(f"plop {ref.command}: {ref.help}")


def _names_a_path(word: str) -> bool:
    """Return whether the word after `plop ingest` is data and not a format; a mistyped format is left to Typer."""
    from difflib import get_close_matches  # imported here, because `plop --help` does not need it

    known = [command.name for command in ingest.registered_commands]
    if word.startswith("-") or word in known:
        return False
    return (
        os.path.exists(word)
        or any(mark in word for mark in ("/", os.sep, "~", "."))
        or not any(get_close_matches(word, [name or "" for name in known]))
    )


def _add_stages(owner: typer.Typer) -> None:
    for ref in pipeline():
        if ref.name != "ingest":
            _add(owner, ref.command, ref)
        elif not any(command.name == "ingest" for command in owner.registered_commands):
            owner.command(  # the first of them determines the position of the group in the list
                "ingest",
                cls=completed_by(lambda: ingest, group=True),
                context_settings=PASS_ON,
                add_help_option=False,
                rich_help_panel=STAGES,
            )(_ingest)


def _run(context: typer.Context) -> None:
    """Run a stage, and before it the stages that it needs: `plop run eval --model base`."""
    code = stages(list(context.args), prog_name="plop run", standalone_mode=False)
    raise typer.Exit(code if isinstance(code, int) else 0)


for _ref in pipeline():
    if _ref.name == "ingest":
        _add(ingest, _ref.command.split()[1], _ref)
_add_stages(stages)
_add_stages(app)
app.command(
    "run",
    cls=completed_by(lambda: stages, group=True),
    context_settings=PASS_ON,
    add_help_option=False,
    rich_help_panel=WHOLE,
)(_run)
add_commands(app)


def main(arguments: list[str] | None = None) -> int:
    """Run one command; return its exit code: 0 success, 1 a problem, 2 wrong usage, 130 interrupted."""
    keep_freed_memory()
    given = sys.argv[1:] if arguments is None else arguments
    console = Console(as_json="--json" in given)
    try:
        code = app(given, prog_name="plop", standalone_mode=False, obj=main)
    except PlopError as error:
        if "--debug" in given:
            raise
        console.error(error.first_cause())
        return main([*given, "--trust-effects"]) if _trusts(error, given) else 1
    except KeyboardInterrupt:
        code = INTERRUPTED
    except Exception as error:
        code = _unexpected(console, error, debug="--debug" in given)
    if code == INTERRUPTED:
        console.warn("interrupted; finished pieces are kept, and the same command resumes from there")
    return code if isinstance(code, int) else 0


def _trusts(error: PlopError, given: list[str]) -> bool:
    """Ask whether effect files inside a model may run; no without a terminal."""
    from plop.physics.effects.trust import UntrustedEffectError

    if not isinstance(error, UntrustedEffectError) or "--json" in given:
        return False
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    names = ", ".join(path.name for path in error.files)
    return typer.confirm(f"Run {names} now, and trust the same content in the future?", err=True)


def _unexpected(console: Console, error: Exception, *, debug: bool) -> int:
    show, code = getattr(error, "show", None), getattr(error, "exit_code", None)
    if show is not None and code is not None:  # wrong usage, as Typer reports it
        if console.as_json:
            console.error(PlopError(str(getattr(error, "message", error))))
        else:
            show()
        return int(code)
    if type(error).__name__ == "Abort":
        return INTERRUPTED
    if debug:
        raise error
    console.error(
        PlopError(
            "An unexpected error occurred.",
            found=f"{type(error).__name__}: {error}",
            fix="Run the command again with --debug and report the output.",
        )
    )
    return 1
