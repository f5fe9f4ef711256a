"""The networks' activation, with the same digits on any number of threads."""

from __future__ import annotations

import torch
from torch import Tensor, nn

_PART = 16_384
"""Elements that are worked on at once: torch shares out only more than 32,768 among its threads, and whole vectors of
any processor fill it."""


class SiLU(nn.Module):
    """Multiply by the sigmoid, as `torch.nn.SiLU` does on one thread.

    On several threads torch cuts the elements into as many parts, and works on those that fill no whole vector at the
    end of each by another formula: the last digit of a few hangs on the number of threads. Fixed parts do not.
    """

    def forward(self, x: Tensor) -> Tensor:
        """Map each element, any shape."""
        if x.numel() <= _PART or x.device.type != "cpu":
            return nn.functional.silu(x)
        return torch.cat([nn.functional.silu(part) for part in x.reshape(-1).split(_PART)]).view(x.shape)
