"""Any model from its folder: learned, engine, or either with effects added.

model.json states the kind:
    plop        {"config"}; weights beside it (plop.dynamics.i2n.model_io); folds/<k>/ may hold models of that kind that
                were trained without some of the episodes, {"training": {"left_out": [names]}}
    gs-dynamics, dpi-net, transformer    as plop (plop.dynamics.peers.model_io)
    engine      {"engine": settings}; see plop.physics.adapters.base_io
    augmented   {"engine", "effects": [{"effect", "parameters": {name: {"value", ...}}}], "effect_files": [names]};
                the base's own files are in base/, a user's effect files in effects/
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from plop.artifacts.layouts import Model
from plop.dynamics.i2n.model_io import load_model as load_learned
from plop.dynamics.i2n.model_io import read_facts
from plop.dynamics.interface import DynamicsModel
from plop.dynamics.peers.model_io import PEERS, load_peer
from plop.errors import PlopError
from plop.physics.adapters.augmented import AugmentedModel
from plop.physics.adapters.base_io import base_from_dict
from plop.physics.adapters.filled import EngineBase
from plop.physics.adapters.filled_model import FilledEngineModel
from plop.physics.effects.effect import Effect
from plop.physics.effects.library import effect_type, library
from plop.physics.effects.trust import trusted_copies

KINDS = ("plop", *PEERS, "engine", "augmented")


def load_model(folder: str | os.PathLike[str], device: torch.device | str = "cpu") -> DynamicsModel:
    """Read a model of any kind.

    Args:
        folder: Artifact of `train`, `identify` or `augment`, or its folder.
        device: Where a learned model runs; the engine runs on the CPU.

    Raises:
        PlopError: A file is missing, damaged or of an unknown kind, or contains an untrusted effect file.
    """
    folder = Path(folder)
    facts = read_facts(folder)
    kind = facts.get("kind")
    if kind == "plop":
        return load_learned(folder, device)
    if kind in PEERS:
        return load_peer(folder, device)
    if kind == "engine":
        return FilledEngineModel(base_from_dict(facts["engine"]), cut_faces=True)
    if kind == "augmented":
        effects, engine, inner = effects_of(folder), base_from_dict(facts["engine"]), innermost(folder)
        if (
            read_facts(inner).get("kind") == "engine"
        ):  # exact: one run with the effects instead of the difference of two
            return FilledEngineModel(engine, effects, cut_faces=True)
        return AugmentedModel(load_model(inner, device), engine, effects)  # all effects in one difference of two runs
    raise PlopError(
        "The model is of an unknown kind.",
        where=Model(folder).facts,
        expected=", ".join(KINDS),
        found=str(kind),
        fix="Update plop.",
    )


def augment(
    model: DynamicsModel, *effects: Effect, engine: FilledEngineModel | EngineBase | None = None
) -> DynamicsModel:
    """Add effects to a model; the model itself is not changed.

    Args:
        model: The base: learned, an engine, or either with effects already.
        effects: The laws to add.
        engine: Computes the displacement that the effects add to a learned model: an engine fitted to the same object.

    Raises:
        PlopError: A learned model without an engine.
    """
    if isinstance(model, FilledEngineModel):
        return FilledEngineModel(model.base, (*model.effects, *effects), cut_faces=model.cut_faces)
    if isinstance(model, AugmentedModel):
        return AugmentedModel(model.base, model.engine, (*model.effects, *effects))
    if engine is None:
        raise PlopError(
            "A learned model needs an engine to compute effects.",
            where="augment",
            found="none",
            expected="engine=, a model of `plop identify`",
            fix="Run `plop identify` on the recordings it was trained on.",
        )
    return AugmentedModel(model, engine.base if isinstance(engine, FilledEngineModel) else engine, effects)


def device_of(model: DynamicsModel) -> torch.device:
    """Return the device on which a model expects its states: that of its weights; the engine runs on the CPU."""
    if isinstance(model, AugmentedModel):
        return device_of(model.base)
    if isinstance(model, torch.nn.Module):
        return next((weight.device for weight in model.parameters()), torch.device("cpu"))
    return torch.device("cpu")


def effects_of(folder: Path) -> tuple[Effect, ...]:
    """Return the effects added to a model, innermost first; empty for a model without effects.

    Raises:
        UntrustedEffectError: It contains effect files that are not trusted by this user.
    """
    facts = read_facts(folder)
    if facts.get("kind") != "augmented":
        return ()
    types = library(trusted_copies(sorted(Model(folder).effects.glob("*.py"))))
    own = tuple(_effect(types, entry) for entry in facts["effects"])
    return (*effects_of(Model(folder).base.folder), *own)


def _effect(types: Mapping[str, type[Effect]], entry: Mapping[str, Any]) -> Effect:
    values = {name: float(parameter["value"]) for name, parameter in entry["parameters"].items()}
    return effect_type(entry["effect"], dict(types))(**values)


def engine_of(folder: Path) -> EngineBase | None:
    """Return the engine's settings of a model; None for a learned one."""
    facts = read_facts(folder)
    return base_from_dict(facts["engine"]) if "engine" in facts else None


def innermost(folder: Path) -> Path:
    """Return the folder of the model below all added effects."""
    while read_facts(folder).get("kind") == "augmented":
        folder = Model(folder).base.folder
    return folder


def trained_on(folder: Path) -> frozenset[str]:
    """Return the names of the recordings that a model was trained on (`train` keeps their tracks); engine: empty."""
    return frozenset(path.stem for path in Model(innermost(folder)).tracks.folder.glob("*.h5"))


def seen_by(folder: Path, names: Collection[str], recordings: Sequence[str]) -> list[str]:
    """Return those of the given episodes that an engine, or an effect added to it, was fitted to.

    Args:
        folder: The model.
        names: Names of the episodes.
        recordings: Content of their recordings (`recordings_content`); where these are unknown, names are compared.
    """
    facts, found = read_facts(folder), set[str]()
    for part in ("training", "fitted"):
        recorded = facts.get(part, {})
        same = set(recorded.get("recordings", ())) & set(recordings)
        if same or not (recorded.get("recordings") and recordings):
            found |= set(recorded.get("episodes", ())) & set(names)
    below = seen_by(Model(folder).base.folder, names, recordings) if facts.get("kind") == "augmented" else []
    return sorted(found | set(below))


def judges_of(folder: Path) -> dict[str, Path]:
    """Return the models trained without a recording of the training set (`train --folds`), by recording."""
    folds = sorted(Model(innermost(folder)).folds.glob("*"))
    return {name: fold for fold in folds for name in read_facts(fold)["training"]["left_out"]}
