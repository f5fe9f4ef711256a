"""The nine DiSECt environments, from raw recordings to the table of results."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from plop.artifacts.layouts import ScoreFiles
from plop.artifacts.store import Store
from plop.errors import PlopError
from plop.pipeline.chain import Layers, Profile, chain, check_layers, layers_of, read_profile
from plop.pipeline.cluster import runner
from plop.pipeline.execute import Outcome, versions
from plop.pipeline.graph import Graph
from plop.pipeline.settings_file import SETTINGS_FILE
from plop.pipeline.tasks import Task, in_order
from plop.pipeline.upstream import Planner
from plop_cli.console import Console
from plop_cli.listener import Chained
from plop_cli.outcome import show_times

PROFILES = ("cpu", "cpu-recordings", "paper", "droid")
"""The shipped profiles of this command; the others are for the demos."""

BEGIN, TARGET = "ingest disect", "eval"
SEEDED = ("train", "rollout")
"""Stages with a separate run per seed of a profile; the scores of all seeds use the same samples."""
DOCS = Path("docs")
"""Folder of the results of all environments."""


def reproduce(
    store: Store,
    console: Console,
    data: Path,
    *,
    profile: str,
    environments: list[str],
    assignments: list[str],
    out: Path | None,
    scheduler: str | None = None,
) -> None:
    """Run all stages on every environment and seed, and write the table; what is finished is skipped.

    Results are in the workspace after the first environment, and are copied to the documentation at the end.

    Args:
        store: The workspace.
        console: Output of progress and the table.
        data: Folder of DiSECt recordings.
        profile: One of `PROFILES`.
        environments: Names of the environments; empty means all.
        assignments: `--set` options, `stage.key=value`.
        out: Folder of the documentation, see `results_file`; None takes `docs` for all environments with the
            profile's own settings, and otherwise keeps the results in the workspace.
        scheduler: Address of a Dask scheduler: independent environments, seeds and stages run in
            parallel on its workers.

    Raises:
        PlopError: No recordings, an unknown environment or profile, or whatever a stage reports. One environment
            that fails does not stop the others; it is reported at the end.
    """
    from plop.metrics.table import to_markdown
    from plop_cli.results_file import gathered, write_results

    chosen = read_profile(profile, PROFILES)
    layers = layers_of(store, chosen, assignments)
    names = _choose(data, environments)
    every = Graph().chain(TARGET, begin=BEGIN, also=chosen.also)
    check_layers(layers, every)
    from_file = any(layers[1][1].get(command) for command in every)
    folder = DOCS if out is None and not (environments or assignments or from_file) else out
    command = _command(profile, environments, assignments, with_file=from_file)
    scores: dict[str, list[Path]] = {}
    pictures: dict[str, Path] = {}
    failed: dict[str, PlopError] = {}
    for name, found in _scored(store, console, data, names, chosen, layers, scheduler):
        if isinstance(found, PlopError):
            console.warn(f"{name} is left out of the table: {found.problem}")
            failed[name] = found
            continue
        scores[name] = found
        console.say(f"environment {len(scores) + len(failed)} of {len(names)} is done: {name}")
        pictures |= _picture(name, found[0].parent)
        in_order = {known: scores[known] for known in names if known in scores}
        results = gathered(in_order, command=command, versions=versions(), seeds=chosen.seeds)
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
        fix="Run the same command again once that is fixed: finished work is kept.",
    )


def _command(profile: str, environments: list[str], assignments: list[str], *, with_file: bool) -> str:
    """Return the command of the run: the short form only where it gives the same results."""
    file = f" (with {SETTINGS_FILE})" if with_file else ""
    if not environments and not assignments:
        return f"make reproduce DATA=<folder> PROFILE={profile}{file}"
    options = [part for name in environments for part in ("--env", name)]
    options += [part for text in assignments for part in ("--set", text)]
    return f"plop reproduce <folder> --profile {profile} {shlex.join(options)}{file}"


def _may_replace(console: Console, results: Mapping[str, Any], folder: Path, profile: str) -> bool:
    """Return whether results contain all environments of the documented ones, which are kept otherwise."""
    from plop_cli.results_file import missing_in

    lacking = missing_in(results, folder, profile)
    if lacking:
        console.warn(
            f"the results in {folder} also contain {', '.join(lacking)}, which this run lacks: they are kept, "
            "and those of this run are in the workspace"
        )
    return not lacking


def _picture(environment: str, folder: Path) -> dict[str, Path]:
    """Return the first picture of a part recording, which is the most informative, or the first of all."""
    from plop_cli.results_file import is_part

    found = sorted(ScoreFiles(folder).pictures, key=lambda path: (not is_part(path.name), path.name))
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
            "The folder contains no such environment.",
            where=data,
            expected=", ".join(known) or "recordings",
            found=", ".join(unknown) or "none",
        )
    return [name for name in known if not wanted or name in wanted]


def _scored(
    store: Store,
    console: Console,
    data: Path,
    names: list[str],
    profile: Profile,
    layers: Layers,
    scheduler: str | None,
) -> Iterator[tuple[str, list[Path] | PlopError]]:
    """Run all stages on every environment and seed; yield each environment's scores, or its error, once known."""
    planner, listeners = Planner(store, Chained(console)), {name: Chained(console, name) for name in names}
    wanted: dict[str, list[Task]] = {}
    for name in names:
        try:
            wanted[name] = [_planned(planner, data, name, profile, layers, seed)[TARGET] for seed in profile.seeds]
        except PlopError as error:
            yield name, error
    done: dict[str, dict[Task, Outcome]] = {name: {} for name in wanted}
    failed: set[str] = set()
    every = [task for tasks in wanted.values() for task in tasks]
    with runner(store, lambda task: listeners[task.about], scheduler=scheduler, keep_going=True) as carries_out:
        for task, outcome in carries_out.run(every):
            name = task.about
            if isinstance(outcome, PlopError):
                if name not in failed:
                    failed.add(name)
                    yield name, outcome
                continue
            done[name][task] = outcome
            if task in wanted[name] and all(one in done[name] for one in wanted[name]):
                show_times(console, {_label(one, profile): each for one, each in done[name].items()})
                yield name, [ScoreFiles(done[name][one].artifact.path).report for one in wanted[name]]


def _planned(planner: Planner, data: Path, name: str, profile: Profile, layers: Layers, seed: int) -> dict[str, Task]:
    extra: dict[str, dict[str, Any]] = {BEGIN: {"environment": name}, **{command: {"seed": seed} for command in SEEDED}}
    return chain(planner, layers, target=TARGET, begin=BEGIN, raw=data, also=profile.also, extra=extra, about=name)


def _label(task: Task, profile: Profile) -> str:
    """Describe a run: its command, and its seed or that of its inputs, where there are several."""
    seeds = [one.config.seed for one in in_order([task]) if one.ref.command in SEEDED]
    return f"{task.ref.command} seed {seeds[-1]}" if seeds and len(profile.seeds) > 1 else task.ref.command
