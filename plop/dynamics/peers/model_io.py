"""Files of a peer: those of a learned model (`plop.dynamics.i2n.model_io`), kind is the name of the dynamics."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

import torch

from plop.dynamics.i2n.model_io import load_weights, read_facts
from plop.dynamics.peers.model import PeerConfig, PeerModel
from plop.dynamics.peers.settings import GraphConfig, PeerName, TransformerConfig

PEERS: tuple[PeerName, ...] = get_args(PeerName)


def load_peer(folder: Path, device: torch.device | str = "cpu") -> PeerModel:
    """Read a peer in evaluation mode.

    Raises:
        PlopError: A file is missing, damaged, of another schema or of another dynamics.
    """
    model = PeerModel(peer_config(read_facts(folder)["config"]))
    load_weights(folder, model)
    return model.to(device).eval()


def peer_config(data: Mapping[str, Any]) -> PeerConfig:
    """Rebuild the configuration from its JSON form."""
    network = TransformerConfig if data["dynamics"] == "transformer" else GraphConfig
    return PeerConfig(**{**data, "network": network(**data["network"])})
