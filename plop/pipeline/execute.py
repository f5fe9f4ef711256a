"""Run one stage: resolve inputs -> plan -> skip or run -> commit -> report. Prints nothing."""

from __future__ import annotations

import errno
import os
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from plop.artifacts.digest import files_below
from plop.artifacts.fingerprint import deciding, fingerprint, plain
from plop.artifacts.manifest import Manifest
from plop.artifacts.names import check_name
from plop.artifacts.store import Artifact, Store
from plop.artifacts.verify import verify
from plop.errors import PlopError
from plop.pipeline.inputs import Resolved, resolve_inputs
from plop.pipeline.mapping import Mapper, Progress
from plop.pipeline.registry import command_of
from plop.pipeline.stage import Input, Output, Stage, Summary, silent
from plop.recordings.open_recordings import share_open_recordings


@dataclass(frozen=True)
class Plan:
    """Plan of a run."""

    stage: Stage
    config: Any
    inputs: Resolved
    contents: dict[str, str]
    """Digest of every input's content."""
    fingerprint: str
    environment: str
    command: str
    """The command of the stage, e.g. "ingest disect"."""
    existing: Artifact | None
    """The artifact, when it exists already."""
    last_seconds: float | None
    """Time the stage took when it last ran in this workspace [s]."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run."""

    artifact: Artifact
    skipped: bool
    seconds: float
    warnings: list[str] = field(default_factory=list)
    name_from: str | None = None
    """Full address of another artifact that had the name before."""


def execute(
    stage: Stage,
    *,
    store: Store,
    config: Any = None,
    inputs: Mapping[str, str | Path] | None = None,
    command: str | None = None,
    environment: str | None = None,
    name: str | None = None,
    force: bool = False,
    progress: Progress = silent,
    on_wait: Callable[[str], None] | None = None,
    on_start: Callable[[Plan], None] | None = None,
    mapper: Mapper | None = None,
) -> Outcome:
    """Run a stage unless its artifact exists already.

    Args:
        stage: The stage.
        store: The workspace.
        config: Its configuration; None uses the defaults.
        inputs: Addresses and raw paths by input name; the rest is found.
        command: The stage's command; looked up when absent.
        environment: Environment of inputs that are not given.
        name: Name for the artifact.
        force: Make it again although it exists.
        progress: Called as the work advances.
        on_wait: Called with a process id when another run is making the same artifact.
        on_start: Called with the plan, when the artifact does not exist already.
        mapper: Runs the stage's pieces (`Output.map`), e.g. on a cluster; processes of this machine when None.

    Raises:
        PlopError: Bad input, a full disk, or whatever the stage reports.
    """
    if name is not None:
        check_name(name)
    settings = stage.config() if config is None else config
    planned = plan(
        stage, store=store, config=settings, inputs=inputs or {}, command=command, environment=environment, force=force
    )
    try:
        if planned.existing is not None:
            return _already_there(store, planned.existing, name)
        if not is_first_process():
            return _run_beside(store, planned, progress)
        reads = list(planned.inputs.artifacts.values())
        with store.making(stage.name, planned.fingerprint, reads, on_wait):
            there = None if force else store.get(stage.name, planned.fingerprint)
            if there is not None:
                return _already_there(store, there, name)
            if on_start is not None:
                on_start(planned)
            return _run(store, planned, name, force, progress, mapper)
    except (OSError, RuntimeError) as error:
        explained = _explained(error, store)
        if explained is None:
            raise
        raise explained from error


def plan(
    stage: Stage,
    *,
    store: Store,
    config: Any,
    inputs: Mapping[str, str | Path],
    command: str | None = None,
    environment: str | None = None,
    force: bool = False,
) -> Plan:
    """Find the inputs, check them and compute the fingerprint, without running anything.

    With `force` an existing artifact is not opened: this version may not be able to read it.
    """
    resolved = resolve_inputs(store, stage, inputs, environment)
    contents = {}
    for key, artifact in resolved.artifacts.items():
        verify(artifact, store.cache)
        contents[key] = artifact.content
    for key, path in resolved.raw.items():
        contents[key] = raw_content(store, stage, path, config)
    store.cache.save()
    command = command or command_of(stage)  # not the name, which the ingest commands share
    mark = fingerprint(command, stage.version, deciding(config), contents)
    environments = dict.fromkeys(a.manifest.environment for a in resolved.artifacts.values())
    existing = None if force else store.get(stage.name, mark)
    return Plan(
        stage,
        config,
        resolved,
        contents,
        mark,
        ", ".join(e for e in environments if e),
        command,
        existing,
        store.journal.last_seconds(stage.name),
    )


def raw_content(store: Store, stage: Stage, path: Path, config: Any) -> str:
    """Hash the content of the files of a raw input that a stage reads."""
    everything = files_below(path)
    chosen = stage.raw_files(path, config) if stage.raw_files is not None and path.is_dir() else everything
    return store.cache.raw_digest(path, chosen)


