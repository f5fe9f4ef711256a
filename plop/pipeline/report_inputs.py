"""What a report needs: a comparison, scores and, where there is one, a diagnosis for each model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from plop.artifacts.lineage import parents
from plop.artifacts.store import Artifact
from plop.errors import PlopError
from plop.pipeline.preparation import Preparation
from plop.pipeline.stage import Stage


def report_inputs(
    preparation: Preparation, stage: Stage, given: Mapping[str, str | Path], config: Any
) -> dict[str, str | Path]:
    """Complete the inputs of `report` from the models and the recordings.

    Args:
        preparation: Makes what is missing.
        stage: `report`.
        given: What the user named: "models", addresses with commas between, and "recordings".
        config: Its settings.

    Raises:
        PlopError: No model or no recordings are named, or one model twice, or the stage refuses them.
    """
    found = dict(given)
    if "comparisons" in found:
        return found
    named = [address for part in str(found.get("models", "")).split(",") if (address := part.strip())]
    if not named or "recordings" not in found:
        raise PlopError(
            "What shall be reported?",
            expected="--models NAME[,NAME...] and --recordings NAME",
            found=", ".join(f"--{key}" for key in found) or "neither",
            fix="`plop status` lists what there is.",
        )
    store = preparation.store
    recordings = store.find(str(found["recordings"]))
    models = [store.find(address) for address in named]
    if len({model.key for model in models}) < len(models):
        raise PlopError(
            "One model is named twice.",
            where="--models",
            expected="different models, the base first",
            found=str(found["models"]),
            fix="Name each model once.",
        )
    preparation.check_inputs(stage, {"recordings": recordings.address}, config)
    preparation.reach(found, "init", "fit-init", lambda: preparation.derived("fit-init", recordings, None).address)

    def of_each(command: str) -> str:
        return ",".join(preparation.derived(command, recordings, model).address for model in models)

    preparation.reach(found, "comparisons", "compare", lambda: of_each("compare"))
    if "evals" not in found:
        preparation.reach(found, "evals", "eval", lambda: of_each("eval"))
    diagnoses = diagnoses_of(models, [a for a in store.artifacts("diagnose") if _is_of(a, recordings, models)])
    if diagnoses:
        found.setdefault("diagnoses", ",".join(a.address for a in diagnoses))
    found["models"] = ",".join(m.address for m in models)
    return found


def labels_of_models(models: str) -> tuple[str, ...]:
    """Give what to call the models: the names that the user typed; nothing where one is an address."""
    names = tuple(name.strip() for name in models.split(",") if name.strip())
    return names if len(set(names)) == len(names) and not any("@" in name for name in names) else ()


def diagnoses_of(models: list[Artifact], diagnoses: list[Artifact]) -> list[Artifact]:
    """Choose among several diagnoses of one model: those that a model was made from, else the latest.

    Args:
        models: What is reported.
        diagnoses: Of these models, the latest last.
    """
    used = {key for model in models if (key := parents(model).get("diagnosis")) is not None}
    of = {a.key: parents(a).get("model") for a in diagnoses}
    answered = {of[key] for key in used if key in of}
    latest = {of[a.key]: a.key for a in diagnoses}
    return [a for a in diagnoses if a.key in used or (of[a.key] not in answered and latest[of[a.key]] == a.key)]


def _is_of(diagnosis: Artifact, recordings: Artifact, models: list[Artifact]) -> bool:
    made_from = parents(diagnosis)
    return made_from.get("recordings") == recordings.key and made_from.get("model") in {m.key for m in models}
