"""augment: add an effect to a model; the base stays inside, unchanged, so that the step can be undone."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from plop.artifacts.atomic_file import write_json
from plop.artifacts.layouts import Model
from plop.artifacts.lineage import made_from
from plop.artifacts.manifest import LOGS, MANIFEST_NAME
from plop.artifacts.result_file import SchemaError
from plop.artifacts.store import Artifact
from plop.diagnosis.decision.result import Diagnosis
from plop.dynamics.i2n.model_io import MODEL_SCHEMA, read_facts
from plop.errors import PlopError
from plop.models import effects_of, engine_of, load_model
from plop.parameters import Estimate
from plop.physics.adapters.base_io import base_to_dict
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import effect_type, library
from plop.physics.effects.trust import remember
from plop.pipeline.stage import Choice, Input, Inputs, InputSpec, Output, Recipe, Stage, Summary
from plop.setting_kinds import Settings
from stages import MODELS, RECORDINGS
from stages.common_inputs import engine_input

FIT = "fit"
"""Input that is not read: recordings whose diagnosis by the model is."""


@dataclass(frozen=True)
class AugmentConfig(Settings):
    """Settings of `augment`; their defaults are written only here."""

    effect: str = ""
    """Name of the effect; what the diagnosis named when empty."""
    value: tuple[str, ...] = ()
    """PARAMETER=VALUE instead of what the diagnosis fitted."""
    remove: bool = False
    """Give the base back, without the effect that was added last."""


def run(inputs: Inputs, config: AugmentConfig, out: Output) -> Summary:
    """Write model.json, base/ and, for a user's effect, effects/.

    Raises:
        PlopError: No effect to add, one that was not fitted, or a value out of range.
    """
    folder = inputs["model"].path
    if config.remove:
        return _without(folder, out.path)
    check(config, {name: given.path for name, given in inputs.items()})
    diagnosis = Diagnosis.load(inputs["diagnosis"].path) if "diagnosis" in inputs else None
    _check_model(inputs)
    files = [inputs["effect_file"].path] if "effect_file" in inputs else []
    types = library(files)
    name, parameters = _chosen(config, diagnosis)
    kind = effect_type(name, types)
    _check_present(kind(**{key: p.value for key, p in parameters.items()}))
    units = {p.name: p.unit for p in kind.parameters()}
    written = {key: replace(p, unit=units[key]).to_json() for key, p in parameters.items()}
    beside = engine_of(folder) or (engine_of(inputs["engine"].path) if "engine" in inputs else None)
    if beside is None:
        raise PlopError(
            "A learned model needs the engine beside it.",
            where=folder,
            expected="an artifact of identify",
            found="none",
            fix="Run `plop identify` on the recordings it was trained on.",
        )
    _copied(folder, Model(out.path).base.folder)
    if files:
        Model(out.path).effects.mkdir(exist_ok=True)
        shutil.copy(files[0], Model(out.path).effects / Path(files[0]).name)
        remember(Model(out.path).effects / Path(files[0]).name)
    base = inputs["model"].manifest
    facts = {
        "schema": MODEL_SCHEMA,
        "kind": "augmented",
        "engine": base_to_dict(beside),
        "effects": [{"effect": name, "parameters": written}],
        "base": {"stage": base.stage, "fingerprint": base.fingerprint} if base else {},
        "training": read_facts(folder).get("training", {}),
        **({} if config.value or diagnosis is None else {"fitted": _fitted_to(inputs["diagnosis"], diagnosis)}),
    }
    write_json(Model(out.path).facts, facts)
    load_model(out.path)
    added = ", ".join(repr(e) for e in effects_of(out.path))
    rows = [{"effect": name, "parameter": key, **p} for key, p in written.items()]
    return Summary({"effects": added}, rows, [] if config.value or diagnosis is None else _unnamed(name, diagnosis))


def check(config: AugmentConfig, given: Mapping[str, str | Path]) -> None:
    """Refuse an unknown effect, a value that cannot be, a file with effects that cannot be used, and two diagnoses.

    Raises:
        PlopError: One of them; a name gets a suggestion.
    """
    if FIT in given and "diagnosis" in given:
        raise PlopError(
            "Both --fit and --diagnosis are named.",
            found=f"{given[FIT]}, {given['diagnosis']}",
            fix="Name the recordings to fit to, or the diagnosis that has done it.",
        )
    values = _values(config.value)
    types = library([given["effect_file"]] if "effect_file" in given else [])
    if config.effect and not config.remove:
        effect_type(config.effect, types)(**values)


def _fitted_to(given: Input, diagnosis: Diagnosis) -> dict[str, Any]:
    """Tell which episodes an effect was fitted to: nothing that is taught by it may be tested on them."""
    source = given.manifest.inputs.get("recordings", {}) if given.manifest else {}
    return {"episodes": diagnosis.episodes, "recordings": [source["content"]] if "content" in source else []}


def _check_present(effect: Effect) -> None:
    if effect.absent:
        names = ", ".join(p.name for p in effect.amplitudes)
        raise PlopError(
            "With these values the effect is absent.",
            where=effect.name,
            expected=f"one of {names} that is not 0",
            found=repr(effect),
            fix=f"Give an amplitude: --value {effect.amplitudes[0].name}=NUMBER.",
        )


def _without(folder: Path, out: Path) -> Summary:
    if read_facts(folder).get("kind") != "augmented":
        raise PlopError(
            "This model has no added effect.",
            where=folder,
            expected="a model of augment",
            found=str(read_facts(folder).get("kind")),
            fix="Name a model that `plop augment` made; `plop status` lists them.",
        )
    _copied(Model(folder).base.folder, out)
    return Summary({"effects": ", ".join(repr(e) for e in effects_of(out)) or "none"})


def _copied(source: Path, target: Path) -> None:
    """Copy a model's files; when and where it was made its own artifact tells, not this copy."""
    left_out = shutil.ignore_patterns(MANIFEST_NAME, *LOGS, ".*", "*.tmp")
    shutil.copytree(source, target, dirs_exist_ok=True, ignore=left_out)


