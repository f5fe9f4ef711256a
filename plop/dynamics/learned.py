"""The models that `train` fits: PLOP and the peers it is compared with, all trained and stepped the same way."""

from __future__ import annotations

from typing import Literal

from plop.dynamics.i2n.model import PlopConfig, PlopModel
from plop.dynamics.peers.model import PeerConfig, PeerModel

DynamicsName = Literal["i2n", "gs-dynamics", "dpi-net", "transformer"]
LearnedConfig = PlopConfig | PeerConfig
LearnedModel = PlopModel | PeerModel


def untrained(config: LearnedConfig) -> LearnedModel:
    """Build a model with random weights, drawn from torch's generator."""
    return PeerModel(config) if isinstance(config, PeerConfig) else PlopModel(config)


def parameter_count(model: LearnedModel) -> int:
    """Count the trained numbers of a model."""
    return sum(weight.numel() for weight in model.parameters() if weight.requires_grad)
