"""The commands around the pipeline: each parses, imports one function and calls it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from plop_cli.console import Console

if TYPE_CHECKING:
    from plop.artifacts.store import Store

AROUND = "Around the pipeline"
WHOLE = "The whole pipeline"

Workspace = Annotated[
    Path, typer.Option("--workspace", "-w", envvar="PLOP_WORKSPACE", help="Folder with artifacts/ and plop.toml.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but warnings and errors.")]
Seed = Annotated[str, typer.Option("--seed", metavar="<int>", help="Seed of simulated data.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show tracebacks.")]
Assignments = Annotated[
    list[str] | None, typer.Option("--set", metavar="STAGE.KEY=VALUE", help="Override a setting of a stage.")
]
Scheduler = Annotated[
    str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Run on the workers of this Dask scheduler.")
]
Address = Annotated[str, typer.Argument(help="stage@prefix, stage@latest or a name.", show_default=False)]
HERE = Path(".")


def _opened(workspace: Path, quiet: bool, as_json: bool = False) -> tuple[Store, Console]:
    """Open the workspace, and the console to which its warnings go."""
    from plop.artifacts.store import Store

    console = Console(quiet=quiet, as_json=as_json)
    return Store(workspace, warn=console.warn), console


def demo(
    workspace: Workspace = Path("demo"),
    seed: Seed = "0",
    set_: Assignments = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
    debug: Debug = False,
) -> None:
    """Simulate a small set and run every stage on it; ends with scores, a video and times."""
    from plop.artifacts.store import Store
    from plop_cli.demo import run_demo

    run_demo(Store(workspace), Console(quiet=quiet, as_json=as_json), seed=_seed(seed), assignments=set_ or [])


def demo_physics(
    context: typer.Context,
    workspace: Workspace = Path("demo-physics"),
    seed: Seed = "0",
    quiet: Quiet = False,
    as_json: AsJson = False,
    debug: Debug = False,
) -> None:
    """Hide an effect, seal the answer, diagnose it, add it, and compare the errors; ends with a report."""
    from plop_cli.demo_physics import run_demo_physics

    run_demo_physics(workspace, Console(quiet=quiet, as_json=as_json), context.obj, seed=_seed(seed))


def _seed(text: str) -> int:
    from plop.pipeline.settings import checked
    from plop.setting_kinds import Seed

    return int(checked(text, Seed, where="command line: seed"))


def reproduce(
    data: Annotated[Path, typer.Argument(help="Folder of DiSECt recordings.", show_default=False)],
    profile: Annotated[
        str,
        typer.Option(
            help="cpu: 2 cores; cpu-recordings: without simulated episodes of an engine; "
            "paper: the paper's schedule, for a GPU; droid: as paper, with its settings for DROID."
        ),
    ] = "cpu",
    env: Annotated[list[str] | None, typer.Option(help="Only this environment; may be repeated.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder with results.md and results/.",
            show_default="docs; the workspace with --env, --set or a plop.toml",
        ),
    ] = None,
    workspace: Workspace = Path("reproduce"),
    set_: Assignments = None,
    scheduler: Scheduler = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
    debug: Debug = False,
) -> None:
    """Run all stages on the nine DiSECt environments and write the results; resumes where it stopped."""
    from plop.artifacts.store import Store
    from plop_cli.reproduce import reproduce as run

    run(
        Store(workspace),
        Console(quiet=quiet, as_json=as_json),
        data,
        profile=profile,
        environments=env or [],
        assignments=set_ or [],
        out=out,
        scheduler=scheduler,
    )


def repro(
    addresses: Annotated[
        list[str] | None,
        typer.Argument(help="Artifacts to remake, with their ancestors; all stale ones of `plop status` by default."),
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show what would run, without running it.")] = False,
    scheduler: Scheduler = None,
    trust_effects: Annotated[
        bool, typer.Option("--trust-effects", help="Trust the effect files inside a model, now and later.")
    ] = False,
    workspace: Workspace = HERE,
    quiet: Quiet = False,
    as_json: AsJson = False,
    debug: Debug = False,
) -> None:
    """Remake stale or damaged artifacts with their recorded settings."""
    from plop_cli.repro import repro as run

    store, console = _opened(workspace, quiet, as_json)
    run(store, console, addresses or [], dry_run=dry_run, scheduler=scheduler, trust_effects=trust_effects)


def gc(
    delete: Annotated[
        bool, typer.Option("--delete", help="Remove the items; by default they are only listed.")
    ] = False,
    workspace: Workspace = HERE,
    quiet: Quiet = False,
    as_json: AsJson = False,
    debug: Debug = False,
) -> None:
    """List what can be removed: older artifacts that no named one needs, and remains of killed runs."""
    from plop.artifacts.store import Store
    from plop_cli.repro import collect_garbage

    collect_garbage(Store(workspace), Console(quiet=quiet, as_json=as_json), delete=delete)


def status(
    workspace: Workspace = HERE,
    everything: Annotated[bool, typer.Option("--all", help="Show older ones too.")] = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
    debug: Debug = False,
) -> None:
    """Show the artifacts, their lineage, and which are stale."""
    from plop.artifacts.store import Store
    from plop_cli.status import show_status

    show_status(Store(workspace), Console(quiet=quiet, as_json=as_json), everything=everything)


def why(
    one: Address,
    two: Address,
    workspace: Workspace = HERE,
    quiet: Quiet = False,
    as_json: AsJson = False,
    debug: Debug = False,
) -> None:
    """Show the first difference between two artifacts, starting from the raw data."""
    from plop_cli.status import show_difference

    show_difference(*_opened(workspace, quiet, as_json), one, two)


def verify(
    addresses: Annotated[list[str] | None, typer.Argument(help="Artifacts to check; all by default.")] = None,
    workspace: Workspace = HERE,
    quiet: Quiet = False,
    as_json: AsJson = False,
    debug: Debug = False,
) -> None:
    """Read every payload again and compare it with its manifest."""
    from plop_cli.status import verify_all

    verify_all(*_opened(workspace, quiet, as_json), addresses or [])


def export(
    address: Address,
    folder: Annotated[Path, typer.Argument(help="Folder to copy to.", show_default=False)],
    kind: Annotated[
        str, typer.Option(help="all, splats, clouds, video, animation, recordings, states, model, scores or pictures.")
    ] = "all",
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
    workspace: Workspace = HERE,
    quiet: Quiet = False,
    as_json: AsJson = False,
    debug: Debug = False,
) -> None:
    """Copy an artifact's files out of the workspace, with its manifest."""
    from plop_cli.export import export as run

    run(*_opened(workspace, quiet, as_json), address, folder, kind=kind, force=force)


def view(
    address: Address,
    episode: Annotated[str | None, typer.Option(help="Episode to show; the first by default.")] = None,
    save: Annotated[Path | None, typer.Option(help="Write an .rrd file instead of opening the viewer.")] = None,
    workspace: Workspace = HERE,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Show recordings, splats or predicted states in 3D (needs rerun-sdk)."""
    from plop_cli.view import view as run

    run(*_opened(workspace, quiet), address, episode=episode, save=save)


def doctor(workspace: Workspace = HERE, quiet: Quiet = False, as_json: AsJson = False, debug: Debug = False) -> None:
    """Check this machine: what is installed, what is missing, and how to install it."""
    from plop.artifacts.store import Store
    from plop_cli.doctor import show

    raise typer.Exit(show(Store(workspace), Console(quiet=quiet, as_json=as_json)))


def add_commands(app: typer.Typer) -> None:
    """Add them to the command line."""
    whole: list[Callable[..., None]] = [demo, demo_physics, reproduce, repro]
    around: list[Callable[..., None]] = [status, why, verify, gc, export, view, doctor]
    for command in whole:
        app.command(rich_help_panel=WHOLE)(command)
    for command in around:
        app.command(rich_help_panel=AROUND)(command)