def _check_model(inputs: Inputs) -> None:
    """Refuse a diagnosis of another model: its amplitudes would come on top of what this one has already.

    Raises:
        PlopError: The two artifacts tell that they do not belong together.
    """
    model = inputs["model"].manifest
    diagnosis = inputs["diagnosis"].manifest if "diagnosis" in inputs else None
    if model is not None and diagnosis is not None and not made_from(diagnosis, "model", model):
        judged = diagnosis.inputs["model"]
        raise PlopError(
            "The diagnosis is of another model.",
            where=diagnosis.address,
            expected=f"one of {model.address}",
            found=f"one of {judged['stage']}@{judged['fingerprint'][:8]}",
            fix="Diagnose the recordings with this model, or use --fit RECORDINGS, which does that.",
        )


def _unnamed(name: str, diagnosis: Diagnosis) -> list[str]:
    """Warn of an effect that was fitted and not named."""
    verdict, row = diagnosis.verdict, diagnosis.row(name)
    if name in verdict.named or row is None:
        return []
    told = [f"{100 * row.gain:.0f} % of the held-out error"] + [f"p = {row.p:.2g}"]
    kind = " ".join([verdict.kind, *verdict.named])
    return [f"The diagnosis does not name {name} ({', '.join(told)}): its verdict is {kind}."]


def _chosen(config: AugmentConfig, diagnosis: Diagnosis | None) -> tuple[str, dict[str, Estimate]]:
    """Find the effect and its parameters.

    Raises:
        PlopError: There is no effect, or it was neither fitted nor given values.
    """
    named = () if diagnosis is None else diagnosis.verdict.named
    name = config.effect or (named[0] if named else "")
    given = {key: Estimate(value, fitted=False) for key, value in _values(config.value).items()}
    row = None if diagnosis is None else diagnosis.row(name)
    if not name or (row is None and not given):
        raise PlopError(
            "There is no effect to add.",
            where=name or "augment.effect",
            expected="an effect that the diagnosis fitted, or --value PARAMETER=VALUE",
            found="no diagnosis" if diagnosis is None else ", ".join(r.effect for r in diagnosis.ranking),
            fix="Run `plop diagnose` with the recordings, or give --effect and --value.",
        )
    return name, {**({} if row is None else row.parameters), **given}


def _values(texts: tuple[str, ...]) -> dict[str, float]:
    found = {}
    for text in texts:
        key, _, value = (part.strip() for part in text.partition("="))
        try:
            found[key] = float(value if key else "")
        except ValueError:
            raise PlopError(
                "A value of augment cannot be read.",
                where="--value",
                expected="PARAMETER=NUMBER",
                found=text,
                fix="For example --value viscosity_pa_s=40.",
            ) from None
    return found


def _is_fitted(config: AugmentConfig, inputs: Inputs) -> bool:
    """Tell whether the amplitude comes from a diagnosis, and not from the user."""
    return not config.remove and (FIT in inputs or not config.value)


def _that_fitted(
    config: AugmentConfig, found: Sequence[Artifact], inputs: Mapping[str, Sequence[Artifact]]
) -> list[Artifact]:
    """Take the diagnoses that have fitted the effect that is wanted."""
    return [one for one in found if _has_fitted(one, config.effect)]


def _has_fitted(diagnosis: Artifact, effect: str) -> bool:
    try:
        found = Diagnosis.load(diagnosis.path)
    except SchemaError:  # of another version: as good as none
        return False
    return not effect or found.row(effect) is not None


STAGE = Stage(
    name="augment",
    version=9,
    help="Add an effect to a model; reversible.",
    config=AugmentConfig,
    inputs={
        "model": InputSpec(MODELS, "the model to add to", choice=Choice.ANY_LINE),
        "diagnosis": InputSpec(
            ("diagnose",),
            "what was fitted; not needed with --value",
            optional=True,
            choice=Choice.MATCHING,
            recipe=Recipe(
                {"model": "model", "recordings": FIT, "effect_file": "effect_file"},
                settings=lambda config: {"effects": [config.effect]} if config.effect else {},
                needed=_is_fitted,
            ),
            select=_that_fitted,
        ),
        FIT: InputSpec(
            RECORDINGS,
            "recordings to fit the effect to, by their diagnosis",
            optional=True,
            choice=Choice.NAMED,
            read=False,
        ),
        "engine": engine_input(Choice.LATEST),
        "effect_file": InputSpec((), "your own effects, a Python file", optional=True),
    },
    run=run,
    check=check,
)
