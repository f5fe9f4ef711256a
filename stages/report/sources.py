"""Read what a report is made from, and refuse what does not belong together."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from plop.artifacts.layouts import ComparisonFiles
from plop.artifacts.lineage import made_from
from plop.comparison.field_file import StoredField, read_field
from plop.comparison.result import Comparison
from plop.diagnosis.decision.result import Diagnosis
from plop.errors import PlopError
from plop.models import trained_on
from plop.pipeline.stage import Input, Inputs
from plop.recordings.set import RecordingSet
from plop.reporting.colours import MODELS
from plop.reporting.compared import Compared, ModelNumbers


def several(inputs: Inputs, name: str) -> list[Input]:
    """Give the artifacts of an input that takes many, in the order given."""
    found = {int(key.partition(".")[2]): value for key, value in inputs.items() if key.startswith(f"{name}.")}
    return [found[k] for k in sorted(found)]


def read_model(folder: Path) -> dict[str, Any]:
    """Read model.json of an artifact.

    Raises:
        PlopError: It is missing or damaged.
    """
    try:
        facts: dict[str, Any] = json.loads((folder / "model.json").read_text())
    except (OSError, ValueError) as error:
        raise _damaged(folder, error) from error
    return facts


def _numbers(folder: Path) -> ModelNumbers:
    facts = read_model(folder)
    try:
        return ModelNumbers.of(facts)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise _damaged(folder, error) from error


def _damaged(model: Path, error: Exception) -> PlopError:
    return PlopError(
        "A result cannot be read.",
        where=model / "model.json",
        expected="parameters, each with its value",
        found=f"{type(error).__name__}: {error}",
        fix="Run the stage that writes it again.",
    )


def model_key(item: Input) -> str:
    """Fingerprint of the model that an artifact was made with; empty when it is not known."""
    source = item.manifest.inputs.get("model", {}) if item.manifest is not None else {}
    return str(source.get("fingerprint", ""))


def labels_of(inputs: Inputs, labels: tuple[str, ...]) -> list[str]:
    """Name the models: as asked for, else by address.

    Raises:
        PlopError: There are not as many labels as comparisons.
    """
    comparisons = several(inputs, "comparisons")
    if labels:
        if len(labels) != len(comparisons) or len(set(labels)) != len(labels):
            raise PlopError(
                "The labels do not fit the comparisons.",
                where="report.labels",
                expected=f"{len(comparisons)} different labels",
                found=", ".join(labels),
                fix="Give one label for each model, in their order, or none.",
            )
        return list(labels)
    found = []
    for number, item in enumerate(comparisons):
        source = item.manifest.inputs.get("model", {}) if item.manifest is not None else {}
        known = "fingerprint" in source
        found.append(f"{source['stage']}@{source['fingerprint'][:8]}" if known else f"model {number + 1}")
    return found


def check_models(inputs: Inputs) -> None:
    """Refuse one model in two comparisons, and what was diagnosed of a model that was not compared.

    Raises:
        PlopError: One of the two, as far as the artifacts tell.
    """
    models = [key for item in several(inputs, "comparisons") if (key := model_key(item))]
    if len(set(models)) < len(models):
        raise PlopError(
            "One model is compared twice.",
            where="report.comparisons",
            expected="different models",
            found=", ".join(key[:8] for key in models),
            fix="Name each model once.",
        )
    for item in several(inputs, "diagnoses"):
        if models and model_key(item) and model_key(item) not in models and item.manifest is not None:
            raise PlopError(
                "A diagnosis is of a model that is not in the report.",
                where=item.manifest.address,
                expected=", ".join(key[:8] for key in models),
                found=model_key(item)[:8],
                fix="Leave it out, or compare its model, too.",
            )


def read_compared(inputs: Inputs, labels: list[str], recordings: RecordingSet) -> list[Compared]:
    """Read the comparisons and, where it is given, the model of each.

    Raises:
        PlopError: A comparison is of other recordings or of another schema.
    """
    models = {item.manifest.fingerprint: item for item in several(inputs, "models") if item.manifest is not None}
    found = []
    for number, (label, item) in enumerate(zip(labels, several(inputs, "comparisons"), strict=True)):
        _check_recordings(item, inputs["recordings"], label)
        errors = Comparison.load(item.path)
        if errors.environment != recordings.environment:
            raise PlopError(
                "A comparison does not fit the recordings.",
                where=item.path / Comparison.FILE,
                expected=recordings.environment,
                found=errors.environment,
                fix="Run `plop compare` on these recordings.",
            )
        own = models.get(model_key(item))
        model = ModelNumbers() if own is None else _numbers(own.path)
        found.append(Compared(label, MODELS[number % len(MODELS)], errors, model))
    return found


def _check_recordings(item: Input, recordings: Input, label: str) -> None:
    made, own = item.manifest, recordings.manifest
    if made is not None and own is not None and not made_from(made, "recordings", own):
        source = made.inputs["recordings"]
        raise PlopError(
            "Results of different recordings do not go into one report.",
            where=label,
            expected=f"made from {own.address}",
            found=f"made from {source.get('stage')}@{source['fingerprint'][:8]}",
            fix="Run `plop compare` with the same recordings for every model.",
        )


def read_fields(inputs: Inputs, name: str) -> list[StoredField]:
    """Read one episode's error field of every model.

    Raises:
        PlopError: The models were compared on different points.
    """
    fields = [read_field(ComparisonFiles(item.path).field(name)) for item in several(inputs, "comparisons")]
    for field in fields[1:]:
        same = field.points_m.shape == fields[0].points_m.shape
        if not same or np.abs(field.points_m - fields[0].points_m).max() > 1e-6:
            raise PlopError(
                "The models were compared on different points.",
                where=name,
                expected="the same tracks and seed in every comparison",
                found="other points",
                fix="Run `plop compare` again with the same tracks and seed.",
            )
    return fields


def fitted_episodes(inputs: Inputs) -> list[str]:
    """Episodes that a model or an effect of one was fitted to.

    A diagnosis counts when one of the models was made from it, or when that cannot be told; a model when it was made
    from these recordings themselves.
    """
    models = [item.manifest for item in several(inputs, "models") if item.manifest is not None]
    acted_on = {m.inputs["diagnosis"]["fingerprint"] for m in models if "diagnosis" in m.inputs}
    names: list[str] = []
    for item in several(inputs, "diagnoses"):
        known = item.manifest is not None and bool(models)
        if not known or (item.manifest is not None and item.manifest.fingerprint in acted_on):
            names += Diagnosis.load(item.path).episodes
    own = inputs["recordings"].manifest
    for item in several(inputs, "models"):
        if own is not None and item.manifest is not None and "recordings" in item.manifest.inputs:
            names += _learned_from(item.path) if made_from(item.manifest, "recordings", own) else []
    return sorted(set(names))


def _learned_from(model: Path) -> list[str]:
    """Episodes that a model itself was fitted to or trained on."""
    return [*read_model(model).get("training", {}).get("episodes", []), *trained_on(model)]


def fit_is_known(inputs: Inputs) -> bool:
    """Tell whether every diagnosis that a model was made from is given: else nobody knows what is held out."""
    models, given = several(inputs, "models"), several(inputs, "diagnoses")
    if len(models) < len(several(inputs, "comparisons")) > 1:
        return False
    marks = {item.manifest.fingerprint for item in given if item.manifest is not None}
    made_from = [item.manifest.inputs.get("diagnosis") for item in models if item.manifest is not None]
    return all(source is None or source.get("fingerprint") in marks for source in made_from)
