"""Rest state: the position of each Gaussian at the first frame, and its neighbours there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from torch import Tensor

from plop.geometry.clouds.neighbours import nearest

_NEIGHBOURS = 20
"""Number of neighbours, as in the physical terms of the loss (`plop.dynamics.losses.physical`)."""


@dataclass(frozen=True)
class RestPlaces:
    """Positions at the first frame of the present Gaussians, or of their ancestors."""

    places: Tensor
    """Shape [N, 3] [m]."""

    @cached_property
    def neighbours(self) -> np.ndarray:
        """The nearest neighbours of each, shape [N, k], k <= 20, int64, nearest first; computed on first use."""
        return np.ascontiguousarray(nearest(self.places, _NEIGHBOURS)[1].cpu().numpy())

    def select(self, index: Tensor) -> RestPlaces:
        """Select a subset; `index` may repeat rows."""
        return RestPlaces(self.places[index])

    def moved(self, shift: Tensor) -> RestPlaces:
        """Displace the positions by `shift`, shape [N, 3] [m]: the halves of a split Gaussian are at different ones."""
        return RestPlaces(self.places + shift)
