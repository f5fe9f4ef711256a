"""DPI-Net as published: relations as one-hot matrices of edges times particles. For the scaling table only."""

from __future__ import annotations

import torch
from torch import Tensor

from plop.dynamics.peers.propagation import PropagationNetwork


class DensePropagationNetwork(PropagationNetwork):
    """The same network; gathering and summing are products with dense matrices, so that memory is edges * particles."""

    def _gather(self, values: Tensor, index: Tensor, count: int) -> Tensor:
        return _one_hot(values, index, count) @ values

    def _summed(self, values: Tensor, receivers: Tensor, count: int) -> Tensor:
        return _one_hot(values, receivers, count).T @ values


def _one_hot(values: Tensor, index: Tensor, count: int) -> Tensor:
    return torch.zeros(len(index), count, dtype=values.dtype, device=values.device).scatter_(1, index[:, None], 1)
