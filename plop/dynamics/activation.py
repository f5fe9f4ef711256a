"""The networks' activation, bitwise reproducible on any number of threads."""

from __future__ import annotations

import torch
from torch import Tensor, nn

_PART = 16_384
"""Elements per call: torch distributes only more than 32,768 over its threads, and this is a multiple of the vector
length of any processor."""


class SiLU(nn.Module):
    """Multiply by the sigmoid, as `torch.nn.SiLU` does on one thread.

    On several threads torch splits the elements into as many parts, and computes the remainder of each part, which
    fills no whole vector, by another formula: the last digit of a few depends on the number of threads. Parts of
    fixed size avoid this.
    """

    def forward(self, x: Tensor) -> Tensor:
        """Map each element, any shape."""
        if x.numel() <= _PART or x.device.type != "cpu":
            return nn.functional.silu(x)
        return torch.cat([nn.functional.silu(part) for part in x.reshape(-1).split(_PART)]).view(x.shape)
