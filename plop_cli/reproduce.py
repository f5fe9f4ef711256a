"""The nine DiSECt environments, from raw recordings to the table of results."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from plop.artifacts.store import Store
from plop.errors import PlopError
from plop.pipeline.chain import AFTER_INGEST, Layers, Profile, check_layers, layers_of, read_profile, run_step
from plop.pipeline.execute import Outcome, versions
from plop.pipeline.settings_file import SETTINGS_FILE
from plop_cli.console import Console
from plop_cli.listener import Chained
from plop_cli.outcome import show_times

PROFILES = ("cpu", "cpu-recordings", "paper")
"""Which of the shipped profiles are for this; the others are of the demos."""

DOCS = Path("docs")
"""Where the results of all environments go."""


def reproduce(
    store: Store,
    console: Console,
    data: Path,
    *,
    profile: str,
    environments: list[str],
    assignments: list[str],
    out: Path | None,
) -> None:
    """Run all stages on every environment and seed, and write the table; what is finished is skipped.

    Results lie in the workspace from the first environment on, and go to the documentation at the end.

    Args:
        store: The workspace.
        console: Where progress and the table go.
        data: Folder of DiSECt recordings.
        profile: One of `PROFILES`.
        environments: Which ones; empty takes all.
        assignments: `--set` options, `stage.key=value`.
        out: Folder of the documentation, see `results_file`; None takes `docs` for all environments with the
            profile's own settings, and otherwise leaves the results in the workspace.

    Raises:
        PlopError: No recordings, an unknown environment or profile, or whatever a stage reports. One environment
            that fails does not stop the others; it is reported at the end.
    """
    from plop.metrics.table import to_markdown
    from plop_cli.results_file import gathered, write_results

    chosen = read_profile(profile, PROFILES)
    layers = layers_of(store, chosen, assignments)
    names = _choose(data, environments)
    check_layers(layers, commands_of(chosen))
    from_file = any(layers[1][1].get(command) for command in commands_of(chosen))
    folder = DOCS if out is None and not (environments or assignments or from_file) else out
    command = _command(profile, environments, assignments, with_file=from_file)
    scores: dict[str, list[Path]] = {}
    pictures: dict[str, Path] = {}
    failed: dict[str, PlopError] = {}
    for place, name in enumerate(names):
        try:
            console.say(f"environment {place + 1} of {len(names)}: {name}")
            scores[name] = _one_environment(store, console, data, name, chosen, layers)
            pictures |= _picture(name, scores[name][0].parent)
        except PlopError as error:
            console.warn(f"{name} is left out of the table: {error.problem}")
            failed[name] = error
        if scores:
            results = gathered(scores, command=command, versions=versions(), seeds=chosen.seeds)
            written = write_results(store.workspace, results, pictures, profile)
    if scores:
        if folder is not None and _may_replace(console, results, folder, profile):
            written = write_results(folder, results, pictures, profile)
        console.say(f"{to_markdown(results)}\nwritten: {', '.join(map(str, written))}")
        console.result(results)
    if failed:
        raise _failure(failed, len(names))


def _failure(failed: Mapping[str, PlopError], count: int) -> PlopError:
    details = "\n".join(f"{name}: {error.render()}" for name, error in failed.items())
    return PlopError(
        f"{len(failed)} of {count} environments failed.",
        found=details,
        fix="Run the same command again once that is mended: what is finished is kept.",
    )


def commands_of(profile: Profile) -> tuple[str, ...]:
    """Give the commands that run on an environment, in order."""
    until = AFTER_INGEST.index("train")
    engine = ("filter", "identify") if profile.engine else ()
    return ("ingest disect", *AFTER_INGEST[:until], *engine, *AFTER_INGEST[until:])


def _command(profile: str, environments: list[str], assignments: list[str], *, with_file: bool) -> str:
    """Give the command that was typed: the short one only where it gives the same results."""
    file = f" (with {SETTINGS_FILE})" if with_file else ""
    if not environments and not assignments:
        return f"make reproduce DATA=<folder> PROFILE={profile}{file}"
    options = [part for name in environments for part in ("--env", name)]
    options += [part for text in assignments for part in ("--set", text)]
    return f"plop reproduce <folder> --profile {profile} {shlex.join(options)}{file}"


def _may_replace(console: Console, results: Mapping[str, Any], folder: Path, profile: str) -> bool:
    """Tell whether results hold all environments of those in the documentation, which stay otherwise."""
    from plop_cli.results_file import missing_in

    lacking = missing_in(results, folder, profile)
    if lacking:
        console.warn(
            f"the results in {folder} also hold {', '.join(lacking)}, which this run lacks: they stay, "
            "and those of this run are in the workspace"
        )
    return not lacking


def _picture(environment: str, folder: Path) -> dict[str, Path]:
    """Take the first picture of a part recording, which is the telling one, or the first of all."""
    from plop_cli.results_file import is_part

    found = sorted(folder.glob("pictures/*.png"), key=lambda path: (not is_part(path.name), path.name))
    return {environment: found[0]} if found else {}


def _choose(data: Path, wanted: list[str]) -> list[str]:
    from plop.recordings.readers.disect.episode import list_disect
    from plop.recordings.readers.side_file import known_environments

    if not data.is_dir():
        raise PlopError("There is no such folder.", where=data, fix="Give the folder of DiSECt recordings.")
    known = known_environments(list_disect(data))
    unknown = [name for name in wanted if name not in known]
    if unknown or not known:
        raise PlopError(
            "The folder holds no such environment.",
            where=data,
            expected=", ".join(known) or "recordings",
            found=", ".join(unknown) or "none",
        )
    return [name for name in known if not wanted or name in wanted]


def _one_environment(
    store: Store, console: Console, data: Path, name: str, profile: Profile, layers: Layers
) -> list[Path]:
    made: dict[str, Outcome] = {}
    done: dict[str, Outcome] = {}
    named: dict[str, Outcome] = {}

    def step(command: str, label: str, **extra: object) -> Outcome:
        outcome = run_step(
            command,
            store=store,
            listener=Chained(console, name),
            layers=layers,
            made=made,
            raw=data,
            named=named if command == "train" else {},
            extra=extra,
        )
        made[outcome.artifact.manifest.stage] = outcome
        done[label] = outcome
        return outcome

    commands = commands_of(profile)
    step(commands[0], "ingest", environment=name)
    found = []
    for command in commands[1 : commands.index("train")]:
        step(command, command)
    if profile.engine:
        # an engine is a model, too, and its tracks are of no use to the learned one: both are left out from here on
        named["engine"] = made.pop("identify")
        del made["filter"]
    for seed in profile.seeds:
        label = f" seed {seed}" if len(profile.seeds) > 1 else ""
        step("train", f"train{label}", seed=seed)
        step("rollout", f"rollout{label}", seed=seed)
        found.append(step("eval", f"eval{label}").artifact.path / "scores.json")
    show_times(console, done)
    return found
