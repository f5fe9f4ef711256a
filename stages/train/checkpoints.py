"""Checkpoints: the complete state of a training run, for resuming with identical results on as many threads.

On other threads results differ by rounding: oneDNN adds a convolution's gradient up in one part for each thread.
checkpoint.safetensors holds weights, averaged weights and Adam's moments, its header the step and the best
score so far. No pickles. The file is complete or absent.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor
from torch.optim.swa_utils import AveragedModel

from plop.artifacts.atomic_file import whole
from plop.artifacts.layouts import Model
from plop.dynamics.i2n.model import PlopModel
from plop.dynamics.learned import LearnedModel
from plop.errors import PlopError


@dataclass(frozen=True)
class Progressed:
    """Progress of a training run."""

    step: int
    best_error: float
    """Smallest error of rollouts so far: to the tracks [m], or the rendering loss."""
    best_step: int


def save_checkpoint(
    folder: Path, model: LearnedModel, averaged: AveragedModel, optimiser: torch.optim.Optimizer, at: Progressed
) -> None:
    """Write a checkpoint over the last one."""
    tensors = {f"model.{k}": v.detach().clone() for k, v in model.state_dict().items()}
    tensors |= {f"averaged.{k}": v.detach().clone() for k, v in averaged.state_dict().items()}
    for index, entry in optimiser.state_dict()["state"].items():
        for key, value in entry.items():
            tensors[f"adam.{index}.{key}"] = torch.as_tensor(value).detach().clone()
    facts = {"step": str(at.step), "best_error": repr(at.best_error), "best_step": str(at.best_step)}
    facts["dynamics"] = model.kind
    with whole(Model(folder).checkpoint) as scratch:
        save_file({k: v.contiguous() for k, v in tensors.items()}, scratch, metadata={"progress": json.dumps(facts)})


def load_checkpoint(
    folder: Path, model: LearnedModel, averaged: AveragedModel, optimiser: torch.optim.Optimizer
) -> Progressed | None:
    """Restore a checkpoint into model, averaged weights and optimiser.

    Returns:
        Its progress; None when there is no checkpoint, or none that matches.

    Raises:
        PlopError: It is of another dynamics.
    """
    path = Model(folder).checkpoint
    if not path.is_file():
        return None
    try:
        with safe_open(path, framework="pt") as file:
            facts = json.loads(file.metadata()["progress"])
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, KeyError, ValueError):
        return None
    if facts.get("dynamics", PlopModel.kind) != model.kind:
        raise PlopError(
            "The checkpoint is of another dynamics.",
            where=path,
            expected=model.kind,
            found=str(facts["dynamics"]),
            fix="Remove it, or train these dynamics in another folder.",
        )
    if _below(tensors, "averaged.").keys() != averaged.state_dict().keys():
        return None
    model.load_state_dict(_below(tensors, "model."))
    averaged.load_state_dict(_below(tensors, "averaged."))
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in _below(tensors, "adam.").items():
        index, _, name = key.partition(".")
        state.setdefault(int(index), {})[name] = value
    whole = optimiser.state_dict()
    whole["state"] = state
    optimiser.load_state_dict(whole)
    return Progressed(int(facts["step"]), float(facts["best_error"]), int(facts["best_step"]))


def _below(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {key[len(prefix) :]: value for key, value in tensors.items() if key.startswith(prefix)}
