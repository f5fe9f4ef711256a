"""Existing inputs of a stage: those named by the user, and for the rest the latest that are consistent.

Inputs without an address come from one lineage: the most recent artifact of the most advanced stage is
chosen first, and the other inputs among its ancestors. When artifacts of several environments match, there is an
error instead of a guess. An optional input is used when one matches, unless only the user may name it. An input that
takes many artifacts is resolved to `<name>.0`, `<name>.1`, ...
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from plop.artifacts.lineage import LEFT_OUT, Key, closure
from plop.artifacts.store import BEGIN, Artifact, Store
from plop.artifacts.suggestions import description
from plop.errors import PlopError
from plop.pipeline.registry import places
from plop.pipeline.stage import Choice, InputSpec, Stage

Found = Artifact | Path | tuple[Artifact, ...] | None
"""Value of an input: an artifact, a raw path, several artifacts, or None where it is left out."""


class AbsentError(PlopError):
    """No artifact matches an input; one could be made."""


@dataclass(frozen=True)
class Resolved:
    """The inputs of one run."""

    artifacts: dict[str, Artifact]
    raw: dict[str, Path]


def resolve_inputs(store: Store, stage: Stage, given: Mapping[str, str | Path], environment: str | None) -> Resolved:
    """Find every input of a stage among existing artifacts.

    Args:
        store: The workspace.
        stage: The stage that will run.
        given: Addresses and raw paths by input name, as far as the user gave them.
        environment: Environment of inputs that are not given.

    Raises:
        PlopError: An input is missing, is of another stage, or several environments match.
    """
    found: dict[str, Found] = {
        name: named_input(store, stage, name, given[name])
        for name, spec in stage.inputs.items()
        if name in given and spec.read
    }
    wanted = [
        name
        for name, spec in stage.inputs.items()
        if name not in found and spec.stages and spec.read and spec.choice is not Choice.NAMED
    ]
    for name, spec in stage.inputs.items():
        if name not in found and not spec.stages and not spec.optional:
            raise PlopError(f"`{stage.name}` needs the input {name!r}.", expected=spec.help)
    found |= latest_inputs(store, stage, wanted, found, environment)
    artifacts: dict[str, Artifact] = {}
    raw: dict[str, Path] = {}
    for name in stage.inputs:
        value = found.get(name)
        if isinstance(value, Path):
            raw[name] = value
        elif isinstance(value, tuple):
            artifacts |= {f"{name}.{k}": one for k, one in enumerate(value)}
        elif value is not None:
            artifacts[name] = value
    return Resolved(artifacts, raw)


def named_input(store: Store, stage: Stage, name: str, address: str | Path) -> Found:
    """Find the input of a stage that the user named; None where it is left out.

    Raises:
        PlopError: There is none, it is of a stage that the input does not accept, or one is named twice.
    """
    spec = stage.inputs[name]
    if str(address) == LEFT_OUT and spec.optional:
        return None
    if not spec.stages:
        return Path(address) if stage.find_raw is None else stage.find_raw(name, Path(address))
    if not spec.many:
        return _fitting(store, stage, name, spec, str(address))
    several = tuple(
        _fitting(store, stage, name, spec, text) for part in str(address).split(",") if (text := part.strip())
    )
    if len({one.key for one in several}) < len(several):
        raise PlopError(
            f"One of the {name} is named twice.",
            where=f"--{name.replace('_', '-')}",
            expected="different artifacts",
            found=str(address),
            fix="Name each once.",
        )
    return several


def _fitting(store: Store, stage: Stage, name: str, spec: InputSpec, address: str) -> Artifact:
    artifact = store.find(address)
    if artifact.manifest.stage not in spec.stages:
        latest = [description(artifact) for artifact in store.artifacts(*spec.stages)[-3:]][::-1]
        fits = f"Existing ones: {'; '.join(latest)}. " if latest else "There is none yet. "
        raise PlopError(
            f"{address} cannot be the {name} of `{stage.name}`.",
            expected=f"an artifact of {' or '.join(spec.stages)} ({spec.help})",
            found=f"an artifact of {artifact.manifest.stage}",
            fix=fits + "`plop status` lists the artifacts.",
        )
    return artifact


def latest_inputs(
    store: Store,
    stage: Stage,
    wanted: Iterable[str],
    found: Mapping[str, Found],
    environment: str | None,
    makeable: Collection[str] = (),
) -> dict[str, Found]:
    """Find the latest artifacts consistent with each other and with the known inputs; optional ones may be missing.

    Args:
        store: The workspace.
        stage: The stage that will run.
        wanted: Names of the inputs.
        found: The inputs that are known.
        environment: Use only artifacts of this environment.
        makeable: Inputs that may be missing, because they can be made.

    Raises:
        PlopError: Nothing matches a required input, or matches are of several environments.
    """
    chosen = [one for value in found.values() for one in _artifacts(value)]
    more: dict[str, Found] = {}
    advanced_first = sorted(wanted, key=lambda name: -max(places().get(s, 0) for s in stage.inputs[name].stages))
    for name in sorted(advanced_first, key=lambda name: stage.inputs[name].optional):
        spec = stage.inputs[name]
        try:
            one = _latest(store, stage, name, chosen, environment)
        except PlopError as error:
            if not spec.optional and not (isinstance(error, AbsentError) and name in makeable):
                raise
            store.warn_passed_over(*spec.stages, taken=None)
        else:
            store.warn_passed_over(*spec.stages, taken=one)
            chosen.append(one)
            more[name] = (one,) if spec.many else one
    return more


def _artifacts(value: Found) -> tuple[Artifact, ...]:
    return value if isinstance(value, tuple) else (value,) if isinstance(value, Artifact) else ()


def _latest(store: Store, stage: Stage, name: str, chosen: list[Artifact], environment: str | None) -> Artifact:
    spec = stage.inputs[name]
    pool = store.artifacts(*spec.stages)
    wanted = {environment} if environment else {a.manifest.environment for a in chosen}
    fitting = [a for a in pool if not wanted or a.manifest.environment in wanted]
    if not fitting:
        raise _nothing_fits(store, stage, name, wanted)
    if len({a.manifest.environment for a in fitting}) > 1:
        raise _ambiguous(stage, name, fitting)
    known = {a.key: a for a in store.artifacts()}
    closures = {a.key: closure(known, a) for a in [*fitting, *chosen]}
    for other in sorted(chosen, key=lambda a: -places().get(a.manifest.stage, 0)):
        inside = [a for a in fitting if a.key in closures[other.key]]
        if inside:
            return max(inside, key=lambda a: places().get(a.manifest.stage, 0))
    same_line = [a for a in fitting if all(_one_line(closures[a.key], closures[b.key]) for b in chosen)]
    if not same_line:
        if (reason := store.passed_over(*spec.stages)) is not None:
            raise _cannot_be_used(stage, name, reason)
        raise AbsentError(
            f"No {name} for `{stage.name}` comes from the same recordings as {', '.join(b.address for b in chosen)}.",
            where=store.root,
            found=", ".join(a.address for a in fitting[-4:]),
            fix=f"Run {' or '.join(f'`plop {s}`' for s in spec.stages)} for these recordings, "
            f"or choose with --{name} ADDRESS.",
        )
    latest = same_line[-1]
    derived = [a for a in same_line if latest.key in closures[a.key]]
    return max(derived, key=lambda a: places().get(a.manifest.stage, 0))


def _one_line(one: set[Key], two: set[Key]) -> bool:
    """Return whether two artifacts have one lineage: every stage in both ancestries is the same artifact in both."""
    shared = {stage for stage, _ in one} & {stage for stage, _ in two}
    return all({key for key in one if key[0] == stage} == {key for key in two if key[0] == stage} for stage in shared)


def undoubted(store: Store, stage: Stage, name: str, environment: str | None) -> Artifact:
    """Return the latest artifact for an input, of any lineage, when it is unambiguous.

    Raises:
        PlopError: There is none, or they are of several environments; or, where the choice must be unambiguous,
            there are several and none is made from another.
    """
    spec = stage.inputs[name]
    pool = [a for a in store.artifacts(*spec.stages) if environment in (None, a.manifest.environment)]
    if not pool:
        raise _nothing_fits(store, stage, name, {environment} if environment else set())
    if len({a.manifest.environment for a in pool}) > 1:
        raise _ambiguous(stage, name, pool)
    if spec.choice is Choice.UNAMBIGUOUS and len(pool) > 1 and len({a.key[0] for a in pool}) == 1:
        raise PlopError(
            f"Which {name}?",
            where=store.root,
            expected=f"--{name.replace('_', '-')} NAME",
            found=", ".join(a.address for a in pool),
            fix="`plop status` lists the artifacts.",
        )
    store.warn_passed_over(*spec.stages, taken=pool[-1])
    return pool[-1]


def _nothing_fits(store: Store, stage: Stage, name: str, wanted: set[str]) -> PlopError:
    spec = stage.inputs[name]
    if (reason := store.passed_over(*spec.stages)) is not None:
        return _cannot_be_used(stage, name, reason)
    about = f" of the environment {' or '.join(sorted(wanted))}" if wanted else ""
    commands = " or ".join(f"`plop {maker}`" for maker in spec.stages)
    first = f"Run {commands} first" if store.artifacts() else BEGIN
    return AbsentError(
        f"`{stage.name}` needs the input {name!r}, and this workspace has none{about}.",
        where=store.root,
        expected=f"an artifact of {' or '.join(spec.stages)}: {spec.help}",
        found=None if store.root.is_dir() else "no workspace yet: no artifacts/ in this folder",
        fix=f"{first}, or choose another workspace with -w.",
    )


def _cannot_be_used(stage: Stage, name: str, reason: PlopError) -> PlopError:
    return PlopError(
        f"`{stage.name}` needs the input {name!r}, and the existing one cannot be used. {reason.problem}",
        where=reason.where,
        expected=reason.expected,
        found=reason.found,
        fix=reason.fix,
    )


def _ambiguous(stage: Stage, name: str, fitting: list[Artifact]) -> PlopError:
    latest = {a.manifest.environment: a.address for a in fitting}
    listed = ", ".join(f"{environment or '(none)'} ({address})" for environment, address in latest.items())
    return PlopError(
        f"Several environments match the {name} of `{stage.name}`.",
        found=listed,
        fix=f"Choose with --env NAME or --{name} ADDRESS.",
    )
