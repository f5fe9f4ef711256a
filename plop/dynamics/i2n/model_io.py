"""Model files: weights in safetensors, everything else in JSON beside them.

model.safetensors    weights; of another kind than "plop", the kind in the header
model.json           {"schema", "kind": "plop", "config": {...}, "training": {...}}
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor

from plop.artifacts.atomic_file import whole, write_json
from plop.artifacts.layouts import Model
from plop.dynamics.i2n.model import PlopConfig, PlopModel
from plop.dynamics.i2n.network import I2NConfig
from plop.dynamics.resampling import ResamplingConfig
from plop.errors import PlopError

MODEL_SCHEMA = 1


class Learned(Protocol):
    """A model that can be written: its kind, its configuration and its weights."""

    config: Any
    """Its configuration, a dataclass."""

    @property
    def kind(self) -> str:
        """Name of the dynamics."""

    def state_dict(self) -> dict[str, Tensor]:
        """Return the weights."""

    def load_state_dict(self, state_dict: Mapping[str, Tensor]) -> object:
        """Set the weights."""


def save_model(folder: Path, model: Learned, *, training: Mapping[str, Any] | None = None) -> None:
    """Write a model's two files, each atomically.

    Args:
        folder: Existing folder.
        model: The model.
        training: Training facts to store with it (JSON types).
    """
    weights = {name: value.detach().cpu().contiguous() for name, value in model.state_dict().items()}
    with whole(Model(folder).weights) as scratch:
        save_file(weights, scratch, metadata=None if model.kind == PlopModel.kind else {"kind": model.kind})
    facts = {
        "schema": MODEL_SCHEMA,
        "kind": model.kind,
        "config": asdict(model.config),
        "training": dict(training or {}),
    }
    write_json(Model(folder).facts, facts)


def load_model(folder: Path, device: torch.device | str = "cpu") -> PlopModel:
    """Read a model.

    Args:
        folder: Payload of `train`.
        device: Device to load it to.

    Returns:
        The model in evaluation mode.

    Raises:
        PlopError: A file is missing, damaged or of another schema.
    """
    facts = read_facts(folder)
    model = PlopModel(config_from_dict(facts["config"]))
    load_weights(folder, model)
    return model.to(device).eval()


def load_weights(folder: Path, model: Learned) -> None:
    """Read the weights of a folder into a model.

    Raises:
        PlopError: They are missing, damaged, of another kind or of another size.
    """
    path = Model(folder).weights
    try:
        with safe_open(path, framework="pt") as file:
            kind = (file.metadata() or {}).get("kind", PlopModel.kind)
        if kind != model.kind:
            raise PlopError(
                "The weights are of another dynamics than model.json.",
                where=path,
                expected=model.kind,
                found=kind,
                fix="Keep the two files of a model together; run `plop train` again.",
            )
        model.load_state_dict(load_file(path))
    except (OSError, SafetensorError, RuntimeError) as error:
        raise PlopError(
            "The model's weights cannot be read.",
            where=path,
            expected="weights that fit model.json",
            found=str(error).splitlines()[0],
            fix="Run `plop train` again.",
        ) from error


def read_facts(folder: Path) -> dict[str, Any]:
    """Read model.json and check its schema."""
    path = Model(folder).facts
    try:
        facts: dict[str, Any] = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise PlopError(
            "This is not a learned model.",
            where=path,
            expected="model.json of `plop train`",
            found=str(error),
            fix="Run `plop train`, or correct the address.",
        ) from error
    if facts.get("schema") != MODEL_SCHEMA:
        raise PlopError(
            "The model has another schema.",
            where=path,
            expected=f"schema {MODEL_SCHEMA}",
            found=f"schema {facts.get('schema')}",
            fix="Update plop, or train again.",
        )
    return facts


def config_from_dict(data: Mapping[str, Any]) -> PlopConfig:
    """Rebuild the configuration from its JSON form."""
    parts = dict(data)
    parts["network"] = I2NConfig(**parts["network"])
    parts["resampling"] = ResamplingConfig(**parts["resampling"])
    return PlopConfig(**parts)
