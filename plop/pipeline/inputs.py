"""Inputs of a stage: those the user names, and for the rest the latest that fit together.

Without an address an input is taken from one line of descent: the most recent artifact of the most
advanced stage is chosen first, and the other inputs from what it was made of. When artifacts of several
environments would fit, none is guessed. An optional input is taken when one fits, unless it is one that only the
user names. An input that takes many artifacts is resolved to `<name>.0`, `<name>.1`, ...
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from plop.artifacts.lineage import LEFT_OUT, Key, closure
from plop.artifacts.store import Artifact, Store
from plop.artifacts.suggestions import told
from plop.errors import PlopError
from plop.pipeline.registry import places
from plop.pipeline.stage import InputSpec, Stage


@dataclass(frozen=True)
class Resolved:
    """The inputs of one run."""

    artifacts: dict[str, Artifact]
    raw: dict[str, Path]


def resolve_inputs(store: Store, stage: Stage, given: Mapping[str, str | Path], environment: str | None) -> Resolved:
    """Find every input of a stage.

    Args:
        store: The workspace.
        stage: The stage that will run.
        given: Addresses and raw paths by input name, as far as the user gave them.
        environment: Take only artifacts of this environment where none is given.

    Raises:
        PlopError: An input is missing, is of another stage, or several environments would fit.
    """
    raw: dict[str, Path] = {}
    chosen: dict[str, Artifact] = {}
    open_specs: dict[str, InputSpec] = {}
    for name, spec in stage.inputs.items():
        if name in given and not spec.stages:
            path = Path(given[name])
            raw[name] = path if stage.find_raw is None else stage.find_raw(name, path)
        elif given.get(name) == LEFT_OUT and spec.optional:
            continue
        elif name in given and spec.many:
            addresses = [part.strip() for part in str(given[name]).split(",") if part.strip()]
            chosen |= {f"{name}.{k}": fitting(store, stage, name, spec, a) for k, a in enumerate(addresses)}
        elif name in given:
            chosen[name] = fitting(store, stage, name, spec, str(given[name]))
        elif spec.only_named:
            continue
        elif spec.stages:
            open_specs[name] = spec
        elif not spec.optional:
            raise PlopError(f"`{stage.name}` needs the input {name!r}.", expected=spec.help)
    advanced_first = sorted(open_specs, key=lambda name: -max(places().get(s, 0) for s in open_specs[name].stages))
    for name in sorted(advanced_first, key=lambda name: open_specs[name].optional):
        try:
            key = f"{name}.0" if open_specs[name].many else name
            found = _default(store, stage, name, open_specs[name], chosen, environment)
        except PlopError:
            if not open_specs[name].optional:
                raise
            store.warn_passed_over(*open_specs[name].stages, taken=None)
        else:
            store.warn_passed_over(*open_specs[name].stages, taken=found)
            chosen[key] = found
    order = list(stage.inputs)
    return Resolved(dict(sorted(chosen.items(), key=lambda item: order.index(item[0].partition(".")[0]))), raw)


def fitting(store: Store, stage: Stage, name: str, spec: InputSpec, address: str) -> Artifact:
    """Find an artifact that is named as an input of a stage.

    Raises:
        PlopError: There is none, or it is of a stage that the input does not take.
    """
    artifact = store.find(address)
    if artifact.manifest.stage not in spec.stages:
        raise PlopError(
            f"{address} cannot be the {name} of `{stage.name}`.",
            expected=f"an artifact of {' or '.join(spec.stages)} ({spec.help})",
            found=f"an artifact of {artifact.manifest.stage}",
            fix=_instead(store, spec),
        )
    return artifact


def _instead(store: Store, spec: InputSpec) -> str:
    """Name the latest artifacts that an input takes."""
    latest = [told(artifact) for artifact in store.artifacts(*spec.stages)[-3:]][::-1]
    fits = f"Of those there are {'; '.join(latest)}. " if latest else "There is none yet. "
    return fits + "`plop status` lists the artifacts."


def _default(
    store: Store, stage: Stage, name: str, spec: InputSpec, chosen: Mapping[str, Artifact], environment: str | None
) -> Artifact:
    pool = store.artifacts(*spec.stages)
    wanted = {environment} if environment else {a.manifest.environment for a in chosen.values()}
    fitting = [a for a in pool if not wanted or a.manifest.environment in wanted]
    if not fitting:
        raise _nothing_fits(store, stage, name, spec, wanted)
    lines = {a.manifest.environment for a in fitting}
    if len(lines) > 1:
        raise _ambiguous(stage, name, fitting)
    known = {a.key: a for a in store.artifacts()}
    closures = {a.key: closure(known, a) for a in [*fitting, *chosen.values()]}
    for other in sorted(chosen.values(), key=lambda a: -places().get(a.manifest.stage, 0)):
        inside = [a for a in fitting if a.key in closures[other.key]]
        if inside:
            return max(inside, key=lambda a: places().get(a.manifest.stage, 0))
    same_line = [a for a in fitting if all(_one_line(closures[a.key], closures[b.key]) for b in chosen.values())]
    if not same_line:
        others = ", ".join(b.address for b in chosen.values())
        if (reason := store.passed_over(*spec.stages)) is not None:
            raise _cannot_be_used(stage, name, reason)
        raise PlopError(
            f"No {name} for `{stage.name}` comes from the same recordings as {others}.",
            where=store.root,
            found=", ".join(a.address for a in fitting[-4:]),
            fix=f"Run {' or '.join(f'`plop {s}`' for s in spec.stages)} for these recordings, "
            f"or choose with --{name} ADDRESS.",
        )
    latest = same_line[-1]
    derived = [a for a in same_line if latest.key in closures[a.key]]
    return max(derived, key=lambda a: places().get(a.manifest.stage, 0))


def _one_line(one: set[Key], two: set[Key]) -> bool:
    """Two artifacts are of one line when every stage in both ancestries is the same artifact in both."""
    shared = {stage for stage, _ in one} & {stage for stage, _ in two}
    return all({key for key in one if key[0] == stage} == {key for key in two if key[0] == stage} for stage in shared)


def _nothing_fits(store: Store, stage: Stage, name: str, spec: InputSpec, wanted: set[str]) -> PlopError:
    if (reason := store.passed_over(*spec.stages)) is not None:
        return _cannot_be_used(stage, name, reason)
    about = f" of the environment {' or '.join(sorted(wanted))}" if wanted else ""
    commands = " or ".join(f"`plop {name}`" for name in spec.stages)
    return PlopError(
        f"`{stage.name}` needs the input {name!r}, and this workspace has none{about}.",
        where=store.root,
        expected=f"an artifact of {' or '.join(spec.stages)}: {spec.help}",
        found=None if store.root.is_dir() else "no workspace yet: no artifacts/ in this folder",
        fix=f"Run {commands} first, or choose another workspace with -w.",
    )


def _cannot_be_used(stage: Stage, name: str, reason: PlopError) -> PlopError:
    return PlopError(
        f"`{stage.name}` needs the input {name!r}, and what is there cannot be used. {reason.problem}",
        where=reason.where,
        expected=reason.expected,
        found=reason.found,
        fix=reason.fix,
    )


def _ambiguous(stage: Stage, name: str, fitting: list[Artifact]) -> PlopError:
    latest = {a.manifest.environment: a.address for a in fitting}
    listed = ", ".join(f"{environment or '(none)'} ({address})" for environment, address in latest.items())
    return PlopError(
        f"The {name} of `{stage.name}` could be of several environments.",
        found=listed,
        fix=f"Choose with --env NAME or --{name} ADDRESS.",
    )
