"""augment: add an effect to a model; the base stays inside, unchanged, so that the step can be undone."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plop.artifacts.atomic_file import write_json
from plop.artifacts.lineage import made_from
from plop.artifacts.manifest import MANIFEST_NAME
from plop.dynamics.model_io import MODEL_SCHEMA, read_facts
from plop.errors import PlopError
from plop.models import effects_of, engine_of, load_model
from plop.physics.adapters.base_io import base_to_dict
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import effect_type, library
from plop.physics.effects.trust import remember
from plop.pipeline.stage import Input, Inputs, InputSpec, Output, Stage, Summary


@dataclass(frozen=True)
class AugmentConfig:
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
    diagnosis = _diagnosis(inputs)
    _check_model(inputs)
    files = [inputs["effect_file"].path] if "effect_file" in inputs else []
    types = library(files)
    name, parameters = _chosen(config, diagnosis)
    kind = effect_type(name, types)
    values = {key: p["value"] for key, p in parameters.items()}
    _check_present(kind(**values))
    units = {p.name: p.unit for p in kind.parameters()}
    parameters = {key: {**p, "unit": units[key]} for key, p in parameters.items()}
    engine = engine_of(folder) or (engine_of(inputs["engine"].path) if "engine" in inputs else None)
    if engine is None:
        raise PlopError(
            "A learned model needs the engine beside it.",
            where=folder,
            expected="an artifact of identify",
            found="none",
            fix="Run `plop identify` on the recordings it was trained on.",
        )
    _copied(folder, out.path / "base")
    if files:
        (out.path / "effects").mkdir(exist_ok=True)
        shutil.copy(files[0], out.path / "effects" / Path(files[0]).name)
        remember(out.path / "effects" / Path(files[0]).name)
    base = inputs["model"].manifest
    facts = {
        "schema": MODEL_SCHEMA,
        "kind": "augmented",
        "engine": base_to_dict(engine),
        "effects": [{"effect": name, "parameters": parameters}],
        "base": {"stage": base.stage, "fingerprint": base.fingerprint} if base else {},
        "training": read_facts(folder).get("training", {}),
        **({} if config.value or not diagnosis else {"fitted": _fitted_to(inputs["diagnosis"], diagnosis)}),
    }
    write_json(out.path / "model.json", facts)
    load_model(out.path)
    added = ", ".join(repr(e) for e in effects_of(out.path))
    rows = [{"effect": name, "parameter": key, **p} for key, p in parameters.items()]
    return Summary({"effects": added}, rows, [] if config.value else _doubts(name, diagnosis))


def check(config: AugmentConfig, given: Mapping[str, str | Path]) -> None:
    """Refuse an unknown effect, a value that cannot be, and a file with effects that cannot be used.

    Raises:
        PlopError: One of them; a name gets a suggestion.
    """
    values = _values(config.value)
    types = library([given["effect_file"]] if "effect_file" in given else [])
    if config.effect and not config.remove:
        effect_type(config.effect, types)(**values)


def _fitted_to(given: Input, diagnosis: dict[str, Any]) -> dict[str, Any]:
    """Tell which episodes an effect was fitted to: nothing that is taught by it may be tested on them."""
    source = given.manifest.inputs.get("recordings", {}) if given.manifest else {}
    return {"episodes": diagnosis.get("episodes", []), "recordings": [source["content"]] if "content" in source else []}


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
    _copied(folder / "base", out)
    return Summary({"effects": ", ".join(repr(e) for e in effects_of(out)) or "none"})


def _copied(source: Path, target: Path) -> None:
    """Copy a model's files; when and where it was made is told by its own artifact, not by this copy."""
    shutil.copytree(source, target, dirs_exist_ok=True, ignore=shutil.ignore_patterns(MANIFEST_NAME, ".*", "*.tmp"))


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


def _doubts(name: str, diagnosis: dict[str, Any]) -> list[str]:
    """Warn of an effect that was fitted and not named."""
    verdict = diagnosis.get("verdict", {})
    row: dict[str, Any] = next((r for r in diagnosis.get("ranking", []) if r.get("effect") == name), {})
    if name in verdict.get("named", ()) or not row:
        return []
    told = [f"{100 * row['gain']:.0f} % of the held-out error"] if row.get("gain") is not None else []
    told += [f"p = {row['p']:.2g}"] if row.get("p") is not None else []
    kind = " ".join([verdict.get("kind", ""), *verdict.get("named", ())]).strip()
    shown = f" ({', '.join(told)})" if told else ""
    return [f"The diagnosis does not name {name}{shown}: its verdict is {kind}."]


def _diagnosis(inputs: Inputs) -> dict[str, Any]:
    if "diagnosis" not in inputs:
        return {}
    facts: dict[str, Any] = json.loads((inputs["diagnosis"].path / "diagnosis.json").read_text())
    return facts


def _chosen(config: AugmentConfig, diagnosis: dict[str, Any]) -> tuple[str, dict[str, dict[str, Any]]]:
    """Find the effect and its parameters, each {"value", "low", "high"}."""
    named = diagnosis.get("verdict", {}).get("named", [])
    name = config.effect or (named[0] if named else "")
    given = _values(config.value)
    row = next((r for r in [*diagnosis.get("ranking", []), diagnosis.get("base", {})] if r.get("effect") == name), None)
    if not name or (row is None and not given):
        raise PlopError(
            "There is no effect to add.",
            where=name or "augment.effect",
            expected="an effect that the diagnosis fitted, or --value PARAMETER=VALUE",
            found=", ".join(r["effect"] for r in diagnosis.get("ranking", [])) or "no diagnosis",
            fix="Run `plop diagnose` with the recordings, or give --effect and --value.",
        )
    parameters = {} if row is None else {k: _kept(p) for k, p in row["parameters"].items()}
    for key, value in given.items():
        parameters[key] = {"value": value, "low": None, "high": None}
    return name, parameters


def _kept(fitted: dict[str, Any]) -> dict[str, Any]:
    """Keep of a fitted number what a model tells of it: value, interval, and what else is known of how sure it is."""
    also = {key: fitted[key] for key in ("also", "determined") if fitted.get(key) not in (None, [])}
    return {**{key: fitted.get(key) for key in ("value", "low", "high")}, **also}


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


STAGE = Stage(
    name="augment",
    version=6,
    help="Add an effect to a model; reversible.",
    config=AugmentConfig,
    inputs={
        "model": InputSpec(("train", "identify", "augment"), "the model to add to"),
        "diagnosis": InputSpec(
            ("diagnose",), "what was fitted; the model's latest without it and --value.", optional=True, only_named=True
        ),
        "engine": InputSpec(("identify",), "engine beside a learned model", optional=True),
        "effect_file": InputSpec((), "your own effects, a Python file", optional=True),
    },
    run=run,
    check=check,
)