def _already_there(store: Store, artifact: Artifact, name: str | None) -> Outcome:
    verify(artifact, store.cache)
    store.cache.save()
    store.record(artifact, None)
    moved = None if name is None else store.set_name(name, artifact)
    return Outcome(artifact, skipped=True, seconds=0.0, name_from=moved)


def _run(
    store: Store, planned: Plan, name: str | None, force: bool, progress: Progress, mapper: Mapper | None
) -> Outcome:
    stage = planned.stage
    scratch = store.scratch(stage.name, planned.fingerprint, fresh=force)
    started = time.perf_counter()
    summary = _summary(store, planned, Output(scratch, progress, store.shared(stage.name), mapper))
    seconds = time.perf_counter() - started
    artifact = store.commit(scratch, _manifest(store, planned, summary, seconds))
    store.record(artifact, seconds)
    moved = None if name is None else store.set_name(name, artifact)
    return Outcome(artifact, skipped=False, seconds=seconds, warnings=list(summary.warnings), name_from=moved)


def _run_beside(store: Store, planned: Plan, progress: Progress) -> Outcome:
    """Take part in a run that the first of several processes commits (torchrun)."""
    scratch = store.root / planned.stage.name / f".partial-{planned.fingerprint}"
    scratch.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    summary = _summary(store, planned, Output(scratch, silent))
    seconds = time.perf_counter() - started
    return Outcome(Artifact(scratch, _manifest(store, planned, summary, seconds)), skipped=False, seconds=seconds)


def _summary(store: Store, planned: Plan, out: Output) -> Summary:
    """Run the stage itself; a run that is rejected before it wrote anything leaves no scratch folder."""
    try:
        with share_open_recordings():
            return planned.stage.run(_stage_inputs(planned), planned.config, out)
    except BaseException:
        store.drop_empty(out.path)
        raise


def is_first_process() -> bool:
    """Return whether this process commits and reports: the only one, or the first one started by torchrun."""
    return os.environ.get("RANK", "0") == "0"


def _stage_inputs(planned: Plan) -> dict[str, Input]:
    found = {name: Input(a.path, a.manifest) for name, a in planned.inputs.artifacts.items()}
    return found | {name: Input(path) for name, path in planned.inputs.raw.items()}


def _manifest(store: Store, planned: Plan, summary: Summary, seconds: float) -> Manifest:
    stage = planned.stage
    inputs: dict[str, dict[str, Any]] = {}
    for name, artifact in planned.inputs.artifacts.items():
        inputs[name] = {"stage": artifact.key[0], "fingerprint": artifact.key[1], "content": planned.contents[name]}
    for name, path in planned.inputs.raw.items():
        inputs[name] = {"name": path.resolve().name, "content": planned.contents[name]}
    provenance = {
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "seconds": round(seconds, 3),
        "command": planned.command,
        "raw_paths": {name: _portable(path, store.workspace) for name, path in planned.inputs.raw.items()},
        "versions": versions(),
    }
    return Manifest(
        stage=stage.name,
        fingerprint=planned.fingerprint,
        stage_version=stage.version,
        config=plain(planned.config),
        inputs=inputs,
        summary=asdict(summary),
        provenance=provenance,
        environment=planned.environment or _own_environment(planned, summary),
    )


def _own_environment(planned: Plan, summary: Summary) -> str:
    """Name the environment of a first stage's artifact: its figure, its setting, or its raw folder's name."""
    named = summary.figures.get("environment") or getattr(planned.config, "environment", None)
    if isinstance(named, str) and named:
        return named
    return next((path.resolve().name for path in planned.inputs.raw.values()), "")


def _portable(path: Path, workspace: Path) -> str:
    full = path.resolve()
    return full.relative_to(workspace).as_posix() if full.is_relative_to(workspace) else str(full)


def versions() -> dict[str, str]:
    """Return the versions of Python and the main packages, without importing them."""
    found = {"python": platform.python_version()}
    for package in ("plop", "numpy", "torch", "numba", "open3d", "open3d-cpu"):
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


def _explained(error: OSError | RuntimeError, store: Store) -> PlopError | None:
    """Convert system errors to PlopErrors; None for errors of the stage's code."""
    code = getattr(error, "errno", None)
    text = str(error)
    if code in (errno.ENOSPC, errno.EDQUOT) or "No space left on device" in text or "errno = 28" in text:
        return PlopError(
            "The disk is full.",
            where=store.root,
            found=text,
            fix="Free some space and run the same command again: finished pieces are kept.",
        )
    if code in (errno.EACCES, errno.EPERM, errno.EROFS):
        return PlopError(
            "The workspace cannot be written.",
            where=getattr(error, "filename", None) or store.root,
            found=text,
            fix="Choose another workspace with -w, or change its permissions.",
        )
    return None
